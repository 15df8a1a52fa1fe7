"""One function over many jobs on a Ray cluster, with agribot on every node."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

from agribot.app.workers import Stop
from agribot.core.errors import ConfigError
from agribot.core.extras import format_install

JobT = TypeVar("JobT")
ResultT = TypeVar("ResultT")
POLL_S = 0.5
ANSWERS_WITHIN_S = 5.0


class NodeResult(NamedTuple, Generic[JobT, ResultT]):
    """The result of a job, or why its node gave none."""

    job: JobT
    result: ResultT | None
    error: str = ""


class RayCluster:
    """A cluster that has answered."""

    def __init__(self, address: str) -> None:
        """Connect to the cluster.

        Raises: ConfigError: ray is not installed or the cluster does not answer.
        """
        self._ray = _import_ray()
        try:
            _expect_answer(address)
            self._ray.init(address=address)
        except (OSError, RuntimeError, ValueError) as error:
            raise ConfigError(
                f"no Ray cluster answers at {address}: {error}; start one with `ray start --head` "
                "and give its address, or leave out --ray"
            ) from error

    def results(
        self, work: Callable[[JobT], ResultT], jobs: Sequence[JobT], stop: Stop
    ) -> Iterator[NodeResult[JobT, ResultT]]:
        """Results of `work(job)` in the order in which they are ready; none after `stop()`."""
        remote = self._ray.remote(work)
        running = {remote.remote(job): job for job in jobs}
        while running:
            if stop():
                for reference in running:
                    self._ray.cancel(reference)
                return
            done, _ = self._ray.wait(list(running), num_returns=1, timeout=POLL_S)
            for reference in done:
                yield self._await(reference, running.pop(reference))

    def _await(self, reference: Any, job: JobT) -> NodeResult[JobT, ResultT]:
        try:
            result: ResultT = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:  # the node, its memory or its installation
            return NodeResult(job, None, f"its node failed: {str(error).splitlines()[-1]}")
        return NodeResult(job, result)


def _expect_answer(address: str) -> None:
    """Refuse an address without an answer; Ray tries for minutes and then ends the process.

    Raises: OSError: nothing listens at HOST:PORT; other addresses are left to Ray.
    """
    host, _, port = address.rpartition(":")
    if host and "/" not in address and port.isdigit():
        socket.create_connection((host, int(port)), ANSWERS_WITHIN_S).close()


def _import_ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise ConfigError(
            f"--ray needs the package ray, which is not installed; {format_install('sweep')}, or "
            "leave out --ray to use the processes of this machine"
        ) from error
    return ray
