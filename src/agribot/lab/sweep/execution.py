"""Where runs happen: in processes of this machine, or on a Ray cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import msgspec

from agribot.app.run_folder import clear_run
from agribot.app.workers import Stop, results
from agribot.core.errors import AgribotError
from agribot.lab.sweep.plan import SweepJob
from agribot.lab.sweep.ray_cluster import RayCluster
from agribot.record.report import Report

if TYPE_CHECKING:
    from agribot.app.simulated_run import SimulatedRun

INTERRUPTED = "interrupted by the operator"


class Assignment(msgspec.Struct, frozen=True, kw_only=True):
    """A run and the folder for its files."""

    job: SweepJob
    out_dir: Path


class RunOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """The report of a run, or the reason why it is missing."""

    job: SweepJob
    report: Report | None = None
    error: str = ""


Work = Callable[[Assignment, Stop], RunOutcome | None]


class Executor(Protocol):
    def run(self, assignments: Sequence[Assignment], stop: Stop) -> Iterator[RunOutcome]:
        """Iterate over the outcomes; once `stop()` is true, only of runs that have begun."""


def drive(assignment: Assignment, stop: Stop) -> RunOutcome | None:
    """Drive one whole run, as `agribot run` does; None where it was stopped before its end."""
    return drive_run(assignment.job, partial(_begin, assignment), stop)


def drive_run(job: SweepJob, begin: Callable[[], SimulatedRun], stop: Stop) -> RunOutcome | None:
    """Drive the run that `begin` opens to its end; None where it was stopped before."""
    try:
        with begin() as session:
            for _ in session.ticks():
                if stop():
                    session.finish(INTERRUPTED)
                    return None
            return RunOutcome(job=job, report=session.finish())
    except AgribotError as error:
        return RunOutcome(job=job, error=str(error))


def _begin(assignment: Assignment) -> SimulatedRun:
    from agribot.app.simulated_run import simulate

    clear_run(assignment.out_dir)  # files of an interrupted sweep
    return simulate(assignment.job.config(), assignment.out_dir)


class ProcessExecutor:
    """`workers` processes that drive runs by `work`; a single worker is this process itself."""

    def __init__(self, workers: int, work: Work = drive) -> None:
        self._workers, self._work = workers, work

    def run(self, assignments: Sequence[Assignment], stop: Stop) -> Iterator[RunOutcome]:
        done = results(self._work, assignments, self._workers, stop)
        return (outcome for outcome in done if outcome is not None)


class RayExecutor:
    """A Ray cluster with agribot on every node; all of them write the folders of the runs."""

    def __init__(self, address: str) -> None:
        """Connect to the cluster.

        Raises: ConfigError: ray is not installed or the cluster does not answer.
        """
        self._cluster = RayCluster(address)

    def run(self, assignments: Sequence[Assignment], stop: Stop) -> Iterator[RunOutcome]:
        for each in self._cluster.results(_drive_to_the_end, assignments, stop):
            yield each.result or RunOutcome(job=each.job.job, error=each.error)


def _drive_to_the_end(assignment: Assignment) -> RunOutcome:
    outcome = drive(assignment, lambda: False)
    assert outcome is not None  # nothing stops it
    return outcome
