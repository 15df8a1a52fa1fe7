"""Sentences of NMEA joined by their time of day to one fix an epoch."""

from __future__ import annotations

import math
from collections.abc import Callable

from agribot.drivers.gnss.nmea import DAY_S, Sentence, StampedFix, read_time_of_day_s
from agribot.drivers.gnss.nmea_places import Parts, make_fix

PAUSE_S = 0.5  # pause that ends the sentences of an epoch
# Field of the time of day in sentences that have one.
TIME_FIELDS = {"GGA": 0, "GNS": 0, "RMC": 0, "GST": 0, "GLL": 4, "PQTMPVT": 3, "PQTMVEL": 1}
TIMELESS = ("VTG", "PQTMEPE")


class NmeaFixes:
    """Joins the sentences of an epoch to a fix.

    An epoch ends with the kind of sentence that ended the one before it, so that a fix waits for
    no other, or else where the next one begins. Sentences without a time belong to the epoch that
    is nearer by their arrival: receivers pause between epochs.
    """

    def __init__(self, refuse: Callable[[str], None]) -> None:
        self._refuse = refuse
        self._time_of_day_s = math.nan
        self._days_s = 0.0
        self._parts: Parts = {}
        self._last_kind, self._last_timed_kind, self._ending_kind = "", "", ""
        self._is_given = True
        self._arrived_s = self._pause_s = 0.0  # the longest since the last sentence with a time
        self._timeless: dict[str, tuple[tuple[str, ...], float]] = {}  # with the pause before
        self._leading: set[str] = set()  # sentences of an epoch before the first one with a time

    def add(self, sentence: Sentence, arrived_s: float = 0.0) -> list[StampedFix]:
        """Add a sentence; gives the fixes that it completes."""
        pause_s, self._arrived_s = arrived_s - self._arrived_s, arrived_s
        self._pause_s = max(self._pause_s, pause_s)
        kind, fields = sentence.kind, sentence.fields
        if kind in TIMELESS:
            return self._add_timeless(kind, fields)
        field = TIME_FIELDS.get(kind)
        text = "" if field is None or len(fields) <= field else fields[field]
        if not text:
            return []
        try:
            time_of_day_s = read_time_of_day_s(text)
        except ValueError:
            self._refuse(f"{kind} with the time {text!r}")
            return []
        finished: list[StampedFix] = []
        if time_of_day_s != self._time_of_day_s:
            finished = self._make()
            self._begin(time_of_day_s, pause_s)
        self._pause_s = 0.0
        self._parts[kind] = fields
        self._last_kind = self._last_timed_kind = kind
        return finished + self._end(kind)

    def give_waiting(self, arrived_s: float) -> list[StampedFix]:
        """Give the epoch whose last sentence does not come, once the receiver pauses."""
        return self._make() if arrived_s - self._arrived_s > PAUSE_S else []

    @property
    def stamp_s(self) -> float:
        """Time stamp of the epoch of its sentences now; 0 before the first."""
        return self._make_stamp_s(self._time_of_day_s)

    def find_stamp_s(self, time_text: str) -> float:
        """Find the stamp of a time of day of now; that of the present epoch without a time."""
        try:
            time_of_day_s = read_time_of_day_s(time_text)
        except ValueError:
            return self.stamp_s
        return self._make_stamp_s(time_of_day_s) if self.stamp_s else 0.0

    def _make_stamp_s(self, time_of_day_s: float) -> float:
        is_known = math.isfinite(time_of_day_s)
        # Not zero at midnight, which would count as none.
        return self._days_s + time_of_day_s + DAY_S if is_known else 0.0

    def _add_timeless(self, kind: str, fields: tuple[str, ...]) -> list[StampedFix]:
        self._timeless[kind] = fields, self._pause_s
        if kind in self._leading or not self._parts:
            return []
        self._parts[kind] = fields
        self._last_kind = kind
        return self._end(kind)

    def _end(self, kind: str) -> list[StampedFix]:
        return self._make() if kind == self._ending_kind else []

    def _begin(self, time_of_day_s: float, pause_s: float) -> None:
        leading = {kind for kind, (_, before_s) in self._timeless.items() if before_s > pause_s}
        self._leading = self._leading - set(self._timeless) | leading
        is_trailed = self._last_kind not in self._leading
        self._ending_kind = self._last_kind if is_trailed else self._last_timed_kind
        self._parts = {kind: self._timeless[kind][0] for kind in leading}
        self._timeless.clear()
        if time_of_day_s < self._time_of_day_s - DAY_S / 2.0:
            self._days_s += DAY_S
        self._time_of_day_s, self._is_given = time_of_day_s, False

    def _make(self) -> list[StampedFix]:
        if self._is_given:
            return []
        self._is_given = True
        try:
            fix = make_fix(self._parts)
        except (ValueError, IndexError) as error:
            self._refuse(f"a fix that cannot be read: {error}")
            return []
        return [StampedFix(self.stamp_s, fix)] if fix else []
