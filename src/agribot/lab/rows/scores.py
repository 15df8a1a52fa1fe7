"""How a network names plants on crop rows and between them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.rows.labelled import Regions

NAMES = ("crop", "weed", "soil")
ORDER = [int(PlantClass.CROP), int(PlantClass.WEED), int(PlantClass.SOIL)]

Counts = npt.NDArray[np.int64]
Shares = dict[str, float | None]


class NameScores:
    """Pixels of plants by what the network calls them: `add` picture by picture."""

    def __init__(self) -> None:
        self.on_rows: Counts = np.zeros(len(NAMES), dtype=np.int64)
        self.between_rows: Counts = np.zeros(len(NAMES), dtype=np.int64)

    def add(self, regions: Regions, class_id: ByteArray) -> None:
        """Count the classes (SIDE_PX, SIDE_PX) of a picture."""
        self.on_rows += _count(class_id[regions.on_rows])
        self.between_rows += _count(class_id[regions.between_rows])

    def merge(self, other: NameScores) -> None:
        """Add the pixels of other pictures."""
        self.on_rows += other.on_rows
        self.between_rows += other.between_rows

    @property
    def balanced(self) -> float | None:
        """Mean of crop on rows and weed between them; 0.5 where every plant is called crop."""
        crop, weed = share(self.on_rows)["crop"], share(self.between_rows)["weed"]
        return None if crop is None or weed is None else (crop + weed) / 2.0

    @property
    def right_ratio(self) -> float | None:
        """Share of the judged pixels that have the right name."""
        judged = int(self.on_rows.sum() + self.between_rows.sum())
        return int(self.on_rows[0] + self.between_rows[1]) / judged if judged else None

    @property
    def wrong_px(self) -> int:
        """Judged pixels with a wrong name."""
        right = self.on_rows[0] + self.between_rows[1]
        return int(self.on_rows.sum() + self.between_rows.sum() - right)


def share(counts: Counts) -> Shares:
    """Divide counts by their sum; None where nothing was counted."""
    total = int(counts.sum())
    return {
        name: int(count) / total if total else None
        for name, count in zip(NAMES, counts, strict=True)
    }


def _count(class_id: ByteArray) -> Counts:
    return np.bincount(class_id, minlength=len(PlantClass))[ORDER].astype(np.int64)
