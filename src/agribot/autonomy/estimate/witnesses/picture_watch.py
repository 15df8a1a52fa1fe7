"""A camera that hands out one picture again and again, as USB cameras do when they hang."""

from __future__ import annotations

import math

from agribot.autonomy.estimate.filter.history import Motion
from agribot.core.facts import PictureFrozen
from agribot.core.messages import Scene

# Way after which equal pictures are stale: no two pictures of moving ground are alike to the last
# bit.
STALE_M = 0.05
TURNED_M_PER_RAD = 0.5  # a robot that turns on the spot sees other ground, too


class PictureWatch:
    """Call `is_stale` with every scene and where dead reckoning was at its capture."""

    def __init__(self) -> None:
        self._crc32 = 0
        self._first: Motion | None = None
        self.is_frozen = False

    def is_stale(self, scene: Scene, then: Motion | None) -> bool:
        """Whether its picture is one that was taken elsewhere; no picture number, no answer."""
        if scene.picture_crc32 == 0 or then is None:
            return False
        if scene.picture_crc32 != self._crc32 or self._first is None:
            self._crc32, self._first, self.is_frozen = scene.picture_crc32, then, False
            return False
        first = self._first
        way_m = math.hypot(then.x_m - first.x_m, then.y_m - first.y_m)
        way_m += TURNED_M_PER_RAD * abs(then.yaw_rad - first.yaw_rad)
        self.is_frozen = self.is_frozen or way_m >= STALE_M
        return self.is_frozen

    @property
    def fault(self) -> PictureFrozen | None:
        return PictureFrozen(STALE_M) if self.is_frozen else None
