"""Ways that are worked out beside the control loop, and what is to become of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from agribot.core.errors import MissionError

T = TypeVar("T")
Work = Callable[[], Any]


class PlanningHost(Protocol):
    """Works one thing out at a time; what is asked anew takes the place of the old."""

    def ask(self, t_s: float, work: Work, latency_s: float) -> None:
        """Ask for an answer `latency_s` from now; never earlier, so that a run repeats."""
        ...

    def take(self, t_s: float) -> Work | None:
        """Give the answer, or raise what the work raised; None before its time."""
        ...


class PlanningAtOnce:
    """Planning in the tick itself: for what takes less than a tick, and for tests."""

    def __init__(self) -> None:
        self._work: Work | None = None

    def ask(self, t_s: float, work: Work, latency_s: float) -> None:
        self._work = work

    def take(self, t_s: float) -> Work | None:
        work, self._work = self._work, None
        return work


class PlanningDesk:
    """One question at a time to a host, with what to do with the answer or the refusal."""

    def __init__(self, host: PlanningHost) -> None:
        self._host = host
        self._then: Callable[[Any], None] | None = None
        self._refuse: Callable[[MissionError], None] = lambda _: None
        self._is_check = False

    @property
    def is_busy(self) -> bool:
        return self._then is not None

    @property
    def is_checking(self) -> bool:
        """Whether what is worked out is the check of a plan, not a way."""
        return self.is_busy and self._is_check

    def ask(
        self,
        t_s: float,
        work: Callable[[], T],
        latency_s: float,
        then: Callable[[T], None],
        refuse: Callable[[MissionError], None],
        *,
        is_check: bool = False,
    ) -> None:
        """Ask the host; without latency, `then` or `refuse` is called at once."""
        self._then, self._refuse, self._is_check = then, refuse, is_check
        self._host.ask(t_s, work, latency_s)
        self.look(t_s)

    def look(self, t_s: float) -> None:
        """Act on the answer once it is due, unless the question was dropped."""
        then = self._then
        answer = self._host.take(t_s) if then is not None else None
        if then is None or answer is None:
            return
        self._then = None
        try:
            found = answer()
        except MissionError as error:
            self._refuse(error)
        else:
            then(found)

    def drop(self) -> None:
        """Forget the question: something else is wanted now."""
        self._then = None
