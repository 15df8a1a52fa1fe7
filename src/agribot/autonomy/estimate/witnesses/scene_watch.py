"""A camera that is off, a network that hangs, and pictures that come late."""

from __future__ import annotations

import math

from agribot.core.facts import NoPicture, PicturesComeLate
from agribot.core.messages import Scene

# Longest silence of a camera: at ten pictures a second or more it is no drop-out, and a robot at
# 0.4 m/s has driven half of what its last picture showed.
SILENT_S, MISSING = 1.5, 3.0  # in pictures for a slower one
# Later than the network promises: at 0.4 m/s a weed is then 8 cm from where the nozzle opens.
LATE_S, LATE_PICTURES = 0.2, 5


class SceneWatch:
    """Call `hear` with every scene and the time at which it came.

    A camera is in use from its first picture on; a robot without one gets no report.
    """

    def __init__(self) -> None:
        self._heard_s = math.inf  # when the last scene came, not when it was taken
        self._interval_s = math.inf
        self._late = 0
        self._age_s = 0.0

    def hear(self, scene: Scene, now_s: float) -> None:
        if now_s > self._heard_s:
            self._interval_s = min(self._interval_s, now_s - self._heard_s)
        self._heard_s = now_s
        self._age_s = now_s - scene.t_s
        is_late = now_s - scene.ready_s > LATE_S
        self._late = min(self._late + 1, LATE_PICTURES) if is_late else 0

    def silence(self, now_s: float) -> NoPicture | None:
        """Find that no picture comes any more."""
        silent_s = now_s - self._heard_s
        usual_s = 0.0 if math.isinf(self._interval_s) else self._interval_s
        return NoPicture(silent_s) if silent_s > max(SILENT_S, MISSING * usual_s) else None

    @property
    def lateness(self) -> PicturesComeLate | None:
        return PicturesComeLate(self._age_s) if self._late >= LATE_PICTURES else None
