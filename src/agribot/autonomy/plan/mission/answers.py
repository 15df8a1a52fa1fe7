"""What becomes of the requests that a mission hears: each with an id is answered once."""

from __future__ import annotations

from agribot.autonomy.plan.mission.errand import Errand
from agribot.autonomy.plan.mission.states import State, Stopping
from agribot.core.fact_text import render
from agribot.core.facts import AnyFact, AskedElse, ErrandRefused
from agribot.core.messages import AnyRequest, RequestAnswer


class Answers:
    """Those of this tick, and the two requests that may still be waiting for theirs.

    The way of an errand is planned once the robot stands, and a field plan is checked beside the
    loop: the client is answered when the request is settled or replaced.
    """

    def __init__(self) -> None:
        self._given: list[RequestAnswer] = []
        self._open: AnyRequest | None = None  # the request that is being heard
        self._errand: tuple[Errand, AnyRequest] | None = None
        self._check: AnyRequest | None = None

    def open(self, request: AnyRequest) -> None:
        self._open = request

    def close(self, refusal: AnyFact | None) -> None:
        """Answer the request that was heard, unless it waits for its answer."""
        if self._open is not None:
            self._give(self._open, refusal)
            self._open = None

    def await_errand(self, errand: Errand) -> None:
        """Note that the request in hand asked for it, if one is."""
        self.drop_errand()
        if self._open is not None:
            self._errand, self._open = (errand, self._open), None

    def settle_errand(self, refusal: AnyFact | None = None) -> None:
        if self._errand is not None:
            self._give(self._errand[1], refusal)
            self._errand = None

    def drop_errand(self) -> None:
        if self._errand is not None:
            self.settle_errand(ErrandRefused(self._errand[0].kind.value, AskedElse()))

    def await_check(self) -> None:
        self._check, self._open = self._open, None

    def settle_check(self, refusal: AnyFact | None = None) -> None:
        if self._check is not None:
            self._give(self._check, refusal)
            self._check = None

    def take(self, state: State) -> tuple[RequestAnswer, ...]:
        """All since the last call. An errand that the state does not wait for was given up."""
        if self._errand is not None:
            is_waiting = isinstance(state, Stopping) and state.errand is self._errand[0]
            if not is_waiting:
                self.drop_errand()
        given, self._given = tuple(self._given), []
        return given

    def _give(self, request: AnyRequest, refusal: AnyFact | None) -> None:
        """Answer a request; one without an id needs no answer."""
        if request.id:
            answer = RequestAnswer(id=request.id, refusal=render(refusal), fact=refusal)
            self._given.append(answer)
