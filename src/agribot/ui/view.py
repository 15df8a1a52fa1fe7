"""What a page shows of a run, gathered tick by tick: of a live robot or of a recording."""

from __future__ import annotations

import math
from collections import deque

import msgspec
from msgspec import UNSET

from agribot.autonomy.estimate.verdicts import SILENT_S
from agribot.autonomy.weeds.track import Track
from agribot.core.config import RunConfig
from agribot.core.fact_text import render
from agribot.core.facts import Fact
from agribot.core.implement.plants import REASONS
from agribot.core.implement.spec import ImplementSpec, describe_command
from agribot.core.messages import (
    BatterySample,
    Check,
    Estimate,
    GateStatus,
    GnssFix,
    MissionState,
    MissionStatus,
    Path,
    SensorBatch,
    SensorVerdicts,
    TickRecord,
    Vec3,
)
from agribot.record.events import Event
from agribot.record.weeds import PlantOnMap
from agribot.ui import wire
from agribot.ui.receiver_view import ReceiverView

SIGNALS_KEPT = 500  # ten seconds of ticks that no page has asked for yet
TRACE_STEP_M = 0.02
PATH_STEP_M = 0.05
TILT_SHARE = 0.02  # share of each new sample of the accelerometer: half a second at 100 Hz
_LEVEL: dict[str, wire.EventLevel] = {
    "fault": "fault",
    "stop": "warn",
    "hold": "warn",
    "limit": "warn",
    "lost": "warn",
    "truth": "warn",
}
# Kinds of events whose text is that of their fact; that of the others says more.
_TEXT_OF_FACT = frozenset({"fault", "stop", "hold", "limit", "mission", "gate"})
# The page's names of a mission that does not run and was not stopped.
_MODES: dict[MissionState, wire.Mode] = {
    "waiting": "waiting",
    "paused": "paused",
    "done": "done",
    "cancelled": "done",
    "failed": "done",
}


