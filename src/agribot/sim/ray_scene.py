"""What rays meet in a world: solids, crowns of plants, walkers and the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agribot.core.geo import transform
from agribot.core.messages import FloatArray
from agribot.core.robot import Shape
from agribot.core.world import Obstacle, WorldSpec
from agribot.sim.flora.crown import find_crown_radius_m
from agribot.sim.ground_surface import GroundSurface
from agribot.sim.jit import compile_exact
from agribot.sim.kernel import sample_grid
from agribot.sim.plant_states import PlantStates
from agribot.sim.rigid_body import KINDS, compute_half_sizes_m
from agribot.sim.tyre import Terrain
from agribot.sim.walkers import place_walkers

BOX, CYLINDER, BALL, CROWN = range(4)
KIND_OF = {"box": BOX, "cylinder": CYLINDER, "sphere": BALL}
# Columns of a solid's row: its kind, radius of the ball around it, its middle in the map, its axes
# as the rows of a rotation, and half sizes along them. A crown is the upper half of its ellipsoid.
COLUMNS = 17
GROUND_STEP_M = 0.05
HALVINGS = 20
TINY = 1e-12


class RayScene:
    """Everything that rays of a lidar can meet; `states` says which plants stand."""

    def __init__(self, world: WorldSpec, ground: GroundSurface, states: PlantStates) -> None:
        self._ground, self._states, self._walkers = ground, states, world.walkers
        self._solids = _make_rows(world.obstacles)
        self._crowns = _make_crowns(world, ground)

    def add_obstacle(self, obstacle: Obstacle) -> None:
        """Put up one more obstacle."""
        self._solids = np.concatenate([self._solids, _make_rows([obstacle])])

    def cast(self, start_m: FloatArray, directions: FloatArray, reach_m: float, t_s: float
             ) -> FloatArray:  # fmt: skip
        """Measure from a place (3,) along unit vectors (N, 3), (N,) m; infinite beyond reach."""
        crowns = self._crowns[self._states.is_standing]
        solids = np.concatenate([self._solids, crowns, *self._place_walkers(t_s)])
        away_m = np.linalg.norm(solids[:, 2:5] - start_m, axis=1)
        near = solids[away_m - solids[:, 1] <= reach_m]
        return cast_rays(start_m, directions, near, self._ground.make_grid(), reach_m)

    def _place_walkers(self, t_s: float) -> list[FloatArray]:
        poses = place_walkers(self._walkers, self._ground, t_s)
        return [
            _make_row(pose, shape)[None]
            for walker, pose in zip(self._walkers, poses, strict=True)
            for shape in walker.shapes
            if shape.kind in KINDS
        ]


def _make_rows(obstacles: Sequence[Obstacle]) -> FloatArray:
    """Make a row of each shape, (n, COLUMNS)."""
    rows = [
        _make_row(transform((o.x_map_m, o.y_map_m, o.z_map_m), (0.0, 0.0, o.yaw_rad)), shape)
        for o in obstacles
        for shape in o.shapes
        if shape.kind in KINDS
    ]
    return np.array(rows).reshape(-1, COLUMNS)


def _make_row(map_from_owner: FloatArray, shape: Shape) -> FloatArray:
    pose = map_from_owner @ shape.origin.matrix()
    half_m = compute_half_sizes_m(shape)
    radius_m = float(half_m.max()) if shape.kind == "sphere" else float(np.linalg.norm(half_m))
    head = [float(KIND_OF[shape.kind]), radius_m, *pose[:3, 3]]
    return np.array([*head, *pose[:3, :3].T.ravel(), *half_m])


def _make_crowns(world: WorldSpec, ground: GroundSurface) -> FloatArray:
    """Make a row of each plant, (n, COLUMNS): a half ellipsoid over its stem."""
    plants = world.plants
    if not plants:
        return np.zeros((0, COLUMNS))
    foot = np.array([(plant.x_map_m, plant.y_map_m) for plant in plants])
    rows = np.zeros((len(plants), COLUMNS))
    rows[:, 0] = CROWN
    rows[:, 2:4], rows[:, 4] = foot, ground.sample_heights(foot)
    rows[:, 5:14] = np.eye(3).ravel()
    radius_m = [find_crown_radius_m(plant.species, plant.size_m) for plant in plants]
    rows[:, 14] = rows[:, 15] = radius_m
    rows[:, 16] = [plant.size_m for plant in plants]
    rows[:, 1] = rows[:, 14:17].max(axis=1)
    return rows


@compile_exact
def cast_rays(
    start_m: FloatArray, directions: FloatArray, solids: FloatArray, ground: Terrain, reach_m: float
) -> FloatArray:
    """Measure to the first solid or the ground along each ray, (N,)."""
    ranges_m = np.full(directions.shape[0], np.inf)
    for k in range(directions.shape[0]):
        best_m = _meet_ground(start_m, directions[k], ground, reach_m)
        for n in range(solids.shape[0]):
            solid = solids[n]
            x, y, z = start_m[0] - solid[2], start_m[1] - solid[3], start_m[2] - solid[4]
            dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
            ahead = -(x * dx + y * dy + z * dz)
            aside2 = x * x + y * y + z * z - ahead * ahead
            if ahead < -solid[1] or ahead - solid[1] > best_m or aside2 > solid[1] * solid[1]:
                continue
            best_m = min(best_m, _meet_solid(solid, x, y, z, dx, dy, dz))
        ranges_m[k] = best_m if best_m <= reach_m else np.inf
    return ranges_m


@compile_exact
def _meet_ground(
    start_m: FloatArray, direction: FloatArray, ground: Terrain, reach_m: float
) -> float:
    """Walk along a ray until it is below the ground; infinite where it never is."""
    above_m = start_m[2] - sample_grid(ground, start_m[0], start_m[1])[0]
    if above_m < 0.0:
        return 0.0
    at_m, step_m = 0.0, max(GROUND_STEP_M, ground.resolution_m)
    while at_m < reach_m:
        next_m = min(at_m + step_m, reach_m)
        if _clear(start_m, direction, ground, next_m) >= 0.0:
            at_m = next_m
            continue
        low_m, high_m = at_m, next_m
        for _ in range(HALVINGS):
            middle_m = (low_m + high_m) / 2.0
            if _clear(start_m, direction, ground, middle_m) >= 0.0:
                low_m = middle_m
            else:
                high_m = middle_m
        return high_m
    return math.inf


@compile_exact
def _clear(start_m: FloatArray, direction: FloatArray, ground: Terrain, at_m: float) -> float:
    """Return how high a place on the ray is over the ground."""
    x_m, y_m = start_m[0] + at_m * direction[0], start_m[1] + at_m * direction[1]
    height: float = start_m[2] + at_m * direction[2] - sample_grid(ground, x_m, y_m)[0]
    return height


@compile_exact
def _meet_solid(
    solid: FloatArray, x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> float:
    """Return the way to a solid from (x, y, z) beside its middle; 0 from inside of it."""
    a = solid[5:14]
    px, dpx = a[0] * x + a[1] * y + a[2] * z, a[0] * dx + a[1] * dy + a[2] * dz
    py, dpy = a[3] * x + a[4] * y + a[5] * z, a[3] * dx + a[4] * dy + a[5] * dz
    pz, dpz = a[6] * x + a[7] * y + a[8] * z, a[6] * dx + a[7] * dy + a[8] * dz
    hx, hy, hz = solid[14], solid[15], solid[16]
    kind = int(solid[0])
    if kind == BOX:
        enter, leave = _cross_slab(px, dpx, hx, 0.0, math.inf)
        enter, leave = _cross_slab(py, dpy, hy, enter, leave)
        enter, leave = _cross_slab(pz, dpz, hz, enter, leave)
    elif kind == CYLINDER:
        enter, leave = _cross_quadric(px / hx, py / hy, 0.0, dpx / hx, dpy / hy, 0.0)
        enter, leave = _cross_slab(pz, dpz, hz, enter, leave)
    else:
        enter, leave = _cross_quadric(px / hx, py / hy, pz / hz, dpx / hx, dpy / hy, dpz / hz)
        if kind == CROWN:  # a slab from its foot to its top, around the middle of both
            enter, leave = _cross_slab(pz - hz / 2.0, dpz, hz / 2.0, enter, leave)
    return enter if enter <= leave else math.inf


@compile_exact
def _cross_slab(
    place: float, way: float, half: float, enter: float, leave: float
) -> tuple[float, float]:
    """Cut the stretch of a ray by two parallel planes, `half` to both sides of 0."""
    if math.fabs(way) < TINY:
        return (enter, leave) if math.fabs(place) <= half else (math.inf, -math.inf)
    one, other = (-half - place) / way, (half - place) / way
    return max(enter, min(one, other)), min(leave, max(one, other))


@compile_exact
def _cross_quadric(
    x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> tuple[float, float]:
    """Return where a ray enters and leaves the unit ball, or the cylinder where z and dz are 0."""
    square, half, rest = dx * dx + dy * dy + dz * dz, x * dx + y * dy + z * dz, 0.0
    rest = x * x + y * y + z * z - 1.0
    if square < TINY:
        return (0.0, math.inf) if rest <= 0.0 else (math.inf, -math.inf)
    root2 = half * half - square * rest
    if root2 < 0.0:
        return math.inf, -math.inf
    root = math.sqrt(root2)
    return max(0.0, (-half - root) / square), (-half + root) / square
