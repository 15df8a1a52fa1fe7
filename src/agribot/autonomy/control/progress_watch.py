"""Progress of the robot: wheels that turn while the receiver's position stays are slipping.

The way of wheels and gyro over the last metre is compared with the receiver's positions and, where
it gives them, velocities. Both must show that the robot falls behind, so that neither a frozen nor
a jumping receiver looks like a stuck robot. On rough ground clods hold the robot for a second or
two before it climbs over them: it is stuck only if that lasts. A robot that got free by itself is
not stuck: the last part of the way counts, too.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from agribot.core.facts import Stuck
from agribot.core.geo import WGS84_A_M
from agribot.core.messages import GnssFix, GnssQuality, SensorBatch, WheelSample
from agribot.core.robot import DriveSpec

# Wheels on rough soil that is driven every day keep more than 0.7 of their way.
STUCK_RATIO = 0.35
# Way of the wheels that is judged, m: with corrections a receiver resolves single centimetres.
CORRECTED_WAY_M, PLAIN_WAY_M = 0.5, 1.5
LAST_PART = 0.3  # last share of that way, in which a robot that got free makes headway again
LONGEST_S = 10.0
# Longest time without headway. Of 90 clods that held a robot on the roughest ground, 86 did so for
# less than 1.2 s.
STUCK_S = 2.5
# A robot that keeps less of its way just now is held; one that does not move on is judged by this
# alone, and of a receiver that was silent for longer nothing is known.
HELD_RATIO, HELD_S, FRESH_S = 0.6, 0.4, 0.6
# Wheels that stand or turn against each other lead nowhere; what was before is over then.
PAUSE_S, PAUSE_M = 0.4, 0.02
MOST_TURN_RAD = 1.2  # a robot that turns swings its antenna about
CORRECTED = (GnssQuality.RTK_FIXED, GnssQuality.RTK_FLOAT)


class _Place(NamedTuple):
    """Positions by wheels with gyro and by the receiver at a fix; `flown` sums its velocities."""

    t_s: float
    rolled_m: tuple[float, float]
    turn_rad: float
    east_m: float
    north_m: float
    flown_m: tuple[float, float] | None


class ProgressWatch:
    """Call `watch` once a tick; `restart` when a person has looked."""

    def __init__(self, drive: DriveSpec) -> None:
        self._wheel_radius_m = drive.wheel_radius_m
        self._max_speed_mps = 3.0 * drive.max_speed_mps  # else a number is spoilt, or counts anew
        self._wheels: WheelSample | None = None
        self._imu_t_s = math.nan
        self._x_m = self._y_m = self._turn_rad = 0.0
        self._origin_deg: tuple[float, float] | None = None
        self._places: deque[_Place] = deque()
        self._held_since_s: float | None = None
        self._found: Stuck | None = None
        self._stays_behind, self._seen_s = False, -math.inf

    def stays_behind(self, t_s: float) -> bool:
        """Whether the receiver shows that the robot gets on less than its wheels just now."""
        return self._stays_behind and t_s - self._seen_s <= FRESH_S

    def restart(self) -> None:
        self._places.clear()
        self._held_since_s = None
        self._found = None

    def watch(self, batch: SensorBatch) -> Stuck | None:
        """Find how far the robot stays behind its wheels, None where it gets on."""
        self._add_motion(batch)
        for fix in batch.gnss:
            if fix.unmeasured:
                continue
            self._add_fix(fix)
            self._look_back(fix.t_s)
            found = self._judge(is_corrected=fix.quality in CORRECTED)
            lasts = self._lasts(fix.t_s, is_held=found is not None)
            self._found = found if lasts else None
        return self._found

    def _look_back(self, t_s: float) -> None:
        if not self._places:
            return
        now = self._places[-1]
        then = self._find_place(t_s, HELD_S)
        self._seen_s = t_s
        if then is None:
            self._stays_behind = True  # the wheels lead nowhere: it turns on the spot
            return
        way_m, moved_m = math.dist(now.rolled_m, then.rolled_m), _flown_m(then, now)
        self._stays_behind = moved_m < HELD_RATIO * way_m

    def _lasts(self, t_s: float, *, is_held: bool) -> bool:
        """Whether the robot has been held too long to get free by itself."""
        if not is_held:
            self._held_since_s = None
        elif self._held_since_s is None:
            self._held_since_s = t_s
        return self._held_since_s is not None and t_s - self._held_since_s >= STUCK_S

    def _add_motion(self, batch: SensorBatch) -> None:
        for sample in batch.wheels:
            if self._wheels is not None:
                way_rad = (sum(sample.angle_rad) - sum(self._wheels.angle_rad)) / 4.0
                way_m = way_rad * self._wheel_radius_m
                if abs(way_m) <= self._max_speed_mps * (sample.t_s - self._wheels.t_s):
                    self._x_m += way_m * math.cos(self._turn_rad)
                    self._y_m += way_m * math.sin(self._turn_rad)
            self._wheels = sample
        for imu in batch.imu:
            turn_rad = imu.gyro_radps[2] * (imu.t_s - self._imu_t_s)
            if abs(turn_rad) < 1.0:
                self._turn_rad += turn_rad
            self._imu_t_s = imu.t_s

    def _add_fix(self, fix: GnssFix) -> None:
        if not math.isfinite(fix.lat_deg + fix.lon_deg):
            return
        if self._origin_deg is None:
            self._origin_deg = fix.lat_deg, fix.lon_deg
        lat_deg, lon_deg = self._origin_deg
        east_m = math.radians(fix.lon_deg - lon_deg) * WGS84_A_M * math.cos(math.radians(lat_deg))
        north_m = math.radians(fix.lat_deg - lat_deg) * WGS84_A_M
        last = self._places[-1] if self._places else None
        if last is not None and not 0.0 < fix.t_s - last.t_s <= 1.0:
            self._places.clear()  # the motion during a receiver's silence is unknown
            last = None
        rolled_m = (self._x_m, self._y_m)
        place = _Place(fix.t_s, rolled_m, self._turn_rad, east_m, north_m, _fly_on(last, fix))
        if self._has_paused(place):
            self._places.clear()
        self._places.append(place)
        while fix.t_s - self._places[0].t_s > LONGEST_S:
            self._places.popleft()

    def _has_paused(self, now: _Place) -> bool:
        then = self._find_place(now.t_s, PAUSE_S)
        return then is not None and math.dist(now.rolled_m, then.rolled_m) < PAUSE_M

    def _find_place(self, t_s: float, ago_s: float) -> _Place | None:
        """Find the latest place that is at least `ago_s` old."""
        places = reversed(self._places)
        return next((place for place in places if t_s - place.t_s >= ago_s), None)

    def _judge(self, *, is_corrected: bool) -> Stuck | None:
        if not self._places:
            return None
        now = self._places[-1]
        least_m = CORRECTED_WAY_M if is_corrected else PLAIN_WAY_M
        then, lately = self._before(least_m), self._before(LAST_PART * least_m)
        if then is None or lately is None or abs(now.turn_rad - then.turn_rad) > MOST_TURN_RAD:
            return None
        way_m, moved_m = math.dist(now.rolled_m, then.rolled_m), _moved_m(then, now)
        last_way_m = math.dist(now.rolled_m, lately.rolled_m)
        if moved_m >= STUCK_RATIO * way_m or _moved_m(lately, now) >= STUCK_RATIO * last_way_m:
            return None
        return Stuck(way_m, now.t_s - then.t_s, moved_m)

    def _before(self, way_m: float) -> _Place | None:
        """Find the latest place that lies at least `way_m` of the wheels' way back."""
        now = self._places[-1]
        return next(
            (
                place
                for place in reversed(self._places)
                if math.dist(now.rolled_m, place.rolled_m) >= way_m
            ),
            None,
        )


def _moved_m(then: _Place, now: _Place) -> float:
    """Measure the receiver's way between two fixes, by its positions or by its velocities."""
    return max(_stepped_m(then, now), _flown_m(then, now))


def _stepped_m(then: _Place, now: _Place) -> float:
    return math.hypot(now.east_m - then.east_m, now.north_m - then.north_m)


def _flown_m(then: _Place, now: _Place) -> float:
    """Measure its way by its velocities, which are less noisy; by its positions without them."""
    if now.flown_m is None or then.flown_m is None:
        return _stepped_m(then, now)
    return math.dist(now.flown_m, then.flown_m)


def _fly_on(last: _Place | None, fix: GnssFix) -> tuple[float, float] | None:
    """Add the way of one fix's velocity; None where the receiver gives none."""
    if fix.velocity_mps is None:
        return None
    if last is None or last.flown_m is None:
        return 0.0, 0.0
    dt_s, (east_m, north_m) = fix.t_s - last.t_s, last.flown_m
    return east_m + fix.velocity_mps[0] * dt_s, north_m + fix.velocity_mps[1] * dt_s
