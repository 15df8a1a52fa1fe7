"""The simulator's sensors on the rover of the benchmark, and its camera of row lines."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.core.config import RunConfig
from agribot.core.geo import MapFrame, wrap_rad
from agribot.core.messages import (
    GnssFix,
    GnssHeading,
    GnssQuality,
    RowLine,
    Scene,
    SensorBatch,
)
from agribot.core.pose import Pose2
from agribot.core.robot import DriveSpec, RobotSpec
from agribot.core.world import WorldSpec
from agribot.lab.bench.nav.plant import MOVING_MPS, SoilRover
from agribot.lab.bench.nav.row_camera import PERIOD_STEPS, RowCamera
from agribot.lab.bench.nav.scenario import DT_S, TICK_STEPS, Perfect, Scenario
from agribot.sim.clock import round_step_ns
from agribot.sim.sensors.suite import SensorSuite
from agribot.sim.state import (
    ANGLE_GAIN,
    ANGULAR,
    HISTORY_COLUMNS,
    POSITION,
    QUATERNION,
    TORQUE,
    VELOCITY,
    VELOCITY_GAIN,
    WHEEL_ANGLE,
)

STEP_NS = round_step_ns(DT_S)
IMU_HZ = 1.0 / DT_S  # rate of the IMU; the plant has no faster motion
GRAVITY_MPS2 = 9.8
PERFECT_STD_M, PERFECT_STD_RAD = 0.014, 0.007  # as `rtk-dual` states them
# Torque of all motors, for the field of their currents. Measured: a drive of `rows-10x12` on the
# preset `field`, seed 1, 45 s, along rows and in turns.
ROLLING_NM, TURNING_NMSPR = 0.55, 2.4


class TrueMotion:
    """The motion of a rover as rows of the simulator's history, on level ground."""

    def __init__(self, drive: DriveSpec) -> None:
        self._drive = drive
        self._wheels_rad = [0.0, 0.0]  # right and left
        self._gains = [0.0] * 6  # errors of velocity, m/s, and angle, rad
        self._last_mps = (0.0, 0.0)
        self.rows = np.zeros((TICK_STEPS + 1, HISTORY_COLUMNS))
        self.rows[:, QUATERNION.start] = 1.0

    def write(self, index: int, rover: SoilRover) -> None:
        """Write the state after a step of the plant as row `index`."""
        row = self.rows[index]
        half_rad = rover.yaw_rad / 2.0
        row[POSITION] = (rover.x_m, rover.y_m, 0.0)
        row[QUATERNION] = (math.cos(half_rad), 0.0, 0.0, math.sin(half_rad))
        row[VELOCITY] = (*rover.velocity_mps, 0.0)
        row[ANGULAR.stop - 1] = rover.yaw_rate_radps
        row[VELOCITY_GAIN.start : ANGLE_GAIN.stop] = self._feel(rover)
        right_rad, left_rad = self._turn_wheels(rover)
        row[WHEEL_ANGLE] = (right_rad, left_rad, right_rad, left_rad)
        moving = min(1.0, abs(rover.wheel_mps) / MOVING_MPS)
        row[TORQUE] = ROLLING_NM * moving + TURNING_NMSPR * abs(rover.wheel_radps)

    def _feel(self, rover: SoilRover) -> list[float]:
        """Integrate specific force and angular rate, in body axes."""
        v_mps, lateral_mps, rate_radps = rover.v_mps, rover.lateral_mps, rover.yaw_rate_radps
        gains, (last_mps, last_lateral_mps) = self._gains, self._last_mps
        gains[0] += v_mps - last_mps - rate_radps * lateral_mps * DT_S
        gains[1] += lateral_mps - last_lateral_mps + rate_radps * v_mps * DT_S
        gains[2] += GRAVITY_MPS2 * DT_S
        gains[5] += rate_radps * DT_S
        self._last_mps = v_mps, lateral_mps
        return gains

    def _turn_wheels(self, rover: SoilRover) -> list[float]:
        left_radps, right_radps = self._drive.wheel_speeds_radps(rover.wheel_mps, rover.wheel_radps)
        self._wheels_rad[0] += right_radps * DT_S
        self._wheels_rad[1] += left_radps * DT_S
        return self._wheels_rad


