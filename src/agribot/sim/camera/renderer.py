"""The simulated camera: a picture with depth, class and plant of every pixel.

Needs no graphics library: triangles are filled on the CPU. Pictures are bit-identical on
repeat and for any number of threads.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise

import msgspec
import numba
import numpy as np
import numpy.typing as npt

from agribot.core.errors import DescriptionError
from agribot.core.messages import ByteArray, FloatArray
from agribot.core.robot import CameraSpec, RobotSpec
from agribot.core.world import WorldSpec
from agribot.sim.camera.appearance import Appearance
from agribot.sim.camera.arrays import Lamp, Longs, PinholeView, RobotShade, Singles, Targets
from agribot.sim.camera.figures import Figures, stand_at_start
from agribot.sim.camera.lens import bend_rows, make_lens, make_view
from agribot.sim.camera.lying import LyingPlant, darken, lay_flat
from agribot.sim.camera.projection import cull, project, shade_plants
from agribot.sim.camera.raster import draw_band
from agribot.sim.camera.relief_map import build_relief_map, find_change, refresh_relief_map
from agribot.sim.camera.relief_view import BAND, cover_relief_rows, draw_relief
from agribot.sim.camera.robot_shadow import cast_robot_shade, make_empty_shade
from agribot.sim.camera.rover import ResolveMesh, Rover, place_parts
from agribot.sim.camera.scene import (
    PLAIN_LAYER,
    build_ground,
    build_ground_textures,
    build_leaf_textures,
    join_instances,
    make_obstacle_instances,
    make_plant_instances,
    pack_forms,
    sample_ground_heights,
)
from agribot.sim.camera.shading import (
    CURVE_STEPS,
    ImageBuffers,
    ImageSensor,
    cover_rows,
    develop_rows,
)
from agribot.sim.camera.shadows import bake_shadows, compute_directness, compute_shadow_slope
from agribot.sim.camera.terrain import draw_terrain, project_terrain
from agribot.sim.ground_surface import GroundSurface, build_ground_surface
from agribot.sim.stl import find_mesh_file

LOD_PX = (150.0, 70.0, 32.0, 16.0)  # apparent sizes below which the next coarser mesh is drawn
LEAST_PX = 1.2
METER_STEP = 4  # step of the exposure meter: every fourth drawn pixel of every fourth row counts
METER_GAIN = (0.125, 8.0)
Run = Callable[[Callable[[int, int], None], int], None]


class Rendering(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A picture with its ground truth; all arrays are (height, width).

    `depth_m` is the distance along the optical axis, infinite for the sky. `class_id` holds
    PlantClass values; everything that is no plant is SOIL. `instance` is the index in
    `world.plants`, or -1.
    """

    image_rgb: ByteArray
    depth_m: npt.NDArray[np.float32]
    class_id: ByteArray
    instance: npt.NDArray[np.int32]


