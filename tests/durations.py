"""How long tests take, and which of them are slow; ``make test`` leaves these out.

A test is slow if it took more than ``SLOW_S`` seconds of processor time when durations were last recorded, with its
share of the fixtures that several tests use. ``make durations`` runs all tests and records them in ``durations.json``;
nobody writes there by hand. Processor time is what a test takes whatever else the machine does.
"""

from __future__ import annotations

import json
import os
from collections import Counter, defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Generator

DURATIONS = Path(__file__).with_name("durations.json")
SLOW_S = 1.0
QUICK = "not slow"
"""The marker expression of ``make test``."""
CORES = 2
COMPILING_S = 120.0
"""Processor time that the kernels take to compile, when tests run for the first time."""
PROPERTY = "processor_s"


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
    """Measures processor time in the process that runs a test, and hands it on with the test's reports."""

    def __init__(self) -> None:
        self._began = 0.0
        self._common: dict[str, float] = {}
        """What fixtures that several tests use took in this phase."""

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Generator[None, Any, Any]:
        if fixturedef.scope == "function":
            return (yield)
        began, within = processor_s(), sum(self._common.values())
        try:
            return (yield)
        finally:
            within = sum(self._common.values()) - within  # fixtures that it asked for count by themselves
            self._common[_name_of(fixturedef)] = processor_s() - began - within

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self) -> Generator[None, Any, Any]:
        self._began, self._common = processor_s(), {}
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Generator[None, Any, Any]:
        report = yield
        now = processor_s()
        own = now - self._began - sum(self._common.values())
        report.user_properties.append(
            (PROPERTY, {"own": own, "common": self._common, "uses": _common_of(item)})
        )
        self._began, self._common = now, {}
        return report


class Record:
    """Collects what ``Meter`` measured, in the process that the tests were started by."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.own: dict[str, float] = defaultdict(float)
        self.common: dict[str, float] = defaultdict(float)
        self.users: dict[str, set[str]] = defaultdict(set)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        for name, measured in report.user_properties:
            if name == PROPERTY:
                self.own[report.nodeid] += measured["own"]
                for fixture in measured["uses"]:
                    self.users[fixture].add(report.nodeid)
                for fixture, took_s in measured["common"].items():  # each process makes one
                    self.common[fixture] = max(self.common[fixture], took_s)
        report.user_properties = [pair for pair in report.user_properties if pair[0] != PROPERTY]

    def pytest_sessionfinish(self) -> None:
        write(self.durations(), self.file)

    def durations(self) -> dict[str, float]:
        """Seconds of every test, with its share of the fixtures that it uses with others."""
        durations = dict(self.own)
        for fixture, took_s in self.common.items():
            for user in self.users[fixture]:
                durations[user] += took_s / len(self.users[fixture])
        return durations


def _name_of(fixturedef: Any) -> str:
    return f"{fixturedef.baseid}::{fixturedef.argname}"


def _common_of(item: pytest.Item) -> list[str]:
    """Fixtures of wider scope than a function that a test uses."""
    known = getattr(item, "_fixtureinfo", None)
    used = known.name2fixturedefs.values() if known else ()
    return [_name_of(definitions[-1]) for definitions in used if definitions[-1].scope != "function"]


def write(durations: dict[str, float], file: Path) -> None:
    """Keep the slow ones by name; of the others how many they are and how long they take together."""
    slow = {name: round(took, 1) for name, took in sorted(durations.items()) if took > SLOW_S}
    quick = [took for name, took in durations.items() if name not in slow]
    found = {"quick": len(quick), "quick_s": round(sum(quick)), "slow": slow}
    file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _recorded() -> dict[str, Any]:
    return json.loads(DURATIONS.read_text(encoding="utf-8"))


def _minutes(processor_s: float) -> str:
    return f"{max(round(processor_s / CORES / 60), 1)} min"


def processor_s() -> float:
    """Of this process and of those that it started and that have ended."""
    found = os.times()
    return found.user + found.system + found.children_user + found.children_system
