"""Jobs and their tickets, whichever comes first, and whenever the process is killed."""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from pathlib import Path

import pytest
from packages.line.tests.job_queue.test_hot_folder import Killed, contents, killed_at
from packages.line.tests.job_queue.test_tickets import XJDF

from prooflight.errors import RequestError
from prooflight_line.job_queue.arrivals import Arrivals
from prooflight_line.job_queue.examining import Examined
from prooflight_line.job_queue.filling import fill_once
from prooflight_line.job_queue.hot_folder import HotFolder
from prooflight_line.job_queue.listing import ticket_of
from prooflight_line.job_queue.pairing import Pairing
from prooflight_line.job_queue.tickets.ticket import Ticket

ORDER = XJDF.replace("menu%20of%20today.pdf", "menu.pdf")


class Filling:
    """A hot folder that is filled, and a clock."""

    def __init__(self, path: Path, *, needed: bool = False) -> None:
        path.mkdir(exist_ok=True)
        self.folder, self.now, self.ordered = HotFolder.open(path), 0.0, list[Ticket | None]()
        self.pairing = Pairing(folder=self.folder, wait_s=600, needed=needed, clock=lambda: self.now)
        self.arrivals = Arrivals(folder=path, settle_s=0.0)

    def examine(self, path: Path, ticket: Ticket | None) -> Examined:
        self.ordered.append(ticket)
        return Examined(pages=1, refused="" if path.read_bytes().startswith(b"good") else "is bad")

    def send(self, name: str, text: str) -> None:
        path = self.folder.path / name
        path.write_text(text)
        os.utime(path, ns=(0, 10**18 + len(list(self.folder.path.rglob("*")))))

    def fill(self) -> list[tuple[str, str, str]]:
        ended = [one.entry for one in fill_once(self.folder, self.arrivals, self.examine, self.pairing)]
        return [(one.stage, one.file.name, one.reason) for one in ended]


@pytest.fixture
def filling(tmp_path: Path) -> Filling:
    return Filling(tmp_path)


def test_both_are_taken_in_together(filling: Filling) -> None:
    filling.send("order.xjdf", ORDER)
    filling.send("menu.pdf", "good")
    assert filling.fill() == [("queued", "menu.pdf", "")]
    (entry,) = filling.folder.entries("queued")
    assert entry.ticket == entry.path / "order.xjdf"
    ordered = ticket_of(entry)
    assert ordered is not None
    assert filling.ordered == [ordered]
    assert (ordered.job_id, ordered.copies) == ("J-17", 250)


def test_a_ticket_waits_for_its_file_and_no_longer_than_stated(filling: Filling) -> None:
    filling.send("order.xjdf", ORDER)
    assert filling.fill() == []
    filling.now = 599
    assert filling.fill() == []
    filling.send("menu.pdf", "good")
    assert filling.fill() == [("queued", "menu.pdf", "")]
    filling.send("late.xjdf", ORDER.replace("menu.pdf", "late.pdf").replace("J-17", "J-18"))
    assert filling.fill() == []
    filling.now += 600
    late = "its file late.pdf did not arrive within 600 s; send both again"
    assert filling.fill() == [("rejected", "late.xjdf", late)]
    assert filling.fill() == []


def test_a_file_waits_for_its_ticket_where_each_has_one(tmp_path: Path) -> None:
    filling = Filling(tmp_path, needed=True)
    filling.send("menu.pdf", "good")
    assert filling.fill() == []
    filling.send("order.xjdf", ORDER)
    assert filling.fill() == [("queued", "menu.pdf", "")]
    filling.send("other.pdf", "good too")
    assert filling.fill() == []
    filling.now += 600
    why = "arrived without a ticket within 600 s; send both again"
    assert filling.fill() == [("rejected", "other.pdf", why)]


