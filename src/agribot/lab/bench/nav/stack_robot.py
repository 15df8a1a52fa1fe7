"""One robot of the benchmark that the stack's own filter, mission and follower drive."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.control.follower import Follower
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.plan.mission import Mission
from agribot.autonomy.plan.task import Task
from agribot.core.messages import (
    DriveCommand,
    GnssFix,
    GnssHeading,
    ImuSample,
    MagSample,
    RowLine,
    Scene,
    SensorBatch,
    WheelSample,
)
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.batch.row_lines import BatchLine
from agribot.lab.bench.nav.scenario import DT_S, TICK_STEPS, Scenario

TICK_S = TICK_STEPS * DT_S
GRAVITY_MPS2 = 9.8


class StackRobot:
    """Takes what the plant's sensors show within a tick, and gives the command of the follower."""

    def __init__(self, scenario: Scenario, robot: RobotSpec, task: Task) -> None:
        self.localizer = Localizer(scenario.estimate(), scenario.field(), robot)
        self.mission = Mission(task, scenario.mission())
        self._follower = Follower(scenario.control(), robot)
        self._drive = robot.drive
        self._driven_m = self._wheels_turned_rad = 0.0
        self._frames = 0
        self.estimate = self.localizer.update(
            SensorBatch(t_s=0.0, wheels=(self._read_wheels(0.0),))
        )
        self.goal = self.mission.step(self.estimate)

    def tick(
        self,
        t_s: float,
        distance_m: float,
        turn_rad: float,
        *,
        wheels_turned_rad: float = 0.0,
        mag: Sequence[MagSample] = (),
        gnss: Sequence[GnssFix] = (),
        headings: Sequence[GnssHeading] = (),
    ) -> DriveCommand:
        """Estimate, plan and steer; `turn_rad` is that of the gyro."""
        self._driven_m += distance_m
        self._wheels_turned_rad += wheels_turned_rad
        batch = SensorBatch(
            t_s=t_s, wheels=(self._read_wheels(t_s),), imu=(_feel(t_s, distance_m, turn_rad),),
            mag=tuple(mag), gnss=tuple(gnss), headings=tuple(headings),
        )  # fmt: skip
        self.estimate = self.localizer.update(batch)
        on_path = self.mission.relate_to_path(self.estimate)
        self.goal = self.mission.step(on_path)
        command, _ = self._follower.step(on_path, self.goal, TICK_S)
        return command

    def see(self, line: RowLine) -> None:
        """Show a picture, with or without a row in it."""
        self._frames += 1
        has_line = (line.offset_m, line.start_ahead_m, line.end_ahead_m) != (None, None, None)
        scene = Scene(
            t_s=line.t_s, ready_s=self.estimate.t_s, frame_index=self._frames, plants=(),
            view_body_m=(), row_line=line if has_line else None,
        )  # fmt: skip
        if not self.localizer.is_stale(scene):
            self.localizer.observe(scene)

    def _read_wheels(self, t_s: float) -> WheelSample:
        half_m = self._drive.track_m * self._drive.yaw_multiplier / 2.0
        aside_m = half_m * self._wheels_turned_rad
        left_rad = (self._driven_m - aside_m) / self._drive.wheel_radius_m
        right_rad = (self._driven_m + aside_m) / self._drive.wheel_radius_m
        turned_rad = (right_rad, left_rad, right_rad, left_rad)
        return WheelSample(t_s=t_s, angle_rad=turned_rad, speed_radps=(0.0,) * 4)


def _feel(t_s: float, distance_m: float, turn_rad: float) -> ImuSample:
    rate_radps, v_mps = turn_rad / TICK_S, distance_m / TICK_S
    return ImuSample(
        t_s=t_s, gyro_radps=(0.0, 0.0, rate_radps),
        accel_mps2=(0.0, rate_radps * v_mps, GRAVITY_MPS2),
    )  # fmt: skip


def pick_line(line: BatchLine, index: int) -> RowLine:
    """Take what the camera of one robot shows; what it does not see is None."""
    offset, heading, start, end = (
        float(values[index]) if math.isfinite(values[index]) else None
        for values in (line.offset_m, line.heading_rad, line.start_ahead_m, line.end_ahead_m)
    )
    return RowLine(
        t_s=line.t_s, offset_m=offset, heading_rad=heading, start_ahead_m=start,
        end_ahead_m=end, offset_std_m=line.offset_std_m,
        heading_std_rad=line.heading_std_rad, range_std_m=line.range_std_m,
    )  # fmt: skip
