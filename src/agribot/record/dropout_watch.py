"""Short dropouts of sensors, boards, encoders and the program: a loose plug shows so for hours.

A dropout is a gap of several usual intervals between samples that has ended; a longer silence is a
fault by itself, and counts as one dropout here. From the third within ten minutes on it is
reported, once until the ten minutes hold fewer.
"""

from __future__ import annotations

import math
from collections import deque

import msgspec

from agribot.core.facts import ComesAndGoes, ComingAndGoing
from agribot.core.messages import SensorBatch

WITHIN_S, MANY = 600.0, 3  # window of the count, and the count that is reported
LEAST_S, INTERVALS = 0.2, 5.0  # shortest dropout, in seconds and in usual intervals
SETTLED, LEARNT_RATIO = 20, 0.05  # samples before an interval is usual; weight of each later one
STANDS_RAD, TURNED_RAD = 1e-6, 0.3  # turn of a stuck encoder; least one of the others meanwhile

# Samples by the field of the batch.
_FIELDS: dict[str, ComingAndGoing] = {
    "gnss": "gnss", "mag": "compass", "imu": "imu", "wheels": "wheels", "frames": "camera",
    "board": "board", "contactor": "contactor",
}  # fmt: skip
# Wheels in the order of a sample of the encoders.
WHEELS: tuple[ComingAndGoing, ...] = (
    "right_wheel_R", "left_wheel_R", "right_wheel_F", "left_wheel_F"
)  # fmt: skip


class Dropouts(msgspec.Struct, frozen=True, kw_only=True):
    """Dropouts of one part in a run."""

    count: int
    per_hour: float
    longest_s: float


class _Gaps:
    """The dropouts of one part."""

    def __init__(self) -> None:
        self._recent: deque[tuple[float, float]] = deque()  # when each ended, and its length, s
        self._count, self._longest_s, self._is_reported = 0, 0.0, False

    def add(self, t_s: float, gap_s: float) -> None:
        self._recent.append((t_s, gap_s))
        self._count, self._longest_s = self._count + 1, max(self._longest_s, gap_s)

    def take_back(self, gap_s: float) -> None:
        """Take back the last one, if it was this long."""
        if self._recent and abs(self._recent[-1][1] - gap_s) < LEAST_S:
            self._recent.pop()
            self._count -= 1

    def find(self, part: ComingAndGoing, t_s: float) -> ComesAndGoes | None:
        """Find that there are many now, where that was not so before."""
        while self._recent and t_s - self._recent[0][0] > WITHIN_S:
            self._recent.popleft()
        was, self._is_reported = self._is_reported, len(self._recent) >= MANY
        if was or not self._is_reported:
            return None
        longest_s = max(gap_s for _, gap_s in self._recent)
        return ComesAndGoes(part, len(self._recent), WITHIN_S / 60.0, longest_s)

    def summarise(self, hours: float) -> Dropouts:
        return Dropouts(
            count=self._count, longest_s=self._longest_s,
            per_hour=self._count / hours if hours > 0.0 else 0.0,
        )  # fmt: skip


class _Rhythm:
    """The usual interval of what comes again and again, and gaps in it."""

    def __init__(self) -> None:
        self._last_s: float | None = None
        self._usual_s = 0.0
        self._count = 0

    def add(self, t_s: float) -> float:
        """Take in a sample; return the length of the gap that it ends, 0 without a gap."""
        last_s, self._last_s = self._last_s, t_s
        if last_s is None or t_s <= last_s:
            return 0.0
        interval_s = t_s - last_s
        is_gap = self._count >= SETTLED and interval_s > max(LEAST_S, INTERVALS * self._usual_s)
        if is_gap:
            return interval_s
        self._count += 1
        self._usual_s += max(LEARNT_RATIO, 1.0 / self._count) * (interval_s - self._usual_s)
        return 0.0

    def excuse(self, gap_s: float) -> None:
        """Leave out a time in which nothing could come."""
        if self._last_s is not None:
            self._last_s += gap_s


class _Encoder:
    """One wheel that counts nothing for a moment while all others turn."""

    def __init__(self) -> None:
        self._since_s = 0.0
        self._others_rad = [0.0, 0.0, 0.0]

    def add(self, t_s: float, own_rad: float, others_rad: list[float]) -> float:
        """Take in turns since the last sample; return the length of a dropout that it ends."""
        gap_s, least, most = t_s - self._since_s, min(self._others_rad), max(self._others_rad)
        if abs(own_rad) < STANDS_RAD:
            turned = zip(self._others_rad, others_rad, strict=True)
            self._others_rad = [sum_rad + rad for sum_rad, rad in turned]
            return 0.0
        self._since_s, self._others_rad = t_s, [0.0, 0.0, 0.0]
        return gap_s if gap_s >= LEAST_S and (least > TURNED_RAD or most < -TURNED_RAD) else 0.0


class DropoutWatch:
    """Counts dropouts: call `update` with every batch."""

    def __init__(self) -> None:
        self._ticks = _Rhythm()
        self._rhythms = {field: _Rhythm() for field in _FIELDS}
        self._encoders = [_Encoder() for _ in WHEELS]
        self._angles_rad: tuple[float, ...] | None = None
        self._gaps: dict[ComingAndGoing, _Gaps] = {}
        self._begin_s: float | None = None
        self._t_s = 0.0

    def update(self, batch: SensorBatch) -> list[ComesAndGoes]:
        """Take in a batch; return what has become too much with it."""
        if not math.isfinite(batch.t_s):
            return []
        if batch.t_s < self._t_s and "program" in self._gaps:  # a leap of the clock, no standstill
            self._gaps["program"].take_back(self._t_s - batch.t_s)
        self._t_s = batch.t_s
        self._begin_s = batch.t_s if self._begin_s is None else self._begin_s
        stood_s = self._ticks.add(batch.t_s)
        self._add("program", stood_s)
        for field, rhythm in self._rhythms.items():
            rhythm.excuse(stood_s)
            if getattr(batch, field):
                self._add(_FIELDS[field], rhythm.add(batch.t_s))
        self._watch_encoders(batch)
        found = (gaps.find(part, batch.t_s) for part, gaps in self._gaps.items())
        return [fact for fact in found if fact is not None]

    def summarise(self) -> dict[ComingAndGoing, Dropouts]:
        """Return the dropouts until now, of parts that had any."""
        hours = (self._t_s - (self._begin_s or 0.0)) / 3600.0
        found = {part: gaps.summarise(hours) for part, gaps in self._gaps.items()}
        return {part: dropouts for part, dropouts in found.items() if dropouts.count}

    def _add(self, part: ComingAndGoing, gap_s: float) -> None:
        if gap_s > 0.0:
            self._gaps.setdefault(part, _Gaps()).add(self._t_s, gap_s)

    def _watch_encoders(self, batch: SensorBatch) -> None:
        for sample in batch.wheels:
            before, self._angles_rad = self._angles_rad, sample.angle_rad
            if before is None:
                continue
            turned_rad = [now - then for now, then in zip(sample.angle_rad, before, strict=True)]
            for wheel, encoder in enumerate(self._encoders):
                others_rad = turned_rad[:wheel] + turned_rad[wheel + 1 :]
                gap_s = encoder.add(sample.t_s, turned_rad[wheel], others_rad)
                self._add(WHEELS[wheel], gap_s)
