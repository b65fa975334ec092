"""Whether browsers on the console delay verdicts of `watch`, and how soon they see them.

    python benchmarks/console_live.py --job job.pdf --press my.press --browsers 50 --seconds 60 --rate 5

`watch` inspects the drum's sheets; browsers listen to the page Now. Run it with --browsers 0 as well, and compare. It
prints one line of JSON: from a verdict's line of `watch --json` to its arrival at each browser, seconds at the median,
99 % and at most; the console's CPU time a second, and its memory when it began and when it ended; the sheets that were
late or not inspected. `prooflight study console` measures the same without inspection, for longer.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from prooflight_console.accounts.account_store import Accounts
from prooflight_console.accounts.roles import Role

PASSWORD = "correct horse battery"
SETTLE_S = 2.0


class Seen:
    """When each sheet was told, and when browsers heard of it."""

    def __init__(self) -> None:
        self.health_printed_s: dict[int, float] = {}
        self.heard_s: list[tuple[int, float]] = []

    def delays_s(self) -> np.ndarray:
        """Of every sheet at every browser."""
        return np.array(
            [
                at - self.health_printed_s[sheet]
                for sheet, at in self.heard_s
                if sheet in self.health_printed_s
            ]
        )


def watch_sheets(
    journal: Path, seen: Seen, *, job: Path, press: Path, seconds: float, rate: float
) -> dict[str, int]:
    """`watch` itself, on the drum."""
    words = ["watch", str(job), "--press", str(press), "--source", f"drum:{rate:g}", "--json"]
    words += ["--sheets", str(round(seconds * rate)), "--journal", str(journal)]
    counts = {"sheets": 0, "late": 0, "not_inspected": 0}
    running = subprocess.Popen(
        [sys.executable, "-m", "prooflight", *words], stdout=subprocess.PIPE, text=True, bufsize=1
    )
    assert running.stdout is not None
    for line in running.stdout:
        told = json.loads(line)
        if "sheet" in told:
            seen.health_printed_s[told["sheet"]] = time.monotonic()
            counts["sheets"] += 1
            counts["late"] += told["late"]
            counts["not_inspected"] += told["verdict"] == "not-inspected"
    running.wait()
    time.sleep(SETTLE_S)
    return counts


async def listen(port: int, cookie: str, seen: Seen, over: asyncio.Event) -> None:
    """One browser on the page Now."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=2**20)
    asked = f"GET /now/events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nCookie: {cookie}\r\n\r\n"
    writer.write(asked.encode())
    kind = ""
    ending = asyncio.create_task(over.wait())
    while True:
        reading = asyncio.create_task(reader.readline())
        done, _ = await asyncio.wait({reading, ending}, return_when=asyncio.FIRST_COMPLETED)
        if reading not in done or not (line := reading.result()):
            reading.cancel()
            break
        text = line.decode()
        if text.startswith("event: "):
            kind = text[7:].strip()
        elif text.startswith("data: ") and kind == "sheet":
            seen.heard_s.append((json.loads(text[6:])["sheet"], time.monotonic()))
    writer.close()


def cpu_s(pid: int) -> float:
    """Of a process, so far."""
    parts = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(parts[11]) + int(parts[12])) / os.sysconf("SC_CLK_TCK")


def memory_mb(pid: int) -> float:
    """Resident."""
    return int(re.findall(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())[0]) / 1024


async def measured(args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """One measurement."""
    journal, seen, over = folder / "journal.sqlite", Seen(), asyncio.Event()
    accounts = Accounts(folder / "journal.sqlite.console.sqlite")
    accounts.choose(accounts.add("bench", Role.OPERATOR, by="bench"), PASSWORD)
    accounts.close()
    words = ["serve", "--journal", str(journal), "--port", "0"]
    server = subprocess.Popen(
        [sys.executable, "-u", "-m", "prooflight", *words], stdout=subprocess.PIPE, text=True
    )
    assert server.stdout is not None
    found = re.search(r"127\.0\.0\.1:(\d+)", server.stdout.readline())
    assert found is not None
    port = int(found[1])
    async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=60, trust_env=False) as client:
        given = {"name": "bench", "password": PASSWORD}
        (await client.post("/api/v1/session", json=given)).raise_for_status()
        cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
    browsers = [asyncio.create_task(listen(port, cookie, seen, over)) for _ in range(args.browsers)]
    await asyncio.sleep(SETTLE_S)
    begun_s, begun_cpu_s, begun_mb = time.monotonic(), cpu_s(server.pid), memory_mb(server.pid)
    told: dict[str, int] = {}

    def work() -> None:
        found = watch_sheets(
            journal, seen, job=args.job, press=args.press, seconds=args.seconds, rate=args.rate
        )
        told.update(found)

    working = threading.Thread(target=work)
    working.start()
    while working.is_alive():
        await asyncio.sleep(0.1)
    lasted_s = time.monotonic() - begun_s
    result = {
        "browsers": args.browsers,
        "rate": args.rate,
        "sheets_told": len(seen.health_printed_s),
        "heard": len(seen.heard_s),
        "cpu_s_per_s": round((cpu_s(server.pid) - begun_cpu_s) / lasted_s, 3),
        "memory_mb": [round(begun_mb, 1), round(memory_mb(server.pid), 1)],
        "watch": told,
    }
    over.set()
    await asyncio.gather(*browsers)
    server.terminate()
    server.wait()
    delays = seen.delays_s()
    if delays.size:
        median, p99 = np.quantile(delays, [0.5, 0.99])
        result |= {"median_s": round(float(median), 3), "p99_s": round(float(p99), 3)}
        result["greatest_s"] = round(float(delays.max()), 3)
    return result


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--browsers", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=5.0, help="sheets/s")
    parser.add_argument("--job", type=Path, required=True)
    parser.add_argument("--press", type=Path, required=True)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        sys.stdout.write(json.dumps(asyncio.run(measured(args, Path(folder)))) + "\n")


if __name__ == "__main__":
    main()
