"""What becomes of the requests that a mission hears: each with an id is answered once."""

from __future__ import annotations

from agribot.autonomy.plan.errand import Errand
from agribot.core.messages import OperatorEvent, RequestAnswer

MEANWHILE = "something else was asked of the robot meanwhile"


class Answers:
    """Those of this tick, and the two requests that may still be waiting for theirs.

    A way is planned where the robot stands, and a task is judged beside the loop: whoever asked
    for one is answered once it is settled, or once something else took its place.
    """

    def __init__(self) -> None:
        self._given: list[RequestAnswer] = []
        self._errand: Errand | None = None
        self._task: OperatorEvent | None = None

    def give(self, id: str, refusal: str = "") -> None:
        """Nobody waits for the answer to a request without an id."""
        if id:
            self._given.append(RequestAnswer(id=id, refusal=refusal))

    def replace_errand(self, errand: Errand) -> None:
        """From now on this one waits; whoever asked for another is answered."""
        self._drop_errand()
        self._errand = errand

    def settle_errand(self, errand: Errand, refusal: str = "") -> None:
        if errand is self._errand:
            self.give(errand.id, refusal)
            self._errand = None

    def await_task(self, event: OperatorEvent) -> None:
        self._task = event

    def settle_task(self, refusal: str = "") -> None:
        if self._task is not None:
            self.give(self._task.id, refusal)
            self._task = None

    def drop_task(self) -> None:
        if self._task is not None:
            self.settle_task(f"{self._task.action} refused: {MEANWHILE}")

    def take(self, asked: Errand | None) -> tuple[RequestAnswer, ...]:
        """All since the last call; `asked` is the errand that is still to be planned."""
        if self._errand is not asked:
            self._drop_errand()
        given, self._given = tuple(self._given), []
        return given

    def _drop_errand(self) -> None:
        if self._errand is not None:
            self.settle_errand(self._errand, f"{self._errand.refusal}: {MEANWHILE}")
