"""Where ways are worked out: a thread beside the control loop, with answers at fixed times.

The answer counts a fixed time after the question, whatever the core does meanwhile: a simulated
run repeats bit by bit, and so does a replay. The loop waits only for an answer that is late.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from agribot.autonomy.plan.planning import PlanningAtOnce, Work


class ThreadedPlanning:
    """Questions without latency are small and answered in the tick, all others by the thread."""

    def __init__(self) -> None:
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
        self._answer = None
        return future.result

    def close(self) -> None:
        self._worker.shutdown(wait=True, cancel_futures=True)
