"""When plants that fit no row speak against the pose, and when only against themselves."""

from __future__ import annotations

import math

# Sightings, and share of the last ones, that must agree on the offset of the rows: weeds taken for
# crop stand anywhere, and any offset fits a quarter of them by chance.
NEEDED = 8
MAJORITY_RATIO = 0.7
AGREEMENT_M = 0.12
# Least distance of two plants: one weed taken for a crop is seen in thirty frames.
APART_M = 0.4
MEMORY = 40


class Contradiction:
    """Collects sightings that fit no row until several plants show the same offset.

    A single plant out of place never overrules the pose, however often it is seen. A plant that
    fits takes the weight off what was collected before.
    """

    def __init__(self) -> None:
        self._seen: list[tuple[float, float, float]] = []

    def settle(self) -> None:
        del self._seen[: 1 + len(self._seen) // 2]

    def add(self, along_m: float, right_m: float, off_m: float) -> float | None:
        """Give the offset that the plants agree on, once they do; None until then."""
        self._seen.append((along_m, right_m, off_m))
        del self._seen[:-MEMORY]
        agreeing = [seen for seen in self._seen if abs(seen[2] - off_m) <= AGREEMENT_M]
        apart = any(math.dist(seen[:2], (along_m, right_m)) >= APART_M for seen in agreeing)
        needed = max(NEEDED, MAJORITY_RATIO * len(self._seen))
        if len(agreeing) < needed or not apart:
            return None
        self._seen.clear()
        return sum(seen[2] for seen in agreeing) / len(agreeing)
