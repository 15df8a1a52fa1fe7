"""Figures of a report are drawn where a test looks at them, or at how they come to the disk.

A run draws eight of them at its end, for 0.7 CPU seconds, and most tests of runs read only numbers.
A test, or a file of them, that looks at report.html or map.png has the mark `figures`; so have some
whose runs leave odd data to draw.
"""

from __future__ import annotations

from collections.abc import Generator

import pytest


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Around the whole test, so that it holds for fixtures of any scope that the test sets up."""
    if item.get_closest_marker("figures"):
        return (yield)
    from agribot.record import run_files

    with pytest.MonkeyPatch.context() as patch:
        for name in ("write_page", "write_map"):
            patch.setattr(run_files, name, _leave_out)
        return (yield)


def _leave_out(*_: object) -> None:
    """Write nothing, as where nothing draws."""
