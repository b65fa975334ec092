"""packaging/: what the files say holds, and every service of ours runs by exactly the command that they give."""

from __future__ import annotations

import contextlib
import json
import re
import shutil
import signal
import socket
import subprocess
import time
import urllib.parse
import urllib.request
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from reportlab.pdfgen.canvas import Canvas
from tests.packaging.compose_file import (
    OWN,
    PACKAGING,
    ROOT,
    document,
    environment_here,
    health_here,
    services,
)

from prooflight import __version__
from prooflight_line.records.database import connect
from prooflight_line.testing.postgres import LocalPostgres, local_postgres, server_programs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from prooflight.press.artefact import Press

DASHBOARD = ROOT / "packages" / "console" / "deploy" / "grafana-dashboard.json"
MM = 72 / 25.4
SHEETS = 5
WITHOUT = {
    "prooflight_queue_jobs",  # of a console with a hot folder
    "prooflight_false_alarm_rate_nominal",  # of a press that was trained
    "prooflight_false_alarm_rate_realised",  # of a run with a good sheet
}
"""Metrics that a press need not have."""
PATIENCE_S = 600.0
"""Only a test that fails waits so long."""


def test_every_image_and_volume_is_named_and_every_service_waits_for_one_that_is_there() -> None:
    compose = document()
    (build,) = [service["build"] for service in compose["services"].values() if "build" in service]
    assert (PACKAGING / build["context"] / build["dockerfile"]).is_file()
    assert {one.split("-")[0] for one in compose if one not in ("name", "services", "volumes")} == {"x"}
    for name, service in compose["services"].items():
        image, _, tag = service["image"].rpartition(":")
        assert image, name
        assert re.fullmatch(r"v?\d+(\.\d+)*", tag), f"{name}: {tag} is no version"
        if service["image"].startswith(OWN):
            assert tag == __version__
            assert (service["read_only"], service["cap_drop"]) == (True, ["ALL"])
        for volume in service["volumes"]:
            source, target = volume.split(":")[:2]
            assert target.startswith("/")
            assert (PACKAGING / source).exists() if source.startswith(".") else source in compose["volumes"]
        after = service.get("depends_on", ())
        assert set(after) <= set(compose["services"])
        for other, condition in after.items() if isinstance(after, dict) else ():
            if condition["condition"] == "service_healthy":
                assert "test" in compose["services"][other]["healthcheck"]
    used = {volume.split(":")[0] for one in compose["services"].values() for volume in one["volumes"]}
    assert set(compose["volumes"]) == {one for one in used if not one.startswith(".")}


def test_nothing_listens_beyond_this_machine() -> None:
    compose = document()["services"]
    assert not [name for name, service in compose.items() if "ports" in service]
    assert compose["records"]["network_mode"] == "none"
    assert "--web.listen-address=127.0.0.1:9090" in compose["prometheus"]["command"]
    assert compose["grafana"]["environment"]["GF_SERVER_HTTP_ADDR"] == "127.0.0.1"
    assert not [one for one in compose["console"]["command"] if "--host" in one]


