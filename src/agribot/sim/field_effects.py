"""Effects of the robot on the field: plants crushed by its wheels and its belly, leaves touched.

A plant is crushed, and dead for the report, when

- a wheel runs over its stem;
- wheels press `LEAF_LIMIT` of its leaf area or more into the ground. Beets live on: half of the
  leaves costs 5 to 17 % of the yield, all of them 25 to 31 % (field trials listed by Carter,
  Traveller and Bosma 1978, J. Sugarbeet Research 20:73); half is taken as the loss that counts;
- what is not a wheel passes over its stem lower than `BEND_LIMIT` of its height, which bends an
  upright stalk 60 degrees from where it grew. No trial says where leaf stalks of beet break.

One whose leaves meet the robot in any lesser way is brushed, and lives.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray, PlantClass
from agribot.core.robot import RobotSpec
from agribot.core.world import WorldSpec
from agribot.sim.flora.crown import LEAVES, find_crown_radius_m, make_leaf_places
from agribot.sim.footprints import (
    CELL_M,
    Footprints,
    PlantGrid,
    build_plant_grid,
    list_places_m,
    mark_swept,
    project_to_ground,
)
from agribot.sim.ground_surface import GroundSurface, build_ground_surface
from agribot.sim.jit import compile_exact
from agribot.sim.kernel import sample_grid
from agribot.sim.plant_states import PlantStates
from agribot.sim.underside import Part, Underside, build_underside

LEAF_LIMIT = 0.5
BEND_LIMIT = 0.5
PASS_STEP_M = 0.02  # motion of any part of the robot after which the leaves are checked again
LONGEST_STEP_M = 0.03  # longest step; an object that moves farther in a tick is sampled on its way


class Crowns(NamedTuple):
    """Plants as the robot meets them: foot in the map, height, radius of the leaves, (N,) each.

    `pressed` (N, LEAVES) marks the shares of leaf area that were under a wheel; `touched` (N,) and
    `bent_by` (N,) are what the robot does to them now: 1 for brushed, and a `Part` or 0.
    """

    foot_z_m: FloatArray
    height_m: FloatArray
    radius_m: FloatArray
    pressed: npt.NDArray[np.bool_]
    touched: npt.NDArray[np.bool_]
    bent_by: npt.NDArray[np.uint8]


class PlantDamage:
    """Crushes and brushes the plants of a world as the robot passes; `states` hears of it."""

    def __init__(
        self,
        robot: RobotSpec,
        world: WorldSpec,
        states: PlantStates | None = None,
        ground: GroundSurface | None = None,
    ) -> None:
        plants = world.plants
        self.states = PlantStates(len(plants)) if states is None else states
        self._is_crop = np.array([p.plant == PlantClass.CROP for p in plants], dtype=bool)
        stems_m = np.array([p.stem_radius_m for p in plants], dtype=float)
        self._grid = build_plant_grid(list_places_m(plants), stems_m)
        self._hit_s = np.full(len(plants), np.nan)
        self._active = np.ones(len(robot.wheel_names), dtype=bool)
        drive = robot.drive
        load_n = robot.mass_kg * world.gravity_mps2 / len(robot.wheel_names)
        sunk_m = load_n / robot.tyre.normal_stiffness_npm
        self._feet = Footprints(
            robot.wheel_xy_body_m(),
            math.sqrt(2.0 * drive.wheel_radius_m * sunk_m),
            drive.wheel_width_m / 2.0,
            robot.base_height_m,
        )
        self._crowns = _grow_crowns(
            world, build_ground_surface(world) if ground is None else ground
        )
        self._leaf_places = make_leaf_places()
        self._underside = build_underside(robot)
        self._reach_m = _measure_reach_m(self._underside, self._feet)
        self._passed: FloatArray | None = None  # leaves at the last look
        self._passed_pose: list[float] = []
        self._way_rad = 0.0
        self._left_m: list[float] = []

    def update(self, t_s: float, before: FloatArray, after: FloatArray) -> None:
        """Mark the plants under the robot between two rows of the physics history."""
        if not self._is_crop.size:
            return
        mark_swept(before, after, self._feet, self._active, self._grid, self._hit_s, t_s)
        pose = after[:7].tolist()
        if before[:2].tolist() != self._left_m:  # lifted and put down elsewhere
            self._passed = None
        self._left_m = pose[:2]
        if self._passed is None or self._has_moved(pose):
            start = before if self._passed is None else self._passed
            self._way_rad = _find_way_rad(start, after)
            self._crush_hit()
            self._pass_over(t_s, start, after)
            self._passed, self._passed_pose = after.copy(), pose

    @property
    def crushed(self) -> set[int]:
        """The crushed crops, as indices into the world's plants."""
        self._crush_hit()
        return self._select_crops(~np.isnan(self.states.crushed_s))

    @property
    def brushed(self) -> set[int]:
        """The crops whose leaves were touched and that live, as indices."""
        self._crush_hit()
        states = self.states
        return self._select_crops(~np.isnan(states.brushed_s) & np.isnan(states.crushed_s))

    def _crush_hit(self) -> None:
        """Crush the plants whose stems wheels have met since the last call."""
        is_new = ~np.isnan(self._hit_s) & self.states.is_standing
        for index in np.flatnonzero(is_new).tolist():
            self.states.crush(index, float(self._hit_s[index]), Part.WHEEL, self._way_rad)

    def _select_crops(self, is_wanted: npt.NDArray[np.bool_]) -> set[int]:
        return set(np.flatnonzero(is_wanted & self._is_crop).tolist())

    def _has_moved(self, pose: list[float]) -> bool:
        """Return whether some part has moved since the last look; by position and quaternion."""
        before = self._passed_pose
        moved_m = math.dist(before[:2], pose[:2])
        turned_rad = 2.0 * math.dist(before[3:], pose[3:])
        return moved_m + turned_rad * self._reach_m >= PASS_STEP_M

    def _pass_over(self, t_s: float, before: FloatArray, after: FloatArray) -> None:
        """Let belly and wheels meet the leaves, in steps so small that nothing is jumped over."""
        crowns = self._crowns
        parts = math.ceil(math.dist(before[:2].tolist(), after[:2].tolist()) / LONGEST_STEP_M) or 1
        for part in range(parts):
            start, end = (before + (after - before) * (k / parts) for k in (part, part + 1))
            touch_crowns(
                start, end, self._underside, self._feet, self._grid, crowns, self._leaf_places,
                self.states.is_standing, self._reach_m,
            )  # fmt: skip
        if not crowns.touched.any():
            return
        for index in np.flatnonzero(crowns.touched).tolist():
            crowns.touched[index] = False
            if np.isnan(self.states.brushed_s[index]):
                self.states.brushed_s[index] = t_s
            if crowns.bent_by[index]:
                self.states.crush(index, t_s, Part(crowns.bent_by[index]), self._way_rad)
            elif np.count_nonzero(crowns.pressed[index]) >= LEAF_LIMIT * LEAVES:
                self.states.crush(index, t_s, Part.WHEEL, self._way_rad)


