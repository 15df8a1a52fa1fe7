"""Where runs happen: in processes of this machine, or on a Ray cluster."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import msgspec

from agribot.app.run_folder import clear_run
from agribot.app.workers import Stop, results
from agribot.core.errors import AgribotError, ConfigError
from agribot.lab.sweep.plan import Job
from agribot.record.report import Report

INTERRUPTED = "interrupted by the operator"
RAY_POLL_S = 0.5
RAY_ANSWERS_WITHIN_S = 5.0


class Assignment(msgspec.Struct, frozen=True, kw_only=True):
    """A run and the folder for its files."""

    job: Job
    out_dir: Path


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """What came of a run: its report, or why there is none."""

    job: Job
    report: Report | None = None
    error: str = ""


class Executor(Protocol):
    def run(self, assignments: Sequence[Assignment], stop: Stop) -> Iterator[Outcome]:
        """Outcomes as they come; once `stop()` is true, only those of runs under way, if any."""


def drive(assignment: Assignment, stop: Stop) -> Outcome | None:
    """One whole run, as `agribot run` does it; None where it was stopped before its end."""
    from agribot.app.simulated_run import simulate

    try:
        clear_run(assignment.out_dir)  # what an interrupted sweep left
        with simulate(assignment.job.config(), assignment.out_dir) as session:
            for _ in session.ticks():
                if stop():
                    session.finish(INTERRUPTED)
                    return None
            return Outcome(job=assignment.job, report=session.finish())
    except AgribotError as error:
        return Outcome(job=assignment.job, error=str(error))


class ProcessExecutor:
    """`workers` processes; one worker is this process itself."""

    def __init__(self, workers: int) -> None:
        self._workers = workers

    def run(self, assignments: Sequence[Assignment], stop: Stop) -> Iterator[Outcome]:
        done = results(drive, assignments, self._workers, stop)
        return (outcome for outcome in done if outcome is not None)


class RayExecutor:
    """A Ray cluster with agribot on every node; all of them write the folders of the runs."""

    def __init__(self, address: str) -> None:
        """Raises: ConfigError: ray is not installed or the cluster does not answer."""
        self._ray = _import_ray()
        try:
            _expect_answer(address)
            self._ray.init(address=address)
        except (OSError, RuntimeError, ValueError) as error:
            raise ConfigError(
                f"no Ray cluster answers at {address}: {error}; start one with `ray start --head` "
                "and give its address, or leave out --ray"
            ) from error

    def run(self, assignments: Sequence[Assignment], stop: Stop) -> Iterator[Outcome]:
        remote = self._ray.remote(_drive_to_the_end)
        running = {remote.remote(assignment): assignment.job for assignment in assignments}
        while running:
            if stop():
                for reference in running:
                    self._ray.cancel(reference)
                return
            done, _ = self._ray.wait(list(running), num_returns=1, timeout=RAY_POLL_S)
            for reference in done:
                yield self._outcome(reference, running.pop(reference))

    def _outcome(self, reference: Any, job: Job) -> Outcome:
        try:
            outcome: Outcome = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:  # the node, its memory or its installation
            return Outcome(job=job, error=f"its node failed: {str(error).splitlines()[-1]}")
        return outcome


def _expect_answer(address: str) -> None:
    """Ray itself tries for minutes, and ends the process when it gives up.

    Raises: OSError: nothing listens at HOST:PORT; other addresses are left to Ray.
    """
    host, _, port = address.rpartition(":")
    if host and "/" not in address and port.isdigit():
        socket.create_connection((host, int(port)), RAY_ANSWERS_WITHIN_S).close()


def _drive_to_the_end(assignment: Assignment) -> Outcome:
    outcome = drive(assignment, lambda: False)
    assert outcome is not None  # nothing stops it
    return outcome


def _import_ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise ConfigError(
            "--ray needs the package ray, which is not installed; pip install 'agribot[sweep]', or "
            "leave out --ray to use the processes of this machine"
        ) from error
    return ray
