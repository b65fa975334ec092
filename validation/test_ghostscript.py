"""The RIP against Ghostscript, an independent one: real pages, and overprint and spots written by hand.

What is compared and how: ``benchmarks/rip_against_ghostscript.py``, which also prints the figures of all 81 pages.
"""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")
if not shutil.which("gs"):
    pytest.skip("needs Ghostscript (gs) as referee", allow_module_level=True)


def load_referee() -> Any:
    path = Path(__file__).resolve().parents[1] / "benchmarks" / "rip_against_ghostscript.py"
    spec = importlib.util.spec_from_file_location("rip_against_ghostscript", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


referee = load_referee()
have_pages = referee.SHARED.is_dir()


@pytest.mark.skipif(not have_pages, reason="needs the pages in ../shared/data")
@pytest.mark.parametrize("page", referee.chosen(referee.manifest()) if have_pages else [])
def test_real_pages(page: str) -> None:
    result = referee.compare(referee.SHARED / "pages" / f"{page}.pdf")
    assert result.interior > 0.05, "nothing to compare"
    assert result.agree >= 0.995, result


@pytest.mark.skipif(not have_pages, reason="needs the pages in ../shared/data")
def test_the_choice_covers_what_matters() -> None:
    rows = {row["id"]: row for row in referee.manifest()}
    picked = referee.chosen(list(rows.values()))
    assert len(picked) == len(set(picked)) == referee.PAGES
    flags = [flag for page in picked for flag in rows[page]["flags"]]
    assert flags.count("OVP") == sum("OVP" in row["flags"] for row in rows.values())
    assert flags.count("SEP") == sum("SEP" in row["flags"] for row in rows.values())
    assert {stratum for page in picked for stratum in rows[page]["strata"]} == {
        stratum for row in rows.values() for stratum in row["strata"]
    }


def test_the_referee_sees_a_wrong_ink() -> None:
    ours = np.zeros((50, 50, 4), dtype=np.uint8)
    ours[10:40, 10:40] = [0, 100, 0, 0]
    theirs = ours.copy()
    theirs[10:40, 10:40, 1] = 104
    result = referee.agreement(ours, theirs)
    assert result.worst == 4
    assert result.agree_inked == 0
    assert 0.4 < result.agree < 0.9


STATES = "/ExtGState<</N<</op true/OP true/OPM 0>>/M<</op true/OP true/OPM 1>>>>"
GOLD = "[/Separation/Gold/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[0 0.2 0.8 0.1]/N 1>>]"
BLACK = "[/Separation/Black/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[0 0 0 1]/N 1>>]"
BOTH = "[/DeviceN[/Magenta/Gold]/DeviceCMYK 5 0 R<</Subtype/NChannel/Colorants<</Gold " + GOLD + ">>>>]"
FUNCTION = b"{dup 0.2 mul 3 -1 roll add exch dup 0.8 mul exch 0.1 mul 0 4 1 roll}"  # m g -> 0 m+.2g .8g .1g
SPACES = f"/ColorSpace<</Au {GOLD}/B {BLACK}/D {BOTH}>>{STATES}"
UNDER = "0.4 0.2 0 0 k 0 0 100 100 re f /Au cs 0.5 scn 0 0 100 40 re f"


@pytest.mark.parametrize("state", ["", "/N gs", "/M gs"])
@pytest.mark.parametrize(
    "paint", ["0 0 0 1 k", "0.6 g", "0 0.4 0 0 k", "/Au cs 1 scn", "/B cs 0.6 scn", "/D cs 0.4 0.6 scn"]
)
def test_overprint_and_spots(write_pdf: Callable[..., Path], state: str, paint: str) -> None:
    entries = b"/FunctionType 4/Domain[0 1 0 1]/Range[0 1 0 1 0 1 0 1]"
    more = [b"<<%s/Length %d>>stream\n%s\nendstream" % (entries, len(FUNCTION), FUNCTION)]
    job = write_pdf(f"{UNDER} {state} {paint} 20 20 60 60 re f", resources=SPACES, more=more)
    result = referee.compare(job, profile=None, dpi=72)
    assert result.interior > 0.5
    assert result.worst <= referee.TOLERANCE, result
