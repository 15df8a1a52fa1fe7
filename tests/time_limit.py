"""No test waits without end: each of its phases is interrupted, and fails, at a limit."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from types import FrameType

import pytest

# Limits of a phase, wall s: five waits of `tests/waiting.py`, and several nights' longest test.
BY_DAY_S, BY_NIGHT_S = 900.0, 14400.0


@contextmanager
def limited(limit_s: float) -> Iterator[None]:
    """Interrupt the main thread after a time."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        pytest.fail(f"not over after {limit_s:g} s; give what it waits for a limit")

    if threading.current_thread() is not threading.main_thread():
        yield  # signals reach the main thread alone
        return
    before = signal.signal(signal.SIGALRM, interrupt)
    left_s, _ = signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, left_s)
        signal.signal(signal.SIGALRM, before)


def _limit(item: pytest.Item) -> Generator[None, None, None]:
    with limited(BY_NIGHT_S if item.get_closest_marker("nightly") else BY_DAY_S):
        return (yield)


pytest_runtest_setup = pytest.hookimpl(wrapper=True)(_limit)
pytest_runtest_call = pytest.hookimpl(wrapper=True)(_limit)
pytest_runtest_teardown = pytest.hookimpl(wrapper=True)(_limit)