class RunView:
    """A tap; `state()` may be called from another thread. `trace_map_m` only ever grows."""

    def __init__(self, config: RunConfig, implement: ImplementSpec | None = None) -> None:
        self._implement = implement
        self._hand_timeout_s = config.safety.hand_timeout_s
        self.receiver = ReceiverView(config)
        self.record: TickRecord | None = None
        self.ticks = 0
        self.trace_map_m: list[wire.Vec2] = []
        self.topics: dict[str, int] = {}
        self._signals: deque[wire.Sample] = deque(maxlen=SIGNALS_KEPT)
        self._gnss: GnssFix | None = None
        self._battery: BatterySample | None = None
        self._joints = [0.0] * 4
        self._up_mps2: Vec3 | None = None
        self._hand_s = -math.inf
        self._gate = GateStatus()
        self._gate_since_s = 0.0
        self._checks: list[wire.StartCheck] = []

    def __call__(self, record: TickRecord) -> None:
        batch = record.batch
        self._sense(batch)
        self.receiver(batch)
        if batch.hand and (batch.hand[-1].v_mps or batch.hand[-1].yaw_rate_radps):
            self._hand_s = batch.t_s
        self._watch_gate(batch.t_s, record.status.gate)
        self._trace(record)
        self._signals.append(self._sample(record))
        self._count(batch)
        self.record = record
        self.ticks += 1

    def state(self) -> wire.State | None:
        """Return the newest state as the page reads it, with all signals since the last call."""
        record = self.record
        if record is None:
            return None
        estimate, status = record.estimate, record.status
        cross_m = record.tracking.cross_track_m if record.tracking else None
        reason, fact = _choose_reason(record)
        return wire.State(
            tick=self.ticks,
            t_s=round(record.batch.t_s, 4),
            pose=_pose(estimate),
            pos_std_m=_shorten(estimate.pos_std_m),
            yaw_std_rad=_shorten(estimate.yaw_std_rad),
            v_mps=_shorten(estimate.v_mps),
            yaw_rate_radps=_shorten(estimate.yaw_rate_radps),
            cross_track_m=None if cross_m is None else _shorten(cross_m),
            joints_rad=self._joints,
            tilt_rad=_tilt(self._up_mps2),
            gnss=_gnss(self._gnss, record.batch.t_s),
            battery=_battery(self._battery),
            mission=_mission(status),
            mode=self._mode(record),
            stop=status.stopped,
            stop_fact=status.stopped_fact or UNSET,
            reason=reason,
            reason_fact=fact or UNSET,
            gate=self._show_gate(fact),
            checks=self._checks,
            doubts=list_doubts(estimate.verdicts),
            implement=self._describe_implement(record),
            signals=_take(self._signals),
        )

    def _sense(self, batch: SensorBatch) -> None:
        if batch.gnss:
            self._gnss = batch.gnss[-1]
        if batch.battery:
            self._battery = batch.battery[-1]
        if batch.wheels:
            self._joints = [round(angle, 3) for angle in batch.wheels[-1].angle_rad]
        for sample in batch.imu:
            if sample.accel_mps2 is None:
                continue
            known = self._up_mps2 or sample.accel_mps2
            pairs = zip(known, sample.accel_mps2, strict=True)
            x, y, z = (old + TILT_SHARE * (new - old) for old, new in pairs)
            self._up_mps2 = (x, y, z)

    def _watch_gate(self, t_s: float, gate: GateStatus) -> None:
        before, self._gate = self._gate, gate
        if gate.state != before.state or self.record is None:
            self._gate_since_s = t_s
        if gate.checks and gate.checks is not before.checks:
            self._checks = [_show_check(check) for check in gate.checks]

    def _show_gate(self, said: Fact | None) -> wire.ShownGate:
        """Show the gate, less a reason that is `said` already."""
        gate, fact = self._gate, self._gate.fact
        is_said = said is not None and fact is not None and (said.holds(fact) or fact.holds(said))
        return wire.ShownGate(
            state=gate.state,
            since_s=round(self._gate_since_s, 2),
            reason="" if is_said else gate.reason,
            reason_fact=UNSET if is_said or fact is None else fact,
        )

    def _trace(self, record: TickRecord) -> None:
        estimate = record.estimate
        x_m, y_m = estimate.x_map_m, estimate.y_map_m
        if not estimate.ok or not math.isfinite(x_m + y_m):
            return
        last = self.trace_map_m[-1] if self.trace_map_m else (math.inf, math.inf)
        if not math.hypot(x_m - last[0], y_m - last[1]) < TRACE_STEP_M:
            self.trace_map_m.append((round(x_m, 4), round(y_m, 4)))

    def _sample(self, record: TickRecord) -> wire.Sample:
        """Time and every one of `wire.SIGNALS`."""
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
        return [None if value is None else _shorten(value) for value in values]

    def _count(self, batch: SensorBatch) -> None:
        counts = self.topics
        for name in ("wheels", "imu", "mag", "gnss", "frames", "battery"):
            counts[name] = counts.get(name, 0) + len(getattr(batch, name))

    def _describe_implement(self, record: TickRecord) -> list[wire.ImplementLine]:
        lines = describe_command(self._implement, record.command.implement)
        return [wire.ImplementLine(name=line.name, text=line.text) for line in lines]

    def _mode(self, record: TickRecord) -> wire.Mode:
        state = record.status.state
        if record.status.stopped:
            return "stopped"
        if state == "running":
            return "mission"
        is_by_hand = record.batch.t_s - self._hand_s < self._hand_timeout_s
        return "teleop" if is_by_hand else _MODES[state]


def shown_weed(track: Track) -> wire.Weed:
    """Return a plant of the map as the page reads it."""
    left = REASONS[track.left] if track.treated_s is None else ""
    return shown_plant(track, track.treated_s, left)


def shown_plant(plant: PlantOnMap, treated_s: float | None, left: str) -> wire.Weed:
    return wire.Weed(
        id=plant.id,
        plant=plant.plant,
        x_map_m=round(plant.x_map_m, 4),
        y_map_m=round(plant.y_map_m, 4),
        std_m=round(plant.std_m, 4),
        confidence=round(plant.confidence, 3),
        area_m2=round(plant.area_m2, 6),
        sightings=plant.sightings,
        first_seen_s=round(plant.first_seen_s, 2),
        last_seen_s=round(plant.last_seen_s, 2),
        treated_s=None if treated_s is None else round(treated_s, 2),
        left=left,
    )


def _shorten(value: float) -> float | None:
    """Round to five decimals, enough for display; None for NaN and infinity."""
    return round(value, 5) if math.isfinite(value) else None


