"""One robot of a batch, driven by the stack's own classes on the very same readings."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.control.follower import Follower
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.plan.mission import Mission
from agribot.autonomy.plan.rows import lay_rows
from agribot.core.geo import MapFrame
from agribot.core.messages import (
    DriveCommand,
    GnssFix,
    GnssHeading,
    GnssQuality,
    ImuSample,
    MagSample,
    Path,
    RowLine,
    SensorBatch,
    WheelSample,
)
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.batch.compass import BatchYaw
from agribot.lab.bench.nav.batch.gnss import BatchFix
from agribot.lab.bench.nav.batch.localizer import BatchHeading
from agribot.lab.bench.nav.batch.row_lines import BatchLine
from agribot.lab.bench.nav.missions import Reading
from agribot.lab.bench.nav.scenario import DT_S, TICK_STEPS, Scenario
from tests.autonomy.plan.paper_task import PaperTask

TICK_S = TICK_STEPS * DT_S


class SingleRobot:
    def __init__(self, index: int, scenario: Scenario, robot: RobotSpec, path: Path) -> None:
        field = scenario.field()
        self.localizer = Localizer(scenario.estimate(), field, robot)
        self.mission = Mission(PaperTask(lambda _: path, lay_rows(field)), scenario.mission())
        self._follower = Follower(scenario.control(), robot)
        self._index, self._radius_m = index, robot.drive.wheel_radius_m
        self._frame = MapFrame(field.datum)
        self._is_corrected = scenario.gnss.is_corrected
        self._driven_m = 0.0
        self.localizer.update(SensorBatch(t_s=0.0, wheels=(self._wheels(0.0),)))

    def tick(
        self, t_s: float, distance_m: float, turn_rad: float, readings: Sequence[Reading]
    ) -> DriveCommand:
        self._driven_m += distance_m
        rate, v_mps = turn_rad / TICK_S, distance_m / TICK_S
        imu = ImuSample(t_s=t_s, gyro_radps=(0.0, 0.0, rate), accel_mps2=(0.0, rate * v_mps, 9.8))
        mags = [r for r in readings if isinstance(r, BatchYaw)]
        fixes = [r for r in readings if isinstance(r, BatchFix)]
        headings = [r for r in readings if isinstance(r, BatchHeading)]
        estimate = self.localizer.update(
            SensorBatch(
                t_s=t_s,
                wheels=(self._wheels(t_s),),
                imu=(imu,),
                mag=tuple(self._mag(mag.t_s, float(mag.yaw_map_rad[self._index])) for mag in mags),
                gnss=tuple(self._fix(fix) for fix in fixes),
                headings=tuple(
                    GnssHeading(
                        t_s=h.t_s, yaw_map_rad=float(h.yaw_map_rad[self._index]), std_rad=h.std_rad
                    )
                    for h in headings
                    if math.isfinite(h.yaw_map_rad[self._index])
                ),
            )
        )
        goal = self.mission.step(estimate)
        command, _ = self._follower.step(estimate, goal, TICK_S)
        for reading in readings:
            if isinstance(reading, BatchLine):
                self.localizer.observe_line(self._line(reading))
        return command

    def _wheels(self, t_s: float) -> WheelSample:
        angle = self._driven_m / self._radius_m
        return WheelSample(t_s=t_s, angle_rad=(angle,) * 4, speed_radps=(0.0,) * 4)

    def _mag(self, t_s: float, yaw_rad: float) -> MagSample:
        north_rad = math.pi / 2.0 - yaw_rad
        return MagSample(t_s=t_s, field_t=(math.cos(north_rad), math.sin(north_rad), 0.0))

    def _fix(self, fix: BatchFix) -> GnssFix:
        i = self._index
        lat, lon, alt = self._frame.geodetic_from_map(float(fix.east_m[i]), float(fix.north_m[i]))
        corrected = GnssQuality.RTK_FLOAT if fix.is_float[i] else GnssQuality.RTK_FIXED
        return GnssFix(
            t_s=fix.t_s, lat_deg=lat, lon_deg=lon, alt_m=alt, pos_std_m=float(fix.pos_std_m[i]),
            quality=corrected if self._is_corrected else GnssQuality.SINGLE,
            velocity_mps=(float(fix.east_mps[i]), float(fix.north_mps[i]), 0.0),
            velocity_std_mps=fix.velocity_std_mps,
        )  # fmt: skip

    def _line(self, line: BatchLine) -> RowLine:
        offset, heading, start, end = (
            float(values[self._index]) if math.isfinite(values[self._index]) else None
            for values in (line.offset_m, line.heading_rad, line.start_ahead_m, line.end_ahead_m)
        )
        return RowLine(
            t_s=line.t_s, offset_m=offset, heading_rad=heading, start_ahead_m=start,
            end_ahead_m=end, offset_std_m=line.offset_std_m,
            heading_std_rad=line.heading_std_rad, range_std_m=line.range_std_m,
        )  # fmt: skip
