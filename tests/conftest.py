"""Shared rules of the suite: what a machine lacks is skipped in words and counted at the end.

A worker computes on one core, as do the processes that it starts: threads of several workers
would wait for each other on the same cores, and burn them. A fifth of the time it waits for a
clock, a line or a browser, so that there is one worker more than there are cores.

Where a machine must run everything (AGRIBOT_REQUIRE_ALL=1), a skip is a failure. Not so for tests
marked `elsewhere`: they need what no package manager of that machine has, such as an installed
ROS 2. With AGRIBOT_REQUIRE_ALL=but-programs, for a bare machine, a test may lack a program.
"""

from __future__ import annotations

import gc
import os
from collections import Counter
from collections.abc import Generator

import pytest
from _pytest.terminal import TerminalReporter

from tests.outcomes import HAS_FAILED

os.environ.setdefault("OMP_NUM_THREADS", "1")  # read when numpy or torch is imported

pytest_plugins = [
    "tests.cpu_times",
    "tests.askers",
    "tests.figures",
    "tests.second_chance",
    "tests.nightly_results",
]


def pytest_xdist_auto_num_workers() -> int:
    """Of `-n auto`; more would not find room in the memory of a small machine."""
    return min((os.cpu_count() or 1) + 2, 4)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed:
        item.stash[HAS_FAILED] = True
    is_expected = hasattr(report, "wasxfail") or item.get_closest_marker("elsewhere")
    if report.skipped and not is_expected and not may_lack(str(report.longrepr)):
        report.outcome = "failed"
        report.longrepr = f"skipped, but AGRIBOT_REQUIRE_ALL is set: {report.longrepr}"
    return report


def may_lack(reason: str) -> bool:
    """Whether this machine may skip a test for this reason."""
    required = os.environ.get("AGRIBOT_REQUIRE_ALL", "")
    return not required or (required == "but-programs" and "apt-get install" in reason)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with the files that hold `slow` tests, so that no worker ends alone with one of them.

    The cases marked `nightly` are left to those who ask for them: `pytest -m nightly`.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)
    if "nightly" in config.getoption("markexpr"):
        return
    left_out = [item for item in items if item.get_closest_marker("nightly")]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if not item.get_closest_marker("nightly")]


def pytest_collection_finish() -> None:
    """Leave modules and tests, which stay to the end, out of Python's searches for garbage."""
    gc.collect()
    gc.freeze()


def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    """Count the skipped tests by what is missing."""
    reasons = Counter(
        report.longrepr[2].removeprefix("Skipped: ")
        for report in terminalreporter.stats.get("skipped", ())
        if isinstance(report.longrepr, tuple)
    )
    for reason, count in reasons.most_common():
        terminalreporter.write_line(f"{count} test{'s' * (count > 1)} skipped: {reason}")
