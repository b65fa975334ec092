"""What is of no sheet: said at once, and once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight.errors import JobError
from prooflight.scans.lines import LineBlock
from prooflight_line.run.notices import Notice, Silence, Unusable

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pytest


def test_a_silence_is_said_once_and_once_that_it_is_over() -> None:
    said, now_s = list[Notice](), [0.0]
    silence = Silence(10.0, said.append, clock=lambda: now_s[0])

    def blocks() -> Iterator[LineBlock]:
        for waits_s in (9.0, 12.0, 30.0, 3.0):
            now_s[0] += waits_s / 2
            silence.check()
            now_s[0] += waits_s / 2
            silence.check()
            silence.check()
            yield LineBlock(first_line=0, lines=np.zeros((1, 1, 1), np.uint16), time_s=0.0)
        now_s[0] += 100.0  # before the end, which is no line
        silence.check()

    for _ in silence.heard(blocks()):
        now_s[0] += 1000.0  # the taker's own time
        silence.check()
    assert [notice.kind for notice in said] == ["silent", "lines-again", "silent", "lines-again", "silent"]
    assert [notice.text for notice in said[:2]] == [
        "no line has arrived for 10 s",
        "lines arrive again, after 12 s",
    ]


def test_what_is_wrong_with_a_page_is_said_once_and_again_when_it_is_something_else(
    caplog: pytest.LogCaptureFixture,
) -> None:
    said = list[Notice]()
    unusable = Unusable(said.append)
    torn = JobError("p0003.tif", "the TIFF is truncated", remedy="copy it again")
    unusable.add(3, "p0003", torn)
    unusable.add(3, "p0003", torn)
    assert unusable[3] == str(torn)
    assert unusable[4] == ""
    unusable.add(3, "p0003", IndexError("7"))
    unusable.remove(3)
    unusable.remove(3)
    assert [notice.kind for notice in said] == ["page-unusable", "page-unusable", "page-usable"]
    assert "p0003.tif: the TIFF is truncated" in said[0].text
    assert "fault of Prooflight itself: IndexError: 7" in said[1].text
    assert "page p0003 could not be prepared" in caplog.text  # with its traceback
    assert unusable[3] == ""
