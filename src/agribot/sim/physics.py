"""The robot as a rigid body on soil: build, spawn, settle, advance."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from agribot.core.errors import PlatformError
from agribot.core.geo import rotation_from_rpy
from agribot.core.implement.kind import Pull
from agribot.core.messages import DriveCommand, FloatArray
from agribot.core.robot import DriveSpec, RobotSpec
from agribot.core.world import Obstacle, WorldSpec
from agribot.sim import kernel
from agribot.sim.attitude import read_rotation
from agribot.sim.clock import NS_PER_S
from agribot.sim.engine import Engine
from agribot.sim.grip import build_friction_grid
from agribot.sim.ground_surface import GroundSurface, build_ground_surface
from agribot.sim.soil import SoilLaw, make_soil_law
from agribot.sim.state import (
    ANGULAR,
    POSITION,
    VELOCITY,
    Board,
    Inertial,
    Motor,
    count_columns,
)
from agribot.sim.tyre import POINT_CONTACT, make_envelope, make_tyre_law
from agribot.sim.walkers import place_walkers

SETTLE_S = 1.0
# Settlings on rough ground: the robot slides a little while it settles, and settles again where it
# belongs; at last it stays where it came to rest, millimetres beside its mark.
FINE_SETTLINGS = 3
# Time in which the integral of a servo takes over the error of speed that its gain alone would
# leave.
SERVO_RESET_S = 0.1
WALKER_STEP_S = 0.004  # step at which a walker near the robot is put in its place
OVERTURNED_COS = 0.17  # 80 degrees of tilt


class Physics:
    """The simulated rigid body, advanced in whole steps.

    `history` (steps + 1, `count_columns`) holds the states of the last advance. `board` is the
    drive that the motor board assumes, by default the true one. Its wheel speeds go to ideal
    servos, or with `is_effort` through a PID per wheel to torques. `ground` is that of the world,
    which other parts of the simulator share. `is_held` while hands have it in the air.
    """

    def __init__(
        self,
        robot: RobotSpec,
        world: WorldSpec,
        physics_step_ns: int,
        *,
        board: DriveSpec | None = None,
        is_effort: bool = False,
        ground: GroundSurface | None = None,
    ) -> None:
        self.step = 0
        self._names = robot.wheel_names
        wheels = len(self._names)
        self._wheel_bodies = np.arange(2, 2 + wheels, dtype=np.int64)
        self.ground = build_ground_surface(world) if ground is None else ground
        self._dt_s = physics_step_ns / NS_PER_S
        self._robot = robot
        self._walkers = world.walkers
        self._engine = Engine(robot, world, self._dt_s, is_effort=is_effort)
        radius_m, width_m = robot.drive.wheel_radius_m, robot.drive.wheel_width_m
        self._tyre = make_tyre_law(
            robot.tyre,
            radius_m,
            robot.mass_kg,
            self._engine.wheel_mass_kg,
            build_friction_grid(world),
            make_envelope(radius_m, width_m) if self.ground.is_fine else POINT_CONTACT,
            wheels,
        )
        self._terrain = self.ground.make_grid()
        self._world, self._dry_friction = world, self._tyre.ground_friction.values.copy()
        self._soil = self._make_soil_law(1.0)
        self._is_pulled = self.is_held = False
        self._limits_nm = [robot.drive.wheel_torque_nm] * wheels
        self._has_power = True
        self._bristle_m = np.zeros((wheels, 2))
        self._soil_state = np.zeros((wheels, kernel.SOIL_STATES))
        self._motor = _make_motor(robot.drive)
        self._board = _make_board(board or robot.drive, is_effort)
        self._board_state = np.zeros(kernel.BOARD_SIZE)
        x_m, y_m, z_m = robot.base_from_link(robot.imu.link)[:3, 3].tolist()
        self._inertial = Inertial(x_m, y_m, z_m, world.gravity_mps2)
        self.history = np.zeros((2, count_columns(len(self._names))))
        self._spawn(world.spawn_xy_map_m, world.spawn_yaw_map_rad)

    def command(self, drive: DriveCommand) -> None:
        """Give the motor board a new body twist, which it limits and drops after its timeout."""
        limits = self._robot.drive
        v = min(max(drive.v_mps, -limits.max_speed_mps), limits.max_speed_mps)
        top = limits.max_yaw_rate_radps
        self._board_state[kernel.BOARD_TARGET_V] = v
        self._board_state[kernel.BOARD_TARGET_YAW_RATE] = min(max(drive.yaw_rate_radps, -top), top)
        # Half a step of grace, so that rounding decides nothing.
        self._board_state[kernel.BOARD_TIME_LEFT] = limits.command_timeout_s + self._dt_s / 2

    def pull(self, pull: Pull | None) -> None:
        """Let the soil pull at the body from now on; None lets go."""
        if pull is None and not self._is_pulled:
            return
        if self.is_held:
            return
        self._is_pulled = pull is not None
        self._engine.pull_base(pull)

    def limit_torque(self, wheel: str, torque_nm: float) -> None:
        """Limit the torque of a motor, as a fault; at 0 it is dead and its wheel rolls freely.

        Raises: PlatformError: no wheel has this name.
        """
        if wheel not in self._names:
            raise PlatformError(f"no wheel '{wheel}'; there are: {', '.join(self._names)}")
        self._limits_nm[self._names.index(wheel)] = torque_nm
        self._apply_limits()

    def switch_power(self, *, is_on: bool) -> None:
        """Give the motors their power or take it, as a contactor does; without it, wheels roll.

        Who gets it back begins anew: the board's controllers have wound up meanwhile.
        """
        if is_on == self._has_power:
            return
        self._has_power = is_on
        self._board_state[kernel.BOARD_HOLD] = 0.0
        self._apply_limits()

    def _apply_limits(self) -> None:
        for number, limit_nm in enumerate(self._limits_nm):
            self._engine.limit_torque(number, limit_nm if self._has_power else 0.0)

    def set_mud(self, ratio: float) -> None:
        """Let the ground have this share of its strength and friction from now on; 1 is no mud."""
        tyre, friction = self._tyre, self._dry_friction
        if ratio != 1.0:
            most = max(tyre.friction_longitudinal, tyre.friction_lateral)
            friction = ratio * np.minimum(friction, most)
        tyre.ground_friction.values[:] = friction
        self._soil = self._make_soil_law(ratio)

    def find_place_and_left(self) -> FloatArray:
        """Return base_link's position in the map and the level unit vector to its left, (2, 3)."""
        row = self.history[-1]
        left = read_rotation(row)[:, 1] * (1.0, 1.0, 0.0)
        return np.stack([row[POSITION], left / np.linalg.norm(left)])

    def find_rise_m(self, here: FloatArray, there: FloatArray) -> float:
        """Return how much higher the ground is at another place of the map."""
        from_m, to_m = (self._sample_ground_m(*p[:2].tolist()) for p in (here, there))
        return to_m - from_m

    def hold(
        self, place_m: FloatArray, velocity_mps: FloatArray, acceleration_mps2: FloatArray
    ) -> None:
        """Hold base_link in the air like this, (3,) each in the map, until it is let go.

        It does not turn. What holds it carries its weight, which the accelerometer feels.
        """
        views = self._engine.views
        views.qpos[:3], views.qvel[:3], views.qvel[3:6] = place_m, velocity_mps, 0.0
        row = self.history[-1]
        row[POSITION], row[VELOCITY], row[ANGULAR] = place_m, velocity_mps, 0.0
        felt_mps2 = acceleration_mps2 + np.array([0.0, 0.0, self._inertial.gravity_mps2])
        self._engine.hold_base(felt_mps2 * self._engine.mass_kg)
        self._bristle_m[:] = 0.0
        self.is_held = True

    def twist(self, torque_nm: float) -> None:
        """Let a torque act on the body about its width until the next call, its front up."""
        self._engine.twist_base(-torque_nm * read_rotation(self.history[-1])[:, 1])

    def let_go(self) -> None:
        """Let the robot stand on its own wheels again."""
        self._engine.hold_base(None)
        self.is_held = False

    def find_place_map_m(self, ahead_m: float) -> tuple[float, float, float]:
        """Return the place on the ground `ahead_m` ahead of the robot's middle: East, North, up."""
        row = self.history[-1]
        ahead = read_rotation(row)[:2, 0]
        x_m, y_m = (row[:2] + ahead_m * ahead / np.linalg.norm(ahead)).tolist()
        return x_m, y_m, self._sample_ground_m(x_m, y_m)

    def add_obstacle(self, obstacle: Obstacle) -> None:
        """Put up an obstacle, as a fault."""
        self._engine.add_obstacle(obstacle)

    def find_contact_body_m(self) -> tuple[float, float] | None:
        """Return where the robot touches an obstacle, x and y in the body frame, or None."""
        place = self._engine.find_contact_map_m()
        if place is None:
            return None
        row = self.history[-1]
        x_m, y_m, _ = (read_rotation(row).T @ (place - row[POSITION])).tolist()
        return x_m, y_m

    def find_touched(self) -> str | None:
        """Return the name of the obstacle or walker that the robot touches, None if none."""
        return self._engine.find_touched()

    def advance(self, steps: int) -> FloatArray:
        """Advance and return the history (steps + 1, columns): row 0 is the state before.

        Raises: PlatformError: the state is not finite any more, or the robot has overturned.
        """
        if len(self.history) != steps + 1:
            grown = np.zeros((steps + 1, self.history.shape[1]))
            grown[0] = self.history[-1]
            self.history = grown
        else:
            self.history[0] = self.history[-1]
        done = 0
        while done < steps:
            count = self._count_steps(steps - done)
            self._run(self.history[done : done + count + 1], count)
            done += count
        if not math.isfinite(self.history[-1].sum()):
            raise PlatformError(
                f"the physics diverged at t = {self.step * self._dt_s:.3f} s; lower sim.step_s "
                "or check masses and tyre stiffness in the robot description"
            )
        x, y = self.history[-1, 4:6].tolist()
        if 1.0 - 2.0 * (x * x + y * y) < OVERTURNED_COS:
            raise PlatformError(
                f"the robot overturned at t = {self.step * self._dt_s:.2f} s, "
                f"x = {self.history[-1, 0]:.2f} m, y = {self.history[-1, 1]:.2f} m; "
                "keep it off obstacles and steep ground"
            )
        return self.history

    def _count_steps(self, most: int) -> int:
        """Choose the model and return for how many steps it holds: few beside a walker."""
        poses = place_walkers(self._walkers, self.ground, self.step * self._dt_s)
        is_walker_near = self._engine.select(poses)
        return min(most, max(1, round(WALKER_STEP_S / self._dt_s))) if is_walker_near else most

    def _run(self, history: FloatArray, steps: int) -> None:
        engine = self._engine
        kernel.advance(
            steps, engine.library, engine.views, self._wheel_bodies, self._tyre, self._soil,
            self._terrain, self._bristle_m, self._soil_state, self._board, self._board_state,
            self._motor, self._inertial, self._dt_s, history,
        )  # fmt: skip
        self.step += steps

    def _make_soil_law(self, mud_ratio: float) -> SoilLaw:
        return make_soil_law(
            self._robot,
            self._world,
            self._engine.wheel_mass_kg,
            self.ground.make_sunk_grid(),
            mud_ratio,
        )

    def _spawn(self, xy_map_m: tuple[float, float], yaw_rad: float) -> None:
        """Put the robot on its wheels at the exact place and heading, at rest, at step 0."""
        start = self._find_standing_pose(xy_map_m, yaw_rad)
        qpos, qvel = self._engine.views.qpos, self._engine.views.qvel
        qpos[:7] = start
        self.history[-1, :7] = start
        for left in reversed(range(FINE_SETTLINGS if self.ground.is_fine else 1)):
            self.advance(round(SETTLE_S / self._dt_s))
            if left or not self.ground.is_fine:
                self._move_to(xy_map_m, yaw_rad)
        qpos[7:] = 0.0
        qvel[:] = 0.0
        # The torque that holds the robot on its slope stays.
        held_nm = self._board_state[kernel.BOARD_HOLD].copy()
        self._board_state[:] = 0.0
        self._board_state[kernel.BOARD_HOLD] = held_nm
        self.step = 0
        self.history = np.zeros((2, count_columns(len(self._names))))
        self.history[-1, :7] = qpos[:7]

    def _move_to(self, xy_map_m: tuple[float, float], yaw_rad: float) -> None:
        """Move the robot from where it has slid to, to the exact place and heading."""
        qpos = self._engine.views.qpos
        w, x, y, z = qpos[3:7]
        drift = yaw_rad - math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        turned = np.zeros(4)
        mujoco.mju_mulQuat(
            turned, np.array([math.cos(drift / 2), 0, 0, math.sin(drift / 2)]), qpos[3:7]
        )
        slid_x_m, slid_y_m = (qpos[:2] - self._compute_base_offset(qpos[3:7])[:2]).tolist()
        qpos[3:7] = turned
        qpos[:2] = xy_map_m + self._compute_base_offset(turned)[:2]
        slid_m = self._find_ground_m((slid_x_m, slid_y_m), yaw_rad)
        qpos[2] += self._find_ground_m(xy_map_m, yaw_rad) - slid_m

    def _find_ground_m(self, xy_map_m: tuple[float, float], yaw_rad: float) -> float:
        """Return the height of the ground below the robot, on rough ground that of its wheels."""
        if self.ground.is_fine:
            return float(self._fit_ground_plane(xy_map_m, yaw_rad)[2])
        return self._sample_ground_m(*xy_map_m)

    def _sample_ground_m(self, x_m: float, y_m: float) -> float:
        return kernel.sample_grid(self._terrain, x_m, y_m)[0]

    def _fit_ground_plane(self, xy_map_m: tuple[float, float], yaw_rad: float) -> FloatArray:
        """Return the plane (3,) under the wheels: slopes ahead and to the left, height below."""
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        wheels = self._robot.wheel_xy_body_m() @ np.array([[cos, sin], [-sin, cos]]) + xy_map_m
        envelope = self._tyre.envelope
        heights = [
            kernel.sample_envelope(self._terrain, envelope, x, y, cos, sin)[0]
            for x, y in wheels.tolist()
        ]
        columns = np.column_stack((self._robot.wheel_xy_body_m(), np.ones(len(wheels))))
        plane: FloatArray = np.linalg.lstsq(columns, np.array(heights), rcond=None)[0]
        return plane

    def _compute_base_offset(self, quaternion: FloatArray) -> FloatArray:
        """Return the vector (3,) from the body frame's origin to base_link, in map axes."""
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, quaternion)
        return rotation.reshape(3, 3)[:, 2] * self._robot.base_height_m

    def _find_standing_pose(self, xy_map_m: tuple[float, float], yaw_rad: float) -> FloatArray:
        """Return base position and quaternion (7,), the wheels on the plane of their ground."""
        slope_x, slope_y, height = self._fit_ground_plane(xy_map_m, yaw_rad)
        tilt = rotation_from_rpy(math.atan(slope_y), -math.atan(slope_x), yaw_rad)
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, tilt.ravel())
        origin = np.array([*xy_map_m, height])
        return np.concatenate((origin + tilt[:, 2] * self._robot.base_height_m, quaternion))


def _make_board(drive: DriveSpec, is_effort: bool) -> Board:
    gains = (drive.servo_gain_nmspr, drive.servo_gain_nmspr / SERVO_RESET_S, 0.0)
    if is_effort:
        gains = (drive.pid_p_nmspr, drive.pid_i_nmprad, drive.pid_d_nms2prad)
    return Board(
        drive.max_accel_mps2,
        drive.max_yaw_accel_radps2,
        drive.wheel_radius_m,
        drive.effective_separation_m / 2.0,
        is_effort,
        *gains,
        drive.wheel_torque_nm,
    )


def _make_motor(drive: DriveSpec) -> Motor:
    return Motor(
        drive.torque_constant_nmpa,
        drive.winding_ohm,
        drive.no_load_a,
        drive.gear_efficiency_ratio,
        drive.controller_efficiency_ratio,
        drive.regeneration_ratio,
    )