def _grow_crowns(world: WorldSpec, ground: GroundSurface) -> Crowns:
    plants, grid = world.plants, ground.make_grid()
    count = len(plants)
    foot_m = [sample_grid(grid, p.x_map_m, p.y_map_m)[0] for p in plants]
    return Crowns(
        foot_z_m=np.array(foot_m, dtype=float),
        height_m=np.array([p.size_m for p in plants], dtype=float),
        radius_m=np.array([find_crown_radius_m(p.species, p.size_m) for p in plants], dtype=float),
        pressed=np.zeros((count, LEAVES), dtype=bool),
        touched=np.zeros(count, dtype=bool),
        bent_by=np.zeros(count, np.uint8),
    )


def _measure_reach_m(underside: Underside, feet: Footprints) -> float:
    """Return how far from base_link any part of the robot is, in plan view."""
    x_m = underside.x_min_m + np.array([0.0, underside.clearance_m.shape[0] * underside.cell_m])
    y_m = underside.y_min_m + np.array([0.0, underside.clearance_m.shape[1] * underside.cell_m])
    belly_m = math.hypot(float(np.abs(x_m).max()), float(np.abs(y_m).max()))
    wheels_m = float(np.linalg.norm(feet.xy_body_m, axis=1).max())
    return max(belly_m, wheels_m + math.hypot(feet.half_length_m, feet.half_width_m))


def _find_way_rad(before: FloatArray, after: FloatArray) -> float:
    """Return where the robot goes, as a yaw in the map; where it stands, where it looks."""
    x_m, y_m = (after[:2] - before[:2]).tolist()
    if math.hypot(x_m, y_m) > 1e-4:
        return math.atan2(y_m, x_m)
    return 2.0 * math.atan2(float(after[6]), float(after[3]))


