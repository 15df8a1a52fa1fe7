"""The best network of a training until now, by the score of a judge."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Any

from torch import Tensor, nn

# Figures from 0 to 1 by name, the more the better, of a network on pictures set aside for that.
Judgement = dict[str, float]
Judge = Callable[[nn.Module], Judgement]


def compute_score(judged: Judgement) -> float:
    """Make one number of all figures: their mean."""
    return math.fsum(judged.values()) / len(judged)


class BestSoFar:
    """The weights with the highest score; `step` is None before the first was judged."""

    def __init__(self) -> None:
        self.step: int | None = None
        self.score = -math.inf
        self._weights: dict[str, Tensor] | None = None

    def consider(self, judged: Judgement, step: int, network: nn.Module) -> None:
        """Keep the weights of `network` if they are better than those before; of equals the later.

        A score that is no number is worse than any.
        """
        score = compute_score(judged)
        if score >= self.score:
            self.step, self.score = step, score
            self._weights = copy.deepcopy(network.state_dict())

    def give_back(self, network: nn.Module) -> None:
        """Give `network` the best weights; it stays as it is where none were judged."""
        if self._weights is not None:
            network.load_state_dict(self._weights)

    def to_state(self) -> dict[str, Any]:
        return {"step": self.step, "score": self.score, "weights": self._weights}

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> BestSoFar:
        best = cls()
        if state:
            best.step, best.score, best._weights = state["step"], state["score"], state["weights"]
        return best
