"""Shared rules of the suite: where a machine must run everything, a skip is a failure.

Not so for tests marked `elsewhere`: they need what no package manager of that machine has, such
as an installed ROS 2.
"""

from __future__ import annotations

import os
from collections.abc import Generator

import pytest


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    is_expected = hasattr(report, "wasxfail") or item.get_closest_marker("elsewhere")
    if report.skipped and not is_expected and os.environ.get("AGRIBOT_REQUIRE_ALL"):
        report.outcome = "failed"
        report.longrepr = f"skipped, but AGRIBOT_REQUIRE_ALL is set: {report.longrepr}"
    return report