@compile_exact
def touch_crowns(
    before: FloatArray,
    after: FloatArray,
    underside: Underside,
    feet: Footprints,
    grid: PlantGrid,
    crowns: Crowns,
    leaf_places: FloatArray,
    is_standing: npt.NDArray[np.bool_],
    reach_m: float,
) -> None:
    """Mark in `crowns` what the robot touches on its way between two rows of the history."""
    reach = reach_m + crowns.radius_m.max()
    left = max(0, math.floor((after[0] - reach - grid.x_min_m) / CELL_M))
    right = min(grid.columns - 1, math.floor((after[0] + reach - grid.x_min_m) / CELL_M))
    low = max(0, math.floor((after[1] - reach - grid.y_min_m) / CELL_M))
    high = min(grid.rows - 1, math.floor((after[1] + reach - grid.y_min_m) / CELL_M))
    wheels = np.empty((feet.xy_body_m.shape[0], 4))
    _place_wheels(before, after, feet, wheels)
    for row in range(low, high + 1):
        first = grid.start[row * grid.columns + left]
        last = grid.start[row * grid.columns + right + 1] if right >= left else first
        for k in range(first, last):
            plant = grid.order[k]
            dx, dy = grid.x_map_m[plant] - after[0], grid.y_map_m[plant] - after[1]
            near = reach_m + crowns.radius_m[plant]
            if is_standing[plant] and dx * dx + dy * dy < near * near:
                _touch_crown(
                    plant, dx, dy, after, underside, feet.base_height_m, wheels, crowns,
                    leaf_places,
                )  # fmt: skip


@compile_exact
def _place_wheels(before: FloatArray, after: FloatArray, feet: Footprints, box: FloatArray) -> None:
    """Write the ground that each wheel swept, in the body frame of `after`.

    `box` is (wheels, 4): centre x, y and half sizes along x, y.
    """
    w, z = after[3], after[6]
    norm = w * w + z * z
    cos, sin = (w * w - z * z) / norm, 2.0 * w * z / norm
    for k in range(feet.xy_body_m.shape[0]):
        x0, y0 = project_to_ground(before, feet.xy_body_m[k, 0], feet.xy_body_m[k, 1], feet)
        x1, y1 = project_to_ground(after, feet.xy_body_m[k, 0], feet.xy_body_m[k, 1], feet)
        back_x = (x0 - x1) * cos + (y0 - y1) * sin
        back_y = (y0 - y1) * cos - (x0 - x1) * sin
        box[k, 0], box[k, 1] = feet.xy_body_m[k, 0] + back_x / 2, feet.xy_body_m[k, 1] + back_y / 2
        box[k, 2] = feet.half_length_m + abs(back_x) / 2
        box[k, 3] = feet.half_width_m + abs(back_y) / 2


@compile_exact
def _touch_crown(
    plant: int, dx: float, dy: float, row: FloatArray, underside: Underside, base_height_m: float,
    wheels: FloatArray, crowns: Crowns, leaf_places: FloatArray,
) -> None:  # fmt: skip
    """Mark what the robot at a row of the history touches of one plant, `dx`, `dy` from it."""
    w, x, y, z = row[3], row[4], row[5], row[6]
    # The columns of map_from_base; the foot of the plant in the body frame.
    a0, a1, a2 = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
    b0, b1, b2 = 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)
    c0, c1, c2 = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    dz = crowns.foot_z_m[plant] - row[2]
    foot_x, foot_y = a0 * dx + a1 * dy + a2 * dz, b0 * dx + b1 * dy + b2 * dz
    foot_z = c0 * dx + c1 * dy + c2 * dz + base_height_m
    height, radius = crowns.height_m[plant], crowns.radius_m[plant]
    clearance, part = _look_under(underside, foot_x, foot_y)
    if clearance - foot_z < BEND_LIMIT * height:
        crowns.touched[plant], crowns.bent_by[plant] = True, part
    for k in range(leaf_places.shape[0]):
        east, north = radius * leaf_places[k, 0], radius * leaf_places[k, 1]
        leaf_x, leaf_y = foot_x + a0 * east + a1 * north, foot_y + b0 * east + b1 * north
        clearance, part = _look_under(underside, leaf_x, leaf_y)
        if clearance - foot_z < height * leaf_places[k, 2]:
            crowns.touched[plant] = True
        for n in range(wheels.shape[0]):
            if abs(leaf_x - wheels[n, 0]) < wheels[n, 2] and (
                abs(leaf_y - wheels[n, 1]) < wheels[n, 3]
            ):
                crowns.touched[plant] = crowns.pressed[plant, k] = True


@compile_exact
def _look_under(underside: Underside, x_body_m: float, y_body_m: float) -> tuple[float, int]:
    """Return the clearance below the robot at a place of the body frame, and whose it is."""
    i = math.floor((x_body_m - underside.x_min_m) / underside.cell_m)
    j = math.floor((y_body_m - underside.y_min_m) / underside.cell_m)
    if i < 0 or j < 0 or i >= underside.part.shape[0] or j >= underside.part.shape[1]:
        return math.inf, 0
    return underside.clearance_m[i, j], int(underside.part[i, j])