def test_the_image_has_what_the_file_says_and_no_tools_that_build() -> None:
    text = (PACKAGING / "Containerfile").read_text(encoding="utf-8")
    stages = re.split(r"^FROM ", text, flags=re.MULTILINE)[1:]
    assert len(stages) == 2
    last = stages[-1]
    assert re.search(r"^USER prooflight$", last, re.MULTILINE)
    assert "pip" not in last
    assert last.index("USER prooflight") < last.index("ENTRYPOINT")
    assert "--require-hashes" in stages[0]
    for stage in stages:
        for installs in re.findall(r"apt-get install [^&]*", stage):
            assert "--no-install-recommends" in installs
        assert stage.count("apt-get update") == stage.count("rm -rf /var/lib/apt/lists/*")
    locked = (ROOT / "requirements" / "image.txt").read_text(encoding="utf-8")
    builds = re.findall(
        r"^([\w-]+)==", (ROOT / "requirements" / "build.txt").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert "hatchling" in builds
    assert not [name for name in ("hatchling", "editables", "pip") if f"\n{name}==" in locked]
    allowed = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    for copied in re.findall(r"^COPY (?!--)(.*) \S+$", stages[0], re.MULTILINE):
        assert {f"!{one.partition('/')[0]}" for one in copied.split()} <= set(allowed)


@pytest.fixture(scope="module")
def started(press: Press, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    """All services of ours: the press has printed its sheets, and the others go on."""
    for package in ("psycopg", "alembic", "obstore"):
        pytest.importorskip(package)
    if server_programs() is None:
        pytest.skip("PostgreSQL is not installed")
    folder = tmp_path_factory.mktemp("compose")
    demo = folder / "data" / "demo"
    demo.mkdir(parents=True)
    press.save(demo / "two-sensors.press")  # `demo` would need minutes to make one
    _job(demo / "sample-job.pdf")
    (records,) = [one for one in document()["services"].values() if one["image"].partition("postgres:")[1]]
    assert records["command"][:2] == ["postgres", "-c"]
    with local_postgres(*records["command"][2::2], "fsync=off") as server, contextlib.ExitStack() as stack:
        _first_start(server, records["environment"])
        (folder / "socket").symlink_to(server.folder)
        yield stack.enter_context(contextlib.closing(Stack.start(folder)))


class Stack:
    """The services as processes."""

    def __init__(self, folder: Path, ports: dict[int, int]) -> None:
        variables = {"SHEETS": str(SHEETS), "SHEETS_PER_S": "2"}
        self.folder, self.ports = folder, ports
        self.services = services(folder, ports=ports, variables=variables)
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    @classmethod
    def start(cls, folder: Path) -> Stack:
        stack = cls(folder, {port: _free_port() for port in (8080, 9090)})
        try:
            stack.run("setup", within_s=PATIENCE_S)
            for name in ("console", "shipper"):
                stack.begin(name)
            stack.wait("the console is healthy", stack._healthy)
            # The drum's prints are of another world than a small press without a second sensor was made for.
            stack.run("press", within_s=PATIENCE_S, codes=(0, 1, 3))
        except BaseException:
            stack.close()
            raise
        return stack

    def begin(self, name: str, program: str | None = None) -> None:
        """Start a service; program: in front of its arguments, as the entry point of an image of others."""
        service = self.services[name]
        arguments = [*([] if program is None else [program]), *service.arguments]
        with (self.folder / f"{name}.log").open("wb") as log:
            self._running[name] = subprocess.Popen(
                arguments, env=environment_here(service), stdout=log, stderr=log, cwd=self.folder
            )

    def run(self, name: str, *, within_s: float, codes: tuple[int, ...] = (0,)) -> None:
        """Run a service that ends by itself."""
        self.begin(name)
        assert self._running[name].wait(within_s) in codes, self.log(name)
        del self._running[name]

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text()

    def wait(self, what: str, condition: Callable[[], object]) -> None:
        ends_s = time.monotonic() + PATIENCE_S
        while not condition():
            ended = [name for name, one in self._running.items() if one.poll() is not None]
            assert not ended, self.log(ended[0])
            assert time.monotonic() < ends_s, f"not so: {what}"
            time.sleep(0.2)

    def get(self, port: int, path: str, **headers: str) -> str:
        request = urllib.request.Request(f"http://127.0.0.1:{self.ports[port]}{path}", headers=headers)
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return answer.read().decode()

    def _healthy(self) -> bool:
        return subprocess.run(health_here("console", self.ports), capture_output=True).returncode == 0

    def close(self) -> None:
        for one in self._running.values():
            one.send_signal(signal.SIGTERM)
        for one in self._running.values():
            try:
                one.wait(30)
            except subprocess.TimeoutExpired:
                one.kill()
                one.wait()


def test_each_sheet_has_one_name_in_the_logs_of_all_services(started: Stack) -> None:
    def events(name: str, event: str) -> list[dict[str, Any]]:
        rows = [json.loads(line) for line in started.log(name).splitlines()]
        return [row for row in rows if row["event"] == event]

    printed = [row["id"] for row in events("press", "sheet")]
    assert len(set(printed)) == SHEETS
    assert events("press", "run-ended")
    started.wait("all is shipped", lambda: len(events("shipper", "shipped")) >= SHEETS)
    assert [row["id"] for row in events("shipper", "shipped")] == printed
    assert events("console", "listening")
    url = started.services["shipper"].environment["PROOFLIGHT_RECORDS"]
    with connect(url) as connection:
        assert connection.execute("SELECT count(*) FROM sheets").fetchall() == [(SHEETS,)]


def test_the_dashboard_asks_for_metrics_that_a_running_press_has(started: Stack) -> None:
    token = (started.folder / "token" / "prometheus.token").read_text().strip()
    text = started.get(8080, "/metrics", Authorization=f"Bearer {token}")
    # A series without a value yet, as misprints of no kind, is declared all the same.
    there = set(re.findall(r"^(?:# TYPE )?(prooflight_\w+)", text, re.MULTILINE))
    asked = {name for expression in expressions() for name in re.findall(r"\bprooflight_[a-z_]+", expression)}
    assert asked - there <= WITHOUT
    assert len(asked & there) > 10


@pytest.mark.skipif(shutil.which("prometheus") is None, reason="Prometheus is not installed")
def test_prometheus_scrapes_the_console_and_answers_every_panel(started: Stack) -> None:
    started.begin("prometheus", "prometheus")

    def asked(expression: str) -> list[Any]:
        query = urllib.parse.urlencode({"query": expression})
        answer = json.loads(started.get(9090, f"/api/v1/query?{query}"))
        assert answer["status"] == "success", expression
        return answer["data"]["result"]

    def scraped() -> bool:
        with contextlib.suppress(OSError):
            return bool(asked("prooflight_build_info"))
        return False

    started.wait("Prometheus has scraped the console", scraped)
    empty = WITHOUT | {"prooflight_incidents", "prooflight_misprints_total"}  # until there is one
    for expression in expressions():
        if empty.isdisjoint(re.findall(r"\bprooflight_[a-z_]+", expression)):
            started.wait(f"a value of {expression}", lambda one=expression: asked(one))
        else:
            asked(expression)
    started.wait("all sheets are counted", lambda: asked(f"sum(prooflight_sheets_total) == {SHEETS}"))
    assert asked("prooflight_state == 1")
    assert asked("prooflight_journal_readable == 1")


def expressions() -> list[str]:
    """Expressions of all panels, for all presses."""
    panels = json.loads(DASHBOARD.read_text(encoding="utf-8"))["panels"]
    found = [target["expr"] for panel in panels for target in panel.get("targets", ())]
    return [one.replace("$press", ".*").replace("$__rate_interval", "1m") for one in found]


def _job(path: Path) -> None:
    canvas = Canvas(str(path), pagesize=(36 * MM, 30 * MM))
    for page in range(3):
        canvas.setFillColorCMYK(0, 0, 0, 1)
        for line in range(8):
            for word in range(5):
                canvas.rect(
                    4 * MM + 6 * word * MM,
                    4 * MM + 2.5 * line * MM,
                    (2 + (line + word + page) % 4) * MM,
                    MM,
                    0,
                    1,
                )
        canvas.showPage()
    canvas.save()


def _first_start(server: LocalPostgres, environment: dict[str, str]) -> None:
    """Make role and database, as the image of PostgreSQL does at its first start."""
    with connect(server.url, upgraded=False) as connection:
        connection.execute(f"CREATE ROLE {environment['POSTGRES_USER']} SUPERUSER LOGIN")
        connection.execute(
            f"CREATE DATABASE {environment['POSTGRES_DB']} OWNER {environment['POSTGRES_USER']}"
        )


def _free_port() -> int:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        return bound.getsockname()[1]
