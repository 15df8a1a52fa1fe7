"""MuJoCo with the robot in it, and with the obstacles while they are near.

A step costs half as much without 120 fixed shapes, and the motion is the same to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import mujoco
import numpy as np

from agribot.core.implement.kind import Pull
from agribot.core.messages import FloatArray
from agribot.core.robot import RobotSpec
from agribot.core.world import Obstacle, WorldSpec
from agribot.sim.mujoco_library import Library, load_library
from agribot.sim.rigid_body import PART_MARK, WALKER, build_model, find_obstacle_boxes
from agribot.sim.state import StateViews
from agribot.sim.walkers import measure_radius_m

# The robot's own size plus far more than it moves in one tick.
NEAR_M = 1.5
RECHECK_M = 0.2
BASE_BODY = 1


class _Instance:
    """One compiled model and its state."""

    def __init__(self, robot: RobotSpec, world: WorldSpec, step_s: float, is_effort: bool) -> None:
        self.model = build_model(robot, world, step_s, is_effort=is_effort)
        self.data = data = mujoco.MjData(self.model)
        self.library = load_library(self.model, data)
        self.views = StateViews(
            data.qpos, data.qvel, data.ctrl, data.actuator_force, data.xpos, data.xipos,
            data.xmat, data.cvel, data.subtree_com, data.xfrc_applied,
        )  # fmt: skip


class Engine:
    """Two MuJoCo models, with and without obstacles, and the choice between them.

    `library` and `views` belong to the model in use; `select` may exchange them.
    """

    def __init__(
        self, robot: RobotSpec, world: WorldSpec, step_s: float, *, is_effort: bool = False
    ) -> None:
        self._robot, self._world, self._step_s = robot, world, step_s
        self._is_effort = is_effort
        self._boxes = find_obstacle_boxes(world)
        self._radius_m = [measure_radius_m(walker.shapes) for walker in world.walkers]
        empty = msgspec.structs.replace(world, obstacles=(), walkers=())
        self._open = _Instance(robot, empty, step_s, is_effort)
        self._open.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self._crowded: _Instance | None = None
        self._used = self._open
        self._checked_at_m, self._check_after_m = (0.0, 0.0), -1.0
        self._is_obstacle_near = False
        self.wheel_mass_kg = float(self._open.model.body_mass[2])
        self.mass_kg = float(self._open.model.body_subtreemass[BASE_BODY])

    @property
    def library(self) -> Library:
        return self._used.library

    @property
    def views(self) -> StateViews:
        return self._used.views

    def limit_torque(self, wheel: int, torque_nm: float) -> None:
        """Limit the torque of a motor; at 0 it is dead and its wheel rolls freely."""
        for instance in (self._open, self._crowded):
            if instance is not None:
                instance.model.actuator_forcerange[wheel] = -torque_nm, torque_nm

    def pull_base(self, pull: Pull | None) -> None:
        """Let a force act on the base until the next call; None is no force."""
        views = self._used.views
        if pull is None:
            views.xfrc_applied[BASE_BODY] = 0.0
            return
        arm_m = np.array(pull.place_map_m) - views.xipos[BASE_BODY]
        views.xfrc_applied[BASE_BODY, :3] = pull.force_map_n
        views.xfrc_applied[BASE_BODY, 3:] = np.cross(arm_m, pull.force_map_n)

    def hold_base(self, force_map_n: FloatArray | None) -> None:
        """Apply a force (3,) at the robot's centre of mass until the next call; None removes it."""
        views = self._used.views
        views.xfrc_applied[BASE_BODY] = 0.0
        if force_map_n is not None:
            arm_m = views.subtree_com[BASE_BODY] - views.xipos[BASE_BODY]
            views.xfrc_applied[BASE_BODY, :3] = force_map_n
            views.xfrc_applied[BASE_BODY, 3:] = np.cross(arm_m, force_map_n)

    def twist_base(self, torque_map_nm: FloatArray) -> None:
        """Let a torque (3,) act on the base until the next call."""
        self._used.views.xfrc_applied[BASE_BODY, 3:] = torque_map_nm

    def add_obstacle(self, obstacle: Obstacle) -> None:
        """Put up an obstacle; the model with obstacles is built anew when one is near."""
        obstacles = (*self._world.obstacles, obstacle)
        self._world = msgspec.structs.replace(self._world, obstacles=obstacles)
        self._boxes = find_obstacle_boxes(self._world)
        self._crowded = None
        self._check_after_m = -1.0

    def find_contact_map_m(self) -> FloatArray | None:
        """Return where in the map the robot touches an obstacle, (3,); None if it does not."""
        data = self._used.data
        return None if self._used is self._open or not data.ncon else data.contact.pos[0]

    def find_touched(self) -> str | None:
        """Return the name of the obstacle or walker that the robot touches, None if none."""
        data, model = self._used.data, self._used.model
        if self._used is self._open or not data.ncon:
            return None
        pair = data.contact.geom[0].tolist()
        name = next(filter(None, (model.geom(geom).name for geom in pair)), "")
        return str(name.rpartition(PART_MARK)[0]).removeprefix(WALKER)

    def select(self, walker_poses: Sequence[FloatArray] = ()) -> bool:
        """Use the model with obstacles where one is near, else the one without.

        `walker_poses` (4, 4) are those of the world's walkers now; returns whether one is near.
        """
        x_m, y_m = self._used.views.qpos[:2].tolist()
        moved_m = math.hypot(x_m - self._checked_at_m[0], y_m - self._checked_at_m[1])
        if moved_m >= self._check_after_m:
            free_m = self._measure_gap_m(x_m, y_m) - NEAR_M
            self._checked_at_m, self._check_after_m = (x_m, y_m), max(free_m, RECHECK_M)
            self._is_obstacle_near = free_m <= 0.0
        is_walker_near = any(
            math.hypot(pose[0, 3] - x_m, pose[1, 3] - y_m) - radius_m <= NEAR_M
            for pose, radius_m in zip(walker_poses, self._radius_m, strict=True)
        )
        is_crowded = self._is_obstacle_near or is_walker_near
        self._use(self._load_crowded() if is_crowded else self._open)
        if is_crowded:
            self._place_walkers(walker_poses)
        return is_walker_near

    def _place_walkers(self, poses: Sequence[FloatArray]) -> None:
        data = self._used.data
        for index, pose in enumerate(poses):
            data.mocap_pos[index] = pose[:3, 3]
            mujoco.mju_mat2Quat(data.mocap_quat[index], np.ascontiguousarray(pose[:3, :3]).ravel())

    def _measure_gap_m(self, x_m: float, y_m: float) -> float:
        """Return the distance from base_link to the nearest obstacle's box, in plan view."""
        boxes: FloatArray = self._boxes
        beyond_m = np.maximum(np.abs(boxes[:, :2] - (x_m, y_m)) - boxes[:, 2:], 0.0)
        return float(np.hypot(beyond_m[:, 0], beyond_m[:, 1]).min(initial=math.inf))

    def _load_crowded(self) -> _Instance:
        if self._crowded is None:
            self._crowded = _Instance(self._robot, self._world, self._step_s, self._is_effort)
            self._crowded.model.actuator_forcerange[:] = self._open.model.actuator_forcerange
        return self._crowded

    def _use(self, wanted: _Instance) -> None:
        used = self._used
        if wanted is not used:
            for name in ("qpos", "qvel", "ctrl", "qacc_warmstart", "xfrc_applied"):
                of_robot = slice(min(len(getattr(i.data, name)) for i in (wanted, used)))
                getattr(wanted.data, name)[of_robot] = getattr(used.data, name)[of_robot]
            self._used = wanted
