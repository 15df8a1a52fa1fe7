"""One function over many jobs, here or in other processes: results one by one, a clean stop.

A worker process ends with its parent, also when that one is killed.
"""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import multiprocessing.synchronize
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from agribot.core.signals import ignore_interrupts

JobT = TypeVar("JobT")
ResultT = TypeVar("ResultT")
Stop = Callable[[], bool]
POLL_S = 0.2

_stop_event: multiprocessing.synchronize.Event | None = None


def usable_cpus() -> int:
    """CPUs that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def results(
    work: Callable[[JobT, Stop], ResultT], jobs: Sequence[JobT], workers: int, stop: Stop
) -> Iterator[ResultT]:
    """Results of `work(job, stop)` in the order in which they are ready.

    Once `stop()` is true no further job starts, and running ones see it in the `stop` that they
    were given. `work` stands at the top of a module and its jobs can be pickled.

    Raises: whatever `work` raises, and BrokenProcessPool where a process was ended from outside.
    """
    if workers == 1 or len(jobs) <= 1:
        for job in jobs:
            if stop():
                return
            yield work(job, stop)
        return
    yield from _results_of_processes(work, jobs, min(workers, len(jobs)), stop)


def _results_of_processes(
    work: Callable[[JobT, Stop], ResultT], jobs: Sequence[JobT], workers: int, stop: Stop
) -> Iterator[ResultT]:
    context = multiprocessing.get_context("spawn")
    event = context.Event()
    waiting, running = list(reversed(jobs)), set[Future[ResultT]]()
    with ProcessPoolExecutor(workers, context, _enter_worker, (event,)) as pool:
        try:
            while waiting or running:
                if stop():
                    event.set()
                    waiting.clear()
                while waiting and len(running) < workers:
                    running.add(pool.submit(_work_until_stopped, work, waiting.pop()))
                done, running = wait(running, POLL_S, FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        except BrokenProcessPool:
            if not stop():  # else the signal that stops this process has ended the others, too
                raise
        finally:
            event.set()


def _enter_worker(event: multiprocessing.synchronize.Event) -> None:
    global _stop_event  # noqa: PLW0603  (one per worker process, set before its first job)
    _stop_event = event
    ignore_interrupts()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


def _work_until_stopped(work: Callable[[Any, Stop], ResultT], job: Any) -> ResultT:
    event = _stop_event
    assert event is not None  # _enter_worker has run
    return work(job, event.is_set)
