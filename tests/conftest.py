"""Shared rules of the suite: where a machine must run everything, a skip is a failure."""

from __future__ import annotations

import os
from collections.abc import Generator

import pytest


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.skipped and not hasattr(report, "wasxfail") and os.environ.get("AGRIBOT_REQUIRE_ALL"):
        report.outcome = "failed"
        report.longrepr = f"skipped, but AGRIBOT_REQUIRE_ALL is set: {report.longrepr}"
    return report
