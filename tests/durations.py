"""How long tests take, and which of them are slow; ``make test`` leaves these out.

A test is slow if it took more than ``SLOW_S`` seconds of processor time when durations were last recorded, with its
share of the fixtures that several tests use. ``make durations`` runs all tests and records them in ``durations.json``;
nobody writes there by hand. Processor time is what a test takes whatever else the machine does. Processes that a test
leaves running count for those tests during which they work.

Beside these are recorded tests that take long by the clock: CI waits for tests that sleep as for those that compute.
"""

from __future__ import annotations

import json
import os
import time
from collections import Counter, defaultdict
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

if TYPE_CHECKING:
    from collections.abc import Generator

    from numpy.typing import NDArray

DURATIONS = Path(__file__).with_name("durations.json")
SLOW_S = 1.0
LONG_S = 2.0
"""By the clock. Assumed: twice ``SLOW_S``, since a test shares two cores with two others."""
QUICK = "not slow"
"""The marker expression of ``make test``."""
CORES = 2
COMPILING_S = 120.0
"""Processor time that the kernels take to compile, when tests run for the first time."""
PROPERTY = "spent_s"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--record-durations", type=Path, metavar="FILE", help="record how long tests take")
    parser.addoption(
        "--no-quick-of", nargs="+", default=[], metavar="PATH", help="leave out quick tests of files"
    )


def pytest_configure(config: pytest.Config) -> None:
    file = config.getoption("--record-durations")
    if file is not None:
        config.pluginmanager.register(Meter())
        if not hasattr(config, "workerinput"):
            config.pluginmanager.register(Record(file))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark slow tests before they are selected by their marks; leave out quick ones that ran with bounds checked."""
    slow, elsewhere = _recorded()["slow"], tuple(config.getoption("--no-quick-of"))

    def left_out(item: pytest.Item) -> bool:
        return item.nodeid.startswith(elsewhere) and item.nodeid not in slow

    for item in items:
        if item.nodeid in slow:
            item.add_marker(pytest.mark.slow)
    if elsewhere:
        config.hook.pytest_deselected(items=[one for one in items if left_out(one)])
        items[:] = [one for one in items if not left_out(one)]


def pytest_report_header(config: pytest.Config) -> list[str]:
    """How long it takes, by those tests that were measured, and what is left out."""
    known = _recorded()
    slow_s = sum(known["slow"].values())
    if config.option.markexpr == QUICK:
        rooms = Counter("/".join(name.split("/")[:2]) for name in known["slow"])
        return [
            f"takes about {_minutes(known['quick_s'])} on {CORES} cores, "
            f"and when kernels are compiled first {_minutes(known['quick_s'] + COMPILING_S)} "
            f"({known['quick']} tests were measured)",
            f"leaves out {len(known['slow'])} tests that take more than {SLOW_S:g} s of processor time each, "
            f"{_minutes(slow_s)} in all; `make test-all` runs these too",
            "left out: " + ", ".join(f"{room} {count}" for room, count in sorted(rooms.items())),
        ]
    if not config.option.markexpr and not config.option.file_or_dir:
        return [f"all tests take about {_minutes(known['quick_s'] + slow_s)} on {CORES} cores"]
    return []


class Meter:
    """Measures the time that a test takes in the process that runs it, and hands it on with the test's reports."""

    def __init__(self) -> None:
        self._began = spent_s()
        self._common: dict[str, NDArray[np.float64]] = {}
        """What fixtures that several tests use took in this phase."""

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Generator[None, Any, Any]:
        if fixturedef.scope == "function":
            return (yield)
        began, within = spent_s(), sum(self._common.values())
        try:
            return (yield)
        finally:
            within = sum(self._common.values()) - within  # fixtures that it asked for count by themselves
            self._common[_name_of(fixturedef)] = spent_s() - began - within

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self) -> Generator[None, Any, Any]:
        self._began, self._common = spent_s(), {}
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Generator[None, Any, Any]:
        report = yield
        now = spent_s()
        # A process that outlives the one that started it is nobody's child, and what it used is no longer seen.
        own = np.maximum(now - self._began - sum(self._common.values()), 0.0)
        common = {name: took.tolist() for name, took in self._common.items()}
        report.user_properties.append(
            (PROPERTY, {"own": own.tolist(), "common": common, "uses": _common_of(item)})
        )
        self._began, self._common = now, {}
        return report


