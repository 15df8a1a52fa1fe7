"""Shared rules of the suite: what a machine lacks is skipped in words and counted at the end.

A worker computes on one core, as do the processes that it starts: threads of several workers
would wait for each other on the same cores, and burn them. A fifth of the time it waits for a
clock, a line or a browser, so that there are two workers more than cores, up to four.

Where a machine must run everything (AGRIBOT_REQUIRE_ALL=1), a skip is a failure. Not so for tests
marked `elsewhere`: they need what no package manager of that machine has, such as an installed
ROS 2. With AGRIBOT_REQUIRE_ALL=but-programs, for a bare machine, a test may lack a program.
"""

from __future__ import annotations

import gc
import os
from collections import Counter
from collections.abc import Generator
from pathlib import Path

import hypothesis
import pytest
from _pytest.terminal import TerminalReporter

from tests.outcomes import HAS_FAILED

os.environ.setdefault("OMP_NUM_THREADS", "1")  # read when numpy or torch is imported
# No example has to be done within a time: a busy machine takes longer.
hypothesis.settings.register_profile("suite", deadline=None)
hypothesis.settings.load_profile("suite")

pytest_plugins = [
    "tests.compiled_once",
    "tests.cpu_times",
    "tests.askers",
    "tests.figures",
    "tests.second_chance",
    "tests.time_limit",
    "tests.nightly_results",
]


WAITING = {"drivers", "ros", "ui"}  # folders of tests


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
    """Leave the cases marked `nightly` to `pytest -m nightly`, and order the others."""
    order = rank_files(items)
    items.sort(key=lambda item: order[item.path])
    if "nightly" in config.getoption("markexpr"):
        return
    left_out = [item for item in items if item.get_closest_marker("nightly")]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if not item.get_closest_marker("nightly")]


def rank_files(items: list[pytest.Item]) -> dict[Path, float]:
    """Rank the files of tests; the lowest begin.

    Files that hold `slow` tests begin, so that no worker ends alone with one of them. Those that
    wait for a line or a browser are spread among those that compute, which fill their pauses.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    ranks = dict.fromkeys(slow, -1.0)
    others = [path for path in dict.fromkeys(item.path for item in items) if path not in slow]
    for waits in (True, False):
        files = [path for path in others if WAITING.isdisjoint(path.parts) is not waits]
        ranks |= {path: (number + 0.5) / len(files) for number, path in enumerate(files)}
    return ranks


def pytest_collection() -> None:
    gc.disable()


def pytest_collection_finish() -> None:
    """Leave modules and tests, which stay to the end, out of Python's searches for garbage."""
    gc.collect()
    gc.freeze()
    gc.enable()


def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    """Count the skipped tests by what is missing."""
    reasons = Counter(
        report.longrepr[2].removeprefix("Skipped: ")
        for report in terminalreporter.stats.get("skipped", ())
        if isinstance(report.longrepr, tuple)
    )
    for reason, count in reasons.most_common():
        terminalreporter.write_line(f"{count} test{'s' * (count > 1)} skipped: {reason}")
