"""The CPU time of each test, with all processes that it started: `pytest --cpu-times 20`.

Wall time depends on how busy the machine was; CPU time is what a test costs on any day. A fixture
is paid by the test that set it up or took it down. Processes are found in /proc, so elsewhere
than on Linux only those count that have ended. The time of a process without a waiting parent, as
those of a browser, is in the sum of the phases, and in no figure of the kernel once it has ended.
"""

from __future__ import annotations

import os
from collections.abc import Generator

import pytest
from _pytest.terminal import TerminalReporter

from tests.processes import find_descendants

OUTSIDE = "outside of tests: imports, collection, workers"
FIRST_TIME, AFTER_TIMES = 11, 15  # fields of /proc/PID/stat behind the name
TICKS_PER_S = float(os.sysconf("SC_CLK_TCK"))
PROPERTY = "cpu_s"  # of a report; so it travels from a worker
LAST, SPENT = pytest.StashKey[float](), pytest.StashKey[float]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--cpu-times",
        type=int,
        metavar="N",
        help="show the N phases of tests that took most CPU time, and the sum (0: all phases)",
    )


def is_wanted(config: pytest.Config) -> bool:
    return config.getoption("--cpu-times") is not None


def cpu_s() -> float:
    """CPU time of this process and its descendants, both those that live and those waited for."""
    own = os.times()
    return sum(own[:4]) + sum(living_descendants_s(os.getpid()))


def living_descendants_s(pid: int) -> list[float]:
    return [
        sum(map(int, fields[FIRST_TIME:AFTER_TIMES])) / TICKS_PER_S
        for fields in find_descendants(pid).values()
    ]


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, None, None]:
    return (yield from measure(item))


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    return (yield from measure(item))


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, None, None]:
    return (yield from measure(item))


def measure(item: pytest.Item) -> Generator[None, None, None]:
    if not is_wanted(item.config):
        return (yield)
    before_s = item.config.stash.get(LAST, None) or cpu_s()
    try:
        return (yield)
    finally:
        now_s = item.config.stash[LAST] = cpu_s()
        item.stash[SPENT] = max(0.0, now_s - before_s)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    report.user_properties.append((PROPERTY, item.stash.get(SPENT, 0.0)))
    return report


def spent_s(report: pytest.TestReport) -> float:
    value = dict(report.user_properties).get(PROPERTY)
    return value if isinstance(value, float) else 0.0


def pytest_terminal_summary(terminalreporter: TerminalReporter, config: pytest.Config) -> None:
    """Show the dearest phases and the sum."""
    if not is_wanted(config):
        return
    phases = {
        f"{report.when:8} {report.nodeid}": spent_s(report)
        for reports in terminalreporter.stats.values()
        for report in reports
        if isinstance(report, pytest.TestReport)
    }
    inside_s = sum(phases.values())
    outside_s = max(0.0, cpu_s() - inside_s)
    terminalreporter.section("CPU time")
    count = config.getoption("--cpu-times") or None
    for name, taken_s in sorted(phases.items(), key=lambda phase: -phase[1])[:count]:
        terminalreporter.write_line(f"{taken_s:8.2f} s {name}")
    terminalreporter.write_line(f"{outside_s:8.2f} s {OUTSIDE}")
    terminalreporter.write_line(f"{inside_s + outside_s:8.2f} s in all")