class Record:
    """Collects what ``Meter`` measured, in the process that the tests were started by."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.own: dict[str, NDArray[np.float64]] = defaultdict(lambda: np.zeros(2))
        self.common: dict[str, NDArray[np.float64]] = defaultdict(lambda: np.zeros(2))
        self.users: dict[str, set[str]] = defaultdict(set)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        for name, measured in report.user_properties:
            if name == PROPERTY:
                self.own[report.nodeid] += measured["own"]
                for fixture in measured["uses"]:
                    self.users[fixture].add(report.nodeid)
                for fixture, took in measured["common"].items():  # each process makes one
                    self.common[fixture] = np.maximum(self.common[fixture], took)
        report.user_properties = [pair for pair in report.user_properties if pair[0] != PROPERTY]

    def pytest_sessionfinish(self) -> None:
        write(self.durations(), self.file)

    def durations(self) -> dict[str, tuple[float, float]]:
        """Seconds of every test, of processors and by the clock, with its share of fixtures that others use too."""
        durations = {name: own.copy() for name, own in self.own.items()}
        for fixture, took in self.common.items():
            for user in self.users[fixture]:
                durations[user] += took / len(self.users[fixture])
        return {name: (float(took[0]), float(took[1])) for name, took in durations.items()}


def _name_of(fixturedef: Any) -> str:
    return f"{fixturedef.baseid}::{fixturedef.argname}"


def _common_of(item: pytest.Item) -> list[str]:
    """Fixtures of wider scope than a function that a test uses."""
    known = getattr(item, "_fixtureinfo", None)
    used = known.name2fixturedefs.values() if known else ()
    return [_name_of(definitions[-1]) for definitions in used if definitions[-1].scope != "function"]


def write(durations: dict[str, tuple[float, float]], file: Path) -> None:
    """Keep the slow and the long ones by name; of those that are not slow how many and how long they are together."""
    named = sorted(durations.items())
    slow = {name: round(processor_s, 1) for name, (processor_s, _) in named if processor_s > SLOW_S}
    long = {name: round(clock_s, 1) for name, (_, clock_s) in named if clock_s > LONG_S}
    quick = [processor_s for name, (processor_s, _) in named if name not in slow]
    found = {"quick": len(quick), "quick_s": round(sum(quick)), "slow": slow, "long": long}
    file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _recorded() -> dict[str, Any]:
    return json.loads(DURATIONS.read_text(encoding="utf-8"))


def _minutes(processor_s: float) -> str:
    return f"{max(round(processor_s / CORES / 60), 1)} min"


def spent_s() -> NDArray[np.float64]:
    """Processor time of this process and of all that it started, ended or not, and the clock."""
    own = os.times()
    living = _ticks_of_children(os.getpid()) / os.sysconf("SC_CLK_TCK")
    processor_s = own.user + own.system + own.children_user + own.children_system + living
    return np.array([processor_s, time.monotonic()])


def _ticks_of_children(process: int) -> int:
    """Processor time of a process's living children, and theirs; 0 where no /proc tells.

    Whoever waits for a child's end takes over what it used, so nothing counts twice, and nothing counts late.
    """
    ticks = 0
    for children in Path(f"/proc/{process}/task").glob("*/children"):
        with suppress(OSError):  # it has ended since
            for child in map(int, children.read_text().split()):
                fields = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
                ticks += sum(map(int, fields[11:15])) + _ticks_of_children(child)
    return ticks
