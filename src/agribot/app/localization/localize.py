"""The robot's own filter over a log: poses, and how they stand against the fixes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, TypeVar

import msgspec

from agribot.app.localization.figures import FixFigures, FixOffset, OutageFigures, ThinTable
from agribot.app.localization.log_robot import find_antenna_m
from agribot.autonomy.estimate.corrections import load_corrections
from agribot.autonomy.estimate.doubts import load_witnesses
from agribot.autonomy.estimate.localizer import Localizer
from agribot.core.config import RunConfig
from agribot.core.facts import find_kind
from agribot.core.geo import MapFrame
from agribot.core.messages import BaseFix, Estimate, GnssFix, GnssHeading, SensorBatch
from agribot.core.pose import Pose2
from agribot.core.robot import RobotSpec
from agribot.record.localization.result import (
    POSE_COLUMNS,
    LocalizationResult,
    LocalizationRun,
)

MOST_STOPS = 200
BEGUN = {"yaw", "position"}

Sample = TypeVar("Sample", GnssFix, GnssHeading, BaseFix)


class LocalizedTick(NamedTuple):
    """A tick of a pass: what came in, and the estimate; None before the filter has begun."""

    batch: SensorBatch
    estimate: Estimate | None


Tap = Callable[[LocalizedTick], None]


class LogPass:
    """Feeds the filter tick by tick, and keeps its figures."""

    def __init__(
        self, config: RunConfig, robot: RobotSpec, outages: Sequence[tuple[float, float]] = ()
    ) -> None:
        self.localizer = Localizer(
            config.estimate,
            config.field,
            robot,
            load_corrections(config.plugins),
            load_witnesses(config.plugins),
        )
        self._datum = config.field.datum
        self._fixes = FixFigures(MapFrame(config.field.datum), find_antenna_m(robot))
        self._outages = [OutageFigures(*outage) for outage in outages]
        self._poses = ThinTable(len(POSE_COLUMNS))
        self._radius_m = robot.drive.wheel_radius_m
        self._before: Estimate | None = None
        self._wheels: tuple[float, float] | None = None  # time and speed of the last reading
        self._begun: tuple[float, float] | None = None
        self._end_s = self._driven_m = 0.0
        self._reason = ""
        self._why: tuple[object, ...] = ()
        self._stops: list[tuple[float, str]] = []

    def update(self, batch: SensorBatch) -> LocalizedTick:
        """Feed a batch, less the fixes of outages; return what came of it."""
        self._count_way(batch)
        given = withhold(batch, self._outages)
        judged = {id(fix): self._fixes.judge(fix, self._before) for fix in given.gnss}
        refused = self._count_refused()
        estimate = self.localizer.update(given)
        has_begun = self.localizer.pose.known >= BEGUN
        if has_begun:
            self._fixes.used += len(given.gnss) - (self._count_refused() - refused)
        for fix in batch.gnss:
            self._add_fix(fix, judged)
        self._end_s = batch.t_s
        self._note(estimate, has_begun=has_begun)
        return LocalizedTick(given, estimate if has_begun else None)

    def _add_fix(self, fix: GnssFix, judged: dict[int, FixOffset | None]) -> None:
        is_given = id(fix) in judged
        pose: Pose2 | None = self.localizer.place(fix.t_s) if self._before is not None else None
        off_m = self._fixes.add(fix, pose, judged.get(id(fix)), is_given=is_given)
        for outage in self._outages:
            outage.add(fix.t_s, off_m)

    def _note(self, estimate: Estimate, *, has_begun: bool) -> None:
        e = estimate
        self._note_reason(e)
        for outage in self._outages:
            outage.move(e.t_s, self._driven_m, e if has_begun else None)
        if has_begun:
            self._begun = self._begun or (e.t_s, self._driven_m)
            self._poses.append((e.t_s, e.x_map_m, e.y_map_m, e.yaw_map_rad, e.pos_std_m))
            self._before = e

    def _note_reason(self, estimate: Estimate) -> None:
        """Note why the pose is not good, whenever that changes but for its numbers."""
        kind = () if estimate.ok else find_kind(estimate.fact)
        if kind and kind != self._why and len(self._stops) < MOST_STOPS:
            self._stops.append((estimate.t_s, estimate.reason))
        self._why, self._reason = kind, "" if estimate.ok else estimate.reason

    def _count_way(self, batch: SensorBatch) -> None:
        for wheels in batch.wheels:
            speed_mps = abs(self._radius_m * sum(wheels.speed_radps) / 4.0)
            if self._wheels is not None and 0.0 < wheels.t_s - self._wheels[0] < 1.0:
                self._driven_m += (
                    (speed_mps + self._wheels[1]) / 2.0 * (wheels.t_s - self._wheels[0])
                )
            self._wheels = wheels.t_s, speed_mps

    def _count_refused(self) -> int:
        """Count the fixes that the filter left out."""
        rejected = self.localizer.rejected
        return sum(count for cause, count in rejected.items() if cause.startswith("gnss "))

    def finish(self, fixes: int, settings: tuple[str, ...] = ()) -> LocalizationRun:
        """Return all figures; `fixes` is how many the log has."""
        begun = self._begun
        result = LocalizationResult(
            fixes=fixes,
            used=max(self._fixes.used, 0),
            started_after_s=None if begun is None else begun[0],
            started_after_m=None if begun is None else begun[1],
            rms_to_fixes_m=self._fixes.rms_m,
            within_3_sigma_ratio=self._fixes.within_ratio,
            outages=tuple(outage.result() for outage in self._outages),
            nis_mean=self._fixes.nis_mean,
            reason=self._conclude(),
        )
        return LocalizationRun(
            result=result,
            poses=self._poses.to_array(),
            fixes=self._fixes.table.to_array(),
            datum=self._datum,
            duration_s=self._end_s,
            driven_m=self._driven_m,
            settings=settings,
            rejected=dict(self.localizer.rejected),
            stops=tuple(self._stops),
        )

    def _conclude(self) -> str:
        if self._begun is None:
            return f"never started: {self._reason or 'no reason given'}"
        return f"ended without a good pose: {self._reason}" if self._reason else "ok"


def withhold(batch: SensorBatch, outages: Sequence[OutageFigures]) -> SensorBatch:
    """Return the batch without what a receiver reported in an outage."""
    if not outages:
        return batch

    def keep(samples: tuple[Sample, ...]) -> tuple[Sample, ...]:
        return tuple(s for s in samples if not any(outage.has(s.t_s) for outage in outages))

    return msgspec.structs.replace(
        batch, gnss=keep(batch.gnss), headings=keep(batch.headings), base=keep(batch.base)
    )


def localize(
    batches: Iterable[SensorBatch],
    passes: Sequence[LogPass],
    taps: Sequence[Tap] = (),
) -> None:
    """Feed every pass with the batches; the taps get the ticks of the first."""
    for batch in batches:
        ticks = [each.update(batch) for each in passes]
        for tap in taps:
            tap(ticks[0])
