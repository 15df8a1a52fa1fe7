"""One robot of a batch, driven by the stack's own classes on the very same readings."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.plan.rows import lay_rows
from agribot.core.geo import MapFrame
from agribot.core.messages import (
    DriveCommand,
    GnssFix,
    GnssHeading,
    GnssQuality,
    MagSample,
    Path,
)
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.batch.compass import BatchYaw
from agribot.lab.bench.nav.batch.gnss import BatchFix
from agribot.lab.bench.nav.batch.localizer import BatchHeading
from agribot.lab.bench.nav.batch.row_lines import BatchLine
from agribot.lab.bench.nav.missions import Reading
from agribot.lab.bench.nav.scenario import Scenario
from agribot.lab.bench.nav.stack_robot import StackRobot, pick_line
from tests.autonomy.plan.paper_task import PaperTask


class SingleRobot:
    def __init__(self, index: int, scenario: Scenario, robot: RobotSpec, path: Path) -> None:
        task = PaperTask(lambda _: path, lay_rows(scenario.field()))
        self._robot = StackRobot(scenario, robot, task)
        self.localizer, self.mission = self._robot.localizer, self._robot.mission
        self._index = index
        self._frame = MapFrame(scenario.field().datum)
        self._is_corrected = scenario.gnss.is_corrected

    def tick(
        self, t_s: float, distance_m: float, turn_rad: float, readings: Sequence[Reading]
    ) -> DriveCommand:
        mags = [r for r in readings if isinstance(r, BatchYaw)]
        fixes = [r for r in readings if isinstance(r, BatchFix)]
        headings = [r for r in readings if isinstance(r, BatchHeading)]
        command = self._robot.tick(
            t_s, distance_m, turn_rad,
            mag=[self._mag(mag.t_s, float(mag.yaw_map_rad[self._index])) for mag in mags],
            gnss=[self._fix(fix) for fix in fixes],
            headings=[
                GnssHeading(
                    t_s=h.t_s, yaw_map_rad=float(h.yaw_map_rad[self._index]), std_rad=h.std_rad
                )
                for h in headings
                if math.isfinite(h.yaw_map_rad[self._index])
            ],
        )  # fmt: skip
        for reading in readings:
            if isinstance(reading, BatchLine):
                self.localizer.observe_line(pick_line(reading, self._index))
        return command

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