class CameraRenderer:
    """Draws one world. Keeps buffers between pictures: one thread at a time may call it.

    With a `robot` its visuals and its shadow can be part of the picture; `resolve_mesh` finds
    the file of a mesh name. `variants` is the number of different plants of each species and
    stage, `threads` how many draw at once (all that numba may use by default). `ground` is the
    one that the wheels press down, by default that of the world. Meshes become coarser at
    apparent sizes that are `finer` times smaller than usual.

    Raises: DescriptionError: an unknown species, surface or kind of shape, or a broken mesh.
    """

    def __init__(
        self,
        world: WorldSpec,
        robot: RobotSpec | None = None,
        *,
        resolve_mesh: ResolveMesh = find_mesh_file,
        variants: int = 12,
        shadow_resolution_m: float = 0.01,
        appearance: Appearance | None = None,
        threads: int | None = None,
        ground: GroundSurface | None = None,
        finer: float = 1.0,
    ) -> None:
        self.world = world
        self._finer = finer
        self._surface = surface = build_ground_surface(world) if ground is None else ground
        self.appearance = look = appearance or Appearance()
        self._threads = threads or min(int(numba.get_num_threads()), os.cpu_count() or 1)
        to_sun = np.array(world.light.to_sun, dtype=float)
        to_sun = to_sun / max(float(np.linalg.norm(to_sun)), 1e-9)
        self._lamp = Lamp(to_sun, world.light.diffuse, world.light.ambient, look.haze_per_m)
        plants, plant_forms = make_plant_instances(world, variants, look, surface)
        obstacles, obstacle_forms = make_obstacle_instances(world.obstacles, len(plant_forms))
        still_forms = plant_forms + obstacle_forms
        walkers, walker_forms = make_obstacle_instances(
            stand_at_start(world.walkers), len(still_forms)
        )
        self._rover = None if robot is None else Rover(robot, resolve_mesh)
        rover_forms = [] if self._rover is None else self._rover.forms
        self._forms = pack_forms(still_forms + walker_forms + rover_forms)
        below_m = sample_ground_heights(world, obstacles.position, surface)
        base_m = below_m, plants.position[:, 2].copy()
        self._direct = compute_directness(world.light.diffuse)
        shadow = bake_shadows(
            self._forms, obstacles, plants, base_m, to_sun, shadow_resolution_m, self._direct
        )
        self._things = join_instances(plants, obstacles)
        self._figures = Figures(world.walkers, len(self._things.form))
        self._things = join_instances(self._things, walkers)
        self._first_part = len(self._things.form)
        if self._rover is not None:
            first_form = len(still_forms) + len(walker_forms)
            parts = self._rover.make_instances(first_form, PLAIN_LAYER)
            self._things = join_instances(self._things, parts)
        self._ground = build_ground(world, shadow, look)
        self._relief = build_relief_map(surface, to_sun, self._direct)
        self._leaves = build_leaf_textures(look.texture_seed)
        self._surfaces = build_ground_textures(world, to_sun, look)
        self._targets: dict[str, Targets] = {}
        self._upright: dict[int, tuple[Singles, Singles]] = {}  # rotation and tint before the fall

    def set_plants(self, lying: Iterable[LyingPlant]) -> None:
        """Lay plants flat; those that are not named stay as they are. Shadows stay where they are.

        They are drawn, labelled and counted by instance where they lie.
        """
        things = self._things
        for plant in lying:
            here = plant.plant
            if here not in self._upright:
                self._upright[here] = things.rotation[here].copy(), things.tint[here].copy()
            rotation, tint = self._upright[here]
            things.rotation[here] = lay_flat(rotation, plant)
            things.tint[here] = darken(tint, plant.age_s)

    def set_walkers(self, map_from_walker: Sequence[FloatArray]) -> None:
        """Put the world's walkers at their poses, (4, 4) each."""
        self._figures.place(self._things, map_from_walker)

    def render(
        self,
        map_from_camera: FloatArray,
        camera: CameraSpec,
        *,
        noise_seed: int | None,
        supersample: int = 1,
        map_from_body: FloatArray | None = None,
        wheel_angles_rad: Sequence[float] | None = None,
    ) -> Rendering:
        """Draw the view of an optical frame at `map_from_camera` (4, 4).

        Without a noise seed the sensor has no noise. With `supersample` n every pixel is the
        mean of n x n drawn ones, and shows the plant that most of them show. With the pose of
        the robot's body (4, 4) the robot and its shadow are in the picture, its wheels turned
        by the angles in the order of WHEEL_NAMES.

        Raises: DescriptionError: a pose but no robot, or a distortion that cannot be drawn.
        """
        lens = make_lens(camera, supersample)
        view = make_view(map_from_camera, camera, supersample, lens)
        shade = self._place_rover(map_from_body, wheel_angles_rad)
        drawn = targets = self._get_buffers("drawn", view.height, view.width)
        picture = _make_blank(camera)
        with _start_workers(self._threads) as run:
            self._draw(view, drawn, shade, supersample / self._finer, run)
            self._cover(view, drawn, shade, run)
            if lens is not None:
                source = lens.source
                targets = self._get_buffers("bent", *source.shape[:2])
                run(
                    lambda first, last: bend_rows(first, last, source, drawn, targets),
                    source.shape[0],
                )
            sensor = _make_sensor(self.appearance, camera, noise_seed, targets)
            run(
                lambda first, last: develop_rows(
                    first, last, supersample, targets, sensor, picture
                ),
                camera.height_px,
            )
        return Rendering(
            image_rgb=picture.image, depth_m=picture.depth, class_id=picture.label,
            instance=picture.instance,
        )  # fmt: skip

    def follow_ground(self, x_map_m: float, y_map_m: float) -> None:
        """Show what wheels have made of the ground near a place since the last picture."""
        if self._relief is None:
            return
        box = find_change(self._relief, self._surface, x_map_m, y_map_m)
        if box is not None:
            refresh_relief_map(self._relief, self._surface, self._lamp.to_sun, self._direct, box)

    def _place_rover(
        self, map_from_body: FloatArray | None, wheel_angles_rad: Sequence[float] | None
    ) -> RobotShade:
        """Put the robot's parts where they are, or away; return its shadow."""
        if map_from_body is None:
            self._things.scale[self._first_part :] = 0.0
            return make_empty_shade()
        if self._rover is None:
            raise DescriptionError(
                "a pose of the robot was given, but the renderer knows no robot; "
                "pass robot= to CameraRenderer"
            )
        if self._first_part == len(self._things.form):  # a robot without visuals
            return make_empty_shade()
        place_parts(
            self._things,
            self._first_part,
            self._rover.compute_poses(map_from_body, wheel_angles_rad),
        )
        slope = compute_shadow_slope(self._lamp.to_sun, self._direct)
        level_m = float(map_from_body[2, 3])
        return cast_robot_shade(
            self._forms, self._things, self._first_part, level_m, slope, self._direct
        )

    def _draw(
        self, view: PinholeView, targets: Targets, shade: RobotShade, detail: float, run: Run
    ) -> None:
        """Fill the targets with everything that stands on the ground."""
        forms, things = self._forms, self._things
        seen, lod = self._find_visible(view, detail)
        mesh: Longs = things.form[seen] + lod * forms.forms
        vertices = forms.vertices[mesh]
        start: Longs = np.cumsum(vertices) - vertices
        point = np.empty((int(vertices.sum()), 6), np.float32)
        box: Singles = np.empty((len(seen), 5), np.float32)

        def project_slice(first: int, last: int) -> None:
            project(first, last, seen, mesh, start, forms, things, view, self._lamp, point, box)
            if shade.shade.size:
                shade_plants(
                    first, last, seen, mesh, start, forms, things, self._lamp, shade, point
                )

        run(project_slice, len(seen))
        run(
            lambda first, last: draw_band(
                first, last, seen, mesh, start, forms, things, view, self._leaves, point, box,
                targets,
            ),
            view.height,
        )  # fmt: skip
        if self._relief is not None:
            relief = self._relief
            run(
                lambda first, last: draw_relief(first, last, view, relief, targets),
                math.ceil(view.height / BAND),
            )
        elif self.world.terrain is not None:
            mesh_points = project_terrain(view, self._ground)
            run(
                lambda first, last: draw_terrain(first, last, mesh_points, view, targets),
                view.height,
            )

    def _cover(self, view: PinholeView, targets: Targets, shade: RobotShade, run: Run) -> None:
        """Complete the targets with ground, haze and sky."""
        lamp, ground, relief, surfaces = self._lamp, self._ground, self._relief, self._surfaces
        if relief is None:
            run(
                lambda first, last: cover_rows(
                    first, last, view, lamp, ground, shade, surfaces, targets
                ),
                view.height,
            )
            return
        run(
            lambda first, last: cover_relief_rows(
                first, last, view, lamp, ground, relief, shade, surfaces, targets
            ),
            view.height,
        )

    def _find_visible(self, view: PinholeView, detail: float) -> tuple[Longs, Longs]:
        """Return the indices of the things in view, nearest first, and their levels of detail."""
        count = len(self._things.form)
        depth_m, size_px = np.empty(count, np.float32), np.empty(count, np.float32)
        cull(self._forms, self._things, view, LEAST_PX * detail, depth_m, size_px)
        seen: Longs = np.flatnonzero(depth_m > 0.0)
        seen = seen[np.argsort(depth_m[seen], kind="stable")]
        lod: Longs = np.searchsorted(-np.array(LOD_PX) * detail, -size_px[seen], side="left")
        return seen, lod

    def _get_buffers(self, name: str, height: int, width: int) -> Targets:
        """Return targets of this size, the same ones as long as the size stays."""
        kept = self._targets.get(name)
        if kept is None or kept.label.shape != (height, width):
            rough = self.world.terrain is not None and self._relief is None and name == "drawn"
            kept = self._targets[name] = Targets(
                colour=np.zeros((height, width, 3), np.float32),  # finite also where it is sky
                inverse_depth=np.empty((height, width), np.float32),
                label=np.empty((height, width), np.uint8),
                instance=np.empty((height, width), np.int32),
                place=np.empty((height, width, 2) if rough else (0, 0, 2)),
            )
        return kept