class Sensors:
    """Wheels, IMU, magnetometer, receiver and camera of one rover."""

    def __init__(
        self, config: RunConfig, robot: RobotSpec, perfect: Sequence[Perfect] = ()
    ) -> None:
        """Build the sensors of `config.sim.sensors` and `config.seed`.

        Raises: ConfigError: no preset has this name.
        """
        imu = msgspec.structs.replace(robot.imu, rate_hz=IMU_HZ)
        robot = msgspec.structs.replace(robot, imu=imu)
        world = WorldSpec(name="bench", datum=config.field.datum, gravity_mps2=GRAVITY_MPS2)
        self._suite = SensorSuite(config, robot, world, STEP_NS)
        self._truth = TrueMotion(robot.drive)
        self._oracle = Oracle(config, robot, perfect) if perfect else None
        self._step = 0

    def step(self, rover: SoilRover) -> None:
        """Note the state of the rover after a step of the plant."""
        self._truth.write(self._step % TICK_STEPS + 1, rover)
        self._step += 1
        if self._oracle is not None:
            self._oracle.note(rover)

    def read(self) -> SensorBatch:
        """Read the measurements of the last `TICK_STEPS` steps, or of earlier ones."""
        last, suite, rows = self._step, self._suite, self._truth.rows
        first, t_s = last - TICK_STEPS, last * DT_S
        batch = SensorBatch(
            t_s=t_s,
            wheels=suite.wheels.take_samples(first, last, rows),
            imu=suite.imu.take_samples(first, last, rows),
            mag=suite.mag.take_samples(first, last, rows) if suite.mag else (),
            gnss=suite.gnss.take_samples(first, last, rows, t_s),
            headings=suite.headings.take_samples(first, last, rows, t_s) if suite.headings else (),
        )
        return batch if self._oracle is None else self._oracle.alter(batch)


class Oracle:
    """Replaces measurements by the truth, with the stated accuracy of the best receiver."""

    def __init__(self, config: RunConfig, robot: RobotSpec, perfect: Sequence[Perfect]) -> None:
        self._frame, self._perfect = MapFrame(config.field.datum), perfect
        x_m, y_m, z_m = robot.body_from_link(robot.gnss.link)[:3, 3].tolist()
        self._arm_m, self._height_m = (x_m, y_m), z_m
        self._poses = [Pose2(0.0, 0.0, 0.0)]  # pose of each step

    def note(self, rover: SoilRover) -> None:
        """Note where the rover is after a step of the plant."""
        self._poses.append(Pose2(rover.x_m, rover.y_m, rover.yaw_rad))

    def alter(self, batch: SensorBatch) -> SensorBatch:
        """Return the batch with the truth for each fix that arrived."""
        headings, fixes = batch.headings, batch.gnss
        if "heading" in self._perfect:
            headings = tuple(
                GnssHeading(
                    t_s=fix.t_s, yaw_map_rad=wrap_rad(self._find_pose(fix.t_s).yaw_rad),
                    std_rad=PERFECT_STD_RAD,
                )
                for fix in fixes
            )  # fmt: skip
        if "fixes" in self._perfect:
            fixes = tuple(map(self._correct, fixes))
        return msgspec.structs.replace(batch, gnss=fixes, headings=headings)

    def _find_pose(self, t_s: float) -> Pose2:
        return self._poses[round(t_s / DT_S)]

    def _correct(self, fix: GnssFix) -> GnssFix:
        place_m = self._find_pose(fix.t_s).transform(*self._arm_m)
        lat_deg, lon_deg, alt_m = self._frame.geodetic_from_map(*place_m, self._height_m)
        return msgspec.structs.replace(
            fix, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=alt_m, pos_std_m=PERFECT_STD_M,
            quality=GnssQuality.RTK_FIXED,
        )  # fmt: skip


class Eyes:
    """The row lines of one rover on their way to it, as scenes of the camera."""

    def __init__(self, seed: int, scenario: Scenario) -> None:
        vision = scenario.vision
        self._camera = None if vision is None else RowCamera(seed, scenario, vision)
        self._latency_s = 0.0 if vision is None else vision.latency_s
        self._late: deque[tuple[float, RowLine | None]] = deque()
        self._frames = 0

    def step(self, k: int, rover: SoilRover) -> None:
        """Take a picture at step `k` if one is due."""
        if self._camera is not None and k % PERIOD_STEPS == 0:
            self._late.append((k * DT_S, self._camera.sample(k * DT_S, rover)))

    def take(self, t_s: float) -> list[Scene]:
        """Take what has come out of the camera by `t_s`."""
        arrived = []
        while self._late and self._late[0][0] + self._latency_s <= t_s + 1e-9:
            self._frames += 1
            seen_s, line = self._late.popleft()
            arrived.append(
                Scene(
                    t_s=seen_s, ready_s=t_s, frame_index=self._frames, plants=(), view_body_m=(),
                    row_line=line,
                )
            )  # fmt: skip
        return arrived
