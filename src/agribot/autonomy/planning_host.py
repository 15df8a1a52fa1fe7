"""Where ways are worked out: a thread beside the control loop, with answers at fixed times.

The answer counts a fixed time after the question, whatever the core does meanwhile: a simulated
run repeats bit by bit, and so does a replay. For an answer that is late a simulation waits. A real
robot does not: it goes on without, and its recording says in which ticks it did.
"""

from __future__ import annotations

from collections.abc import Container
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from agribot.autonomy.plan.mission.planning import PlanningAtOnce, Work


class ThreadedPlanning:
    """Questions without latency are small and answered in the tick, all others by the thread.

    `waits` says that time stands still meanwhile. `late_s` are the times of recorded ticks in which
    an answer was late; there it is so again.
    """

    def __init__(self, *, waits: bool = True, late_s: Container[float] = ()) -> None:
        self._waits, self._late_s = waits, late_s
        self._is_late = False
        self._at_once = PlanningAtOnce()
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="planning")
        self._answer: tuple[float, Future[Any]] | None = None

    def ask(self, t_s: float, work: Work, latency_s: float) -> None:
        if self._answer is not None:
            self._answer[1].cancel()
            self._answer = None
        if latency_s <= 0.0:
            self._at_once.ask(t_s, work, latency_s)
        else:
            self._answer = (t_s + latency_s, self._worker.submit(work))

    def take(self, t_s: float) -> Work | None:
        if self._answer is None:
            return self._at_once.take(t_s)
        ready_s, future = self._answer
        if t_s < ready_s - 1e-9:
            return None
        if t_s in self._late_s or not (self._waits or future.done()):
            self._is_late = True
            return None
        self._answer = None
        return future.result

    def pop_late(self) -> bool:
        """Return whether an answer was late since the last call."""
        is_late, self._is_late = self._is_late, False
        return is_late

    def close(self) -> None:
        self._worker.shutdown(wait=self._waits, cancel_futures=True)