@contextmanager
def _start_workers(threads: int) -> Iterator[Run]:
    """Give a function that runs work over slices of a range, in this thread or in several."""
    if threads == 1:
        yield lambda work, count: work(0, count)
        return
    with ThreadPoolExecutor(threads) as pool:

        def run_shared(work: Callable[[int, int], None], count: int) -> None:
            slices = 4 * threads
            edges = [count * k // slices for k in range(slices + 1)]
            for done in [pool.submit(work, *pair) for pair in pairwise(edges)]:
                done.result()

        yield run_shared


def _make_blank(camera: CameraSpec) -> ImageBuffers:
    shape = (camera.height_px, camera.width_px)
    return ImageBuffers(
        np.empty((*shape, 3), np.uint8), np.empty(shape, np.float32), np.empty(shape, np.uint8),
        np.empty(shape, np.int32),
    )  # fmt: skip


def _make_sensor(
    look: Appearance, camera: CameraSpec, noise_seed: int | None, targets: Targets
) -> ImageSensor:
    gain = np.array(look.white_balance) * look.exposure
    if look.auto_exposure_level > 0.0:
        sample = targets.colour[::METER_STEP, ::METER_STEP]
        mean = float((sample.reshape(-1, 3) * gain).mean())
        least, most = METER_GAIN
        gain = gain * min(max(look.auto_exposure_level / max(mean, 1e-6), least), most)
    curve = np.empty(0, np.float32)
    if look.gamma != 1.0:
        level = np.arange(256 * CURVE_STEPS) / (255.0 * CURVE_STEPS)
        curve = (255.0 * level**look.gamma).astype(np.float32)
    noise = 0.0 if noise_seed is None else 255.0 * camera.noise_std
    # Far apart for successive seeds, so that their counters never meet in one picture.
    seed = np.uint64(((noise_seed or 0) * 0x9E3779B1 << 20) & 0xFFFFFFFFFFFFFFFF)
    return ImageSensor(gain, curve, noise, seed)
