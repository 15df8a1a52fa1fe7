"""Outlier gates that open again: one accepted outlier must not shut a sensor out for good."""

from __future__ import annotations

import math
from typing import Literal

Verdict = Literal["accept", "reject", "recover"]


class Gate:
    """Judges squared normalised innovations; after a run of rejections the filter is to blame.

    `outlier` is the name under which a rejection is counted, `recovery` that of the end of a run;
    empty where it is not counted.
    """

    def __init__(
        self, sigma: float, recover_after: float = math.inf, outlier: str = "", recovery: str = ""
    ) -> None:
        self.limit = sigma * sigma
        self.outlier, self.recovery = outlier, recovery
        self.rejected_in_a_row = 0
        self._recover_after = recover_after

    def evaluate(self, distance2: float) -> Verdict:
        if distance2 <= self.limit:
            self.rejected_in_a_row = 0
            return "accept"
        self.rejected_in_a_row += 1
        if self.rejected_in_a_row < self._recover_after:
            return "reject"
        self.rejected_in_a_row = 0
        return "recover"