def test_a_ticket_that_comes_late_is_put_to_its_job_while_that_is_queued(filling: Filling) -> None:
    filling.send("menu.pdf", "good")
    assert filling.fill() == [("queued", "menu.pdf", "")]
    (before,) = filling.folder.entries("queued")
    filling.send("order.xjdf", ORDER)
    assert filling.fill() == [("queued", "menu.pdf", "")]
    (entry,) = filling.folder.entries("queued")
    assert entry.number == before.number
    assert filling.ordered[0] is None
    assert filling.ordered[1] is not None
    with filling.folder.printing():
        filling.send("menu.pdf.copy", "good 2")
        filling.send("order.xjdf", ORDER.replace("menu.pdf", "menu.pdf.copy").replace("J-17", "J-18"))
        assert filling.fill() == [("queued", "menu.pdf.copy", "")]


def test_a_bad_ticket_goes_with_its_job(filling: Filling) -> None:
    filling.send("menu.xjdf", "<XJDF")
    assert filling.fill() == []  # its file may come yet
    filling.send("menu.pdf", "good")
    ((stage, name, why),) = filling.fill()
    assert (stage, name) == ("rejected", "menu.pdf")
    assert why.startswith("menu.xjdf, line 1: is not XML")
    (entry,) = filling.folder.entries("rejected")
    assert sorted(file.name for file in entry.path.iterdir()) == ["menu.pdf", "menu.xjdf", "reason.txt"]
    assert filling.ordered == []


def test_the_same_content_is_printed_once_for_each_order(filling: Filling) -> None:
    filling.send("menu.pdf", "good")
    filling.send("menu.xjdf", ORDER)
    filling.fill()
    filling.send("menu.pdf", "good")
    filling.send("menu.xjdf", ORDER.replace("J-17", "J-18"))
    assert filling.fill() == [("queued", "menu.pdf", "")]
    filling.send("menu.pdf", "good")
    filling.send("menu.xjdf", ORDER.replace('Amount="250"', 'Amount="9"'))
    ((stage, _, why),) = filling.fill()
    assert stage == "rejected"
    assert "the same content is queued as 000001-" in why


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("late", [False, True])
def test_a_kill_at_any_change_loses_no_ticket(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: bool, late: bool
) -> None:
    """late: the ticket comes when its job is queued."""
    change, made = 0, [1]
    while made[0] >= change:
        change += 1
        filling = Filling(tmp_path / str(change))
        filling.send("menu.pdf", "good")
        if late:
            filling.fill()
        filling.send("order.xjdf", ORDER)
        sent = Counter([b"good", ORDER.encode()])
        with killed_at(change, monkeypatch, after=after) as made, contextlib.suppress(Killed):
            filling.fill()
        assert contents(filling.folder) == sent, change
        filling.fill()
        filling.fill()
        assert contents(filling.folder) == sent, change
        (entry,) = filling.folder.entries("queued")
        assert entry.ticket is not None
        assert not filling.folder.entries("checking", "rejected")
    assert change > 4


def test_people_hold_release_prefer_and_remove_jobs(filling: Filling) -> None:
    for name in ("a", "b", "c"):
        filling.send(f"{name}.pdf", f"good {name}")
    filling.fill()
    folder = filling.folder

    def queue(*stages: str) -> list[str]:
        return [entry.file.stem for entry in folder.entries(*stages or ("queued",))]  # type: ignore[arg-type]

    a, b, c = (entry.key for entry in folder.entries("queued"))
    folder.put_first(c)
    assert queue() == ["c", "a", "b"]
    folder.put_first(b)
    assert queue() == ["b", "c", "a"]
    folder.hold(b)
    assert (queue(), queue("held")) == (["c", "a"], ["b"])
    with folder.printing() as printing:
        assert printing.entry.file.stem == "c"
        with pytest.raises(RequestError, match="has no job"):
            folder.hold(c)
        printing.finished = True
    folder.release(b)
    assert queue() == ["b", "a"]  # in its place
    assert queue("done") == ["c"]
    assert folder.entries("done")[0].path.name == c  # its rank has gone
    folder.remove(a, "removed by Ann")
    assert folder.entries("rejected")[0].reason == "removed by Ann"
    filling.send("again.pdf", "good b")
    assert filling.fill()[0][0] == "rejected"
