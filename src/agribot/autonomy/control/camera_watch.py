"""Do pictures come, and does the network see something in them, while both are in use?"""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.core.config import SafetyConfig
from agribot.core.facts import CameraLate, CameraSilent, Fact, NetworkSilent
from agribot.core.messages import Scene, SensorBatch


class _Stream:
    """Time of the last sample; it is silent after three of its own intervals at the earliest."""

    def __init__(self) -> None:
        self._last_s, self._interval_s = math.nan, math.inf

    def hear(self, t_s: float) -> None:
        if t_s > self._last_s:
            self._interval_s = min(self._interval_s, t_s - self._last_s)
        self._last_s = t_s

    @property
    def is_heard(self) -> bool:
        return math.isfinite(self._last_s)

    def silence_s(self, t_s: float, limit_s: float) -> float:
        """Return for how long it has been silent, 0 while that is usual."""
        usual_s = 3.0 * self._interval_s if math.isfinite(self._interval_s) else 0.0
        silent_s = t_s - self._last_s
        return silent_s if silent_s > max(limit_s, usual_s) else 0.0


class CameraWatch:
    """Only what was heard once can fall silent: a robot without a camera lacks nothing."""

    def __init__(self, config: SafetyConfig) -> None:
        self._limit_s = config.camera_timeout_s
        self._frames, self._scenes = _Stream(), _Stream()
        self._late_s = 0.0
        self.fault: Fact | None = None

    def update(self, batch: SensorBatch, scenes: Sequence[Scene]) -> None:
        """Take in a tick; `fault` is then what is silent or late, None where all is well."""
        if batch.frames:
            self._frames.hear(batch.t_s)
            self._late_s = batch.t_s - batch.frames[-1].t_s
        if scenes:
            self._scenes.hear(batch.t_s)
        self.fault = self._judge(batch.t_s)

    @property
    def is_used(self) -> bool:
        """Whether pictures came at least once."""
        return self._frames.is_heard

    def _judge(self, t_s: float) -> Fact | None:
        limit_s = self._limit_s
        if silent_s := self._frames.silence_s(t_s, limit_s):
            return CameraSilent(silent_s, limit_s)
        if self._late_s > limit_s:
            return CameraLate(self._late_s, limit_s)
        silent_s = self._scenes.silence_s(t_s, limit_s)
        return NetworkSilent(silent_s, limit_s) if silent_s else None
