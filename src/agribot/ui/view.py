"""What a page shows of a run, gathered tick by tick: of a live robot or of a recording."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

from agribot.autonomy.weeds.track import Track
from agribot.core.config import RunConfig
from agribot.core.implement.spec import ImplementSpec, describe_command
from agribot.core.messages import BatterySample, GnssFix, SensorBatch, TickRecord, Vec3

# Name and unit of every signal that a plot can show; `RunView` gives one sample for each tick.
SIGNALS = (
    ("v_mps", "m/s"),
    ("yaw_rate_radps", "rad/s"),
    ("v_commanded_mps", "m/s"),
    ("yaw_rate_commanded_radps", "rad/s"),
    ("cross_track_m", "m"),
    ("heading_error_rad", "rad"),
    ("pos_std_m", "m"),
    ("yaw_std_rad", "rad"),
    ("battery_v", "V"),
    ("protection_m", "m"),
)
SIGNALS_KEPT = 500  # ten seconds of ticks that nobody has asked for yet
TRACE_STEP_M = 0.02
TILT_SHARE = 0.02  # of each new sample of the accelerometer: half a second at 100 Hz
_FINAL = {"done": "done", "cancelled": "done", "failed": "done"}

Point = list[float]


class RunView:
    """A tap; `state()` may be called from another thread. `trace_map_m` only ever grows."""

    def __init__(self, config: RunConfig, implement: ImplementSpec | None = None) -> None:
        self._implement = implement
        self._hand_timeout_s = config.safety.hand_timeout_s
        self.record: TickRecord | None = None
        self.ticks = 0
        self.trace_map_m: list[Point] = []
        self.topics: dict[str, int] = {}
        self._signals: deque[list[float | None]] = deque(maxlen=SIGNALS_KEPT)
        self._gnss: GnssFix | None = None
        self._battery: BatterySample | None = None
        self._joints = [0.0] * 4
        self._up_mps2: Vec3 | None = None
        self._hand_s = -math.inf

    def __call__(self, record: TickRecord) -> None:
        batch = record.batch
        self._sense(batch)
        if batch.hand and (batch.hand[-1].v_mps or batch.hand[-1].yaw_rate_radps):
            self._hand_s = batch.t_s
        self._trace(record)
        self._signals.append(self._sample(record))
        self._count(batch)
        self.record = record
        self.ticks += 1

    def state(self) -> dict[str, Any] | None:
        """The newest state as the page reads it, with all signals since the last call."""
        record = self.record
        if record is None:
            return None
        estimate, command = record.estimate, record.command
        known = math.isfinite(estimate.x_map_m + estimate.y_map_m + estimate.yaw_map_rad)
        pose = (estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
        cross_m = record.tracking.cross_track_m if record.tracking else None
        return {
            "k": "s",
            "n": self.ticks,
            "t": round(record.batch.t_s, 4),
            "pose": [round(value, 5) for value in pose] if known and estimate.ok else None,
            "std": [_short(estimate.pos_std_m), _short(estimate.yaw_std_rad)],
            "vel": [_short(estimate.v_mps), _short(estimate.yaw_rate_radps)],
            "cmd": [_short(command.drive.v_mps), _short(command.drive.yaw_rate_radps)],
            "joints": self._joints,
            "att": _tilt(self._up_mps2),
            "gnss": _gnss(self._gnss),
            "mission": self._mission(record),
            "mode": self._mode(record),
            "stop": record.status.stopped,
            "reason": record.reason or record.status.reason,
            "battery": _battery(self._battery),
            "xte_m": None if cross_m is None else _short(cross_m),
            "implement": [
                list(line) for line in describe_command(self._implement, command.implement)
            ],
            "sig": _taken(self._signals),
        }

    def _sense(self, batch: SensorBatch) -> None:
        if batch.gnss:
            self._gnss = batch.gnss[-1]
        if batch.battery:
            self._battery = batch.battery[-1]
        if batch.wheels:
            self._joints = [round(angle, 3) for angle in batch.wheels[-1].angle_rad]
        for sample in batch.imu:
            known = self._up_mps2 or sample.accel_mps2
            pairs = zip(known, sample.accel_mps2, strict=True)
            x, y, z = (old + TILT_SHARE * (new - old) for old, new in pairs)
            self._up_mps2 = (x, y, z)

    def _trace(self, record: TickRecord) -> None:
        estimate = record.estimate
        x_m, y_m = estimate.x_map_m, estimate.y_map_m
        if not estimate.ok or not math.isfinite(x_m + y_m):
            return
        last = self.trace_map_m[-1] if self.trace_map_m else [math.inf, math.inf]
        if not math.hypot(x_m - last[0], y_m - last[1]) < TRACE_STEP_M:
            self.trace_map_m.append([round(x_m, 4), round(y_m, 4)])

    def _sample(self, record: TickRecord) -> list[float | None]:
        estimate, drive, tracking = record.estimate, record.command.drive, record.tracking
        values = (
            record.batch.t_s,
            estimate.v_mps,
            estimate.yaw_rate_radps,
            drive.v_mps,
            drive.yaw_rate_radps,
            tracking.cross_track_m if tracking else None,
            tracking.heading_error_rad if tracking else None,
            estimate.pos_std_m,
            estimate.yaw_std_rad,
            self._battery.voltage_v if self._battery else None,
            estimate.protection_m,
        )
        return [None if value is None else _short(value) for value in values]

    def _count(self, batch: SensorBatch) -> None:
        counts = self.topics
        for name in ("wheels", "imu", "mag", "gnss", "frames", "battery"):
            counts[name] = counts.get(name, 0) + len(getattr(batch, name))

    def _mission(self, record: TickRecord) -> dict[str, Any]:
        status = record.status
        eta_s = status.eta_s if status.state == "running" else None
        return {
            "state": status.state,
            "reason": status.reason,
            "row": status.row,
            "rows_total": status.rows_total,
            "rows_done": list(status.rows_done),
            "s_m": round(status.s_m, 3),
            "length_m": round(status.length_m, 3),
            "eta_s": None if eta_s is None else round(eta_s, 1),
            "wp_total": status.waypoints_total,
            "wp_reached": status.waypoints_reached,
            "leg": status.leg,
            "refusal": status.refusal,
        }

    def _mode(self, record: TickRecord) -> str:
        state = record.status.state
        if record.status.stopped:
            return "stopped"
        if state != "running" and record.batch.t_s - self._hand_s < self._hand_timeout_s:
            return "teleop"
        return "mission" if state == "running" else _FINAL.get(state, state)


def weed_row(track: Track) -> list[Any]:
    """One plant of the map as the page reads it: id, class, place, spread and evidence."""
    treated_s = None if track.treated_s is None else round(track.treated_s, 2)
    return [
        track.id,
        int(track.plant),
        round(track.x_map_m, 4),
        round(track.y_map_m, 4),
        round(track.std_m, 4),
        round(track.confidence, 3),
        round(track.area_m2, 6),
        track.sightings,
        round(track.first_seen_s, 2),
        round(track.last_seen_s, 2),
        treated_s,
    ]


def _short(value: float) -> float | None:
    """Five decimals are enough to look at; a number that is none is left out."""
    return round(value, 5) if math.isfinite(value) else None


def _tilt(up_mps2: Vec3 | None) -> list[float | None] | None:
    """Roll and pitch (rad) from the specific force; fair while the robot drives evenly."""
    if up_mps2 is None:
        return None
    x, y, z = up_mps2
    return [_short(math.atan2(y, z)), _short(math.atan2(-x, math.hypot(y, z)))]


def _gnss(fix: GnssFix | None) -> dict[str, Any] | None:
    if fix is None:
        return None
    place = {"lat": round(fix.lat_deg, 9), "lon": round(fix.lon_deg, 9)}
    return {**place, "q": int(fix.quality), "std": _short(fix.pos_std_m)}


def _battery(sample: BatterySample | None) -> dict[str, Any] | None:
    if sample is None:
        return None
    return {"v": round(sample.voltage_v, 2), "pct": round(sample.charge_ratio * 100.0, 1)}


def _taken(queue: deque[list[float | None]]) -> list[list[float | None]]:
    taken = []
    while queue:
        taken.append(queue.popleft())
    return taken