def _pose(estimate: Estimate) -> tuple[float, float, float] | None:
    x_m, y_m, yaw_rad = estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad
    if not estimate.ok or not math.isfinite(x_m + y_m + yaw_rad):
        return None
    return round(x_m, 5), round(y_m, 5), round(yaw_rad, 5)


def _choose_reason(record: TickRecord) -> tuple[str, Fact | None]:
    """Choose the nearest reason, and the fact that it is the text of."""
    status = record.status
    if record.reason:
        return record.reason, record.fact
    if status.reason:
        return status.reason, status.fact
    return status.gate.warning, status.gate.warning_fact


def _mission(status: MissionStatus) -> wire.MissionProgress:
    eta_s = status.eta_s if status.state == "running" else None
    return wire.MissionProgress(
        state=status.state,
        reason=status.reason,
        reason_fact=status.fact or UNSET,
        row=status.row,
        rows_total=status.rows_total,
        rows_done=len(status.rows_done),
        s_m=round(status.s_m, 3),
        length_m=round(status.length_m, 3),
        eta_s=None if eta_s is None else round(eta_s, 1),
        waypoints_total=status.waypoints_total,
        waypoints_reached=status.waypoints_reached,
        leg=status.leg,
        refusal=status.refusal,
        refusal_fact=status.refusal_fact or UNSET,
    )


def _show_check(check: Check) -> wire.StartCheck:
    if check.is_ok:
        return wire.StartCheck(name=check.name, remark=check.text, remark_fact=check.fact)
    return wire.StartCheck(name=check.name, wrong=check.text, wrong_fact=check.fact)


def list_doubts(verdicts: SensorVerdicts) -> list[wire.SensorDoubt]:
    """List the sensors that are not fine, which are few."""
    return [
        wire.SensorDoubt(
            sensor=name,
            state=one.state,
            since_s=one.since_s,
            reason=one.reason,
            reason_fact=one.fact or UNSET,
        )
        for name, one in verdicts.items()
        if one.state != "fine"
    ]


def _tilt(up_mps2: Vec3 | None) -> wire.Vec2 | None:
    """Roll and pitch (rad) from the specific force; fair while the robot drives evenly."""
    if up_mps2 is None or not math.isfinite(sum(up_mps2)):
        return None
    x, y, z = up_mps2
    return round(math.atan2(y, z), 5), round(math.atan2(-x, math.hypot(y, z)), 5)


def _gnss(fix: GnssFix | None, t_s: float) -> wire.GnssState | None:
    """Show the newest fix until GNSS counts as silent: an old one says nothing of now."""
    if fix is None or not t_s - fix.t_s <= SILENT_S:
        return None
    return wire.GnssState(
        lat_deg=round(fix.lat_deg, 9),
        lon_deg=round(fix.lon_deg, 9),
        quality=int(fix.quality),
        std_m=_shorten(fix.pos_std_m),
    )


def _battery(sample: BatterySample | None) -> wire.BatteryState | None:
    if sample is None:
        return None
    return wire.BatteryState(
        voltage_v=round(sample.voltage_v, 2), charge_pct=round(sample.charge_ratio * 100.0, 1)
    )


def _take(queue: deque[wire.Sample]) -> list[wire.Sample]:
    """Empty the queue while the robot's loop may still append to it."""
    taken = []
    while queue:
        taken.append(queue.popleft())
    return taken


def thin_path(path: Path) -> wire.PathPiece:
    """Return the whole path with a point about every 5 cm."""
    step_m = float(path.s_m[-1]) / max(len(path.s_m) - 1, 1)
    every = max(1, round(PATH_STEP_M / step_m)) if step_m > 0 else 1
    keep = sorted({*range(0, len(path.s_m), every), len(path.s_m) - 1})
    points = [(round(x_m, 4), round(y_m, 4)) for x_m, y_m in path.xy_map_m[keep].tolist()]
    return wire.PathPiece(points_map_m=points, rows=path.row[keep].tolist())


def shown_event(event: Event) -> wire.LogEvent:
    level = _LEVEL.get(event.kind, "info")
    fact = event.fact if event.kind in _TEXT_OF_FACT else None
    line = wire.LogEvent(t_s=event.t_s, level=level, source=event.kind, text=event.reason)
    if fact is not None:
        text, state = render(fact), event.state or ""
        return msgspec.structs.replace(line, text=text, text_fact=fact, state=state)
    return line if event.reason else msgspec.structs.replace(line, text="no objection any more")
