"""Jobs in other processes: an end from outside is reported unless it was asked for."""

from __future__ import annotations

import os
import signal
from concurrent.futures.process import BrokenProcessPool
from itertools import count

import pytest

from agribot.app.workers import Stop, results


def be_ended(job: int, stop: Stop) -> int:
    """As a terminal or `timeout` does, whose signal reaches all processes of the group."""
    os.kill(os.getpid(), signal.SIGTERM)
    return job


def test_processes_that_the_stop_has_ended_give_no_results_and_no_error() -> None:
    asked = count()
    assert list(results(be_ended, [1, 2], 2, lambda: next(asked) > 0)) == []


def test_a_process_that_is_ended_while_the_work_goes_on_is_an_error() -> None:
    with pytest.raises(BrokenProcessPool):
        list(results(be_ended, [1, 2], 2, lambda: False))
