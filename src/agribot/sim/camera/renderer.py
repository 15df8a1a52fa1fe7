"""The simulated camera: a picture, and what every pixel of it shows.

Needs no graphics library: triangles are filled on the CPU. Pictures are bit-identical on
repeat and for any number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise

import msgspec
import numba
import numpy as np
import numpy.typing as npt

from agribot.geo import inverse
from agribot.messages import ByteArray, FloatArray
from agribot.robot import CameraSpec
from agribot.sim.camera.appearance import Appearance
from agribot.sim.camera.arrays import Lamp, Longs, Singles, Targets, View
from agribot.sim.camera.projection import cull, project
from agribot.sim.camera.raster import draw_band
from agribot.sim.camera.scene import (
    ground_arrays,
    ground_heights,
    ground_textures,
    joined,
    leaf_textures,
    obstacle_instances,
    packed_forms,
    plant_instances,
)
from agribot.sim.camera.shading import CURVE_STEPS, Picture, Sensor, finish_rows
from agribot.sim.camera.shadows import bake_shadows
from agribot.sim.camera.terrain import draw_terrain, terrain_points
from agribot.world import WorldSpec

LOD_PX = (150.0, 70.0, 32.0, 16.0)  # below these apparent sizes the next coarser mesh is drawn
LEAST_PX = 1.2
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

    `variants` is the number of different plants of each species and stage, `threads` how many
    draw at once (all that numba may use by default).

    Raises: DescriptionError: an unknown species, surface or kind of shape.
    """

    def __init__(
        self,
        world: WorldSpec,
        *,
        variants: int = 12,
        shadow_resolution_m: float = 0.01,
        appearance: Appearance | None = None,
        threads: int | None = None,
    ) -> None:
        self.world = world
        self.appearance = look = appearance or Appearance()
        self._threads = threads or min(int(numba.get_num_threads()), os.cpu_count() or 1)
        to_sun = np.array(world.light.to_sun, dtype=float)
        to_sun = to_sun / max(float(np.linalg.norm(to_sun)), 1e-9)
        self._lamp = Lamp(to_sun, world.light.diffuse, world.light.ambient, look.haze_per_m)
        plants, plant_forms = plant_instances(world, variants, look)
        obstacles, obstacle_forms = obstacle_instances(world.obstacles, len(plant_forms))
        self._forms = packed_forms(plant_forms + obstacle_forms)
        base_m = (ground_heights(world, obstacles.position), plants.position[:, 2].copy())
        shadow = bake_shadows(self._forms, obstacles, plants, base_m, to_sun, shadow_resolution_m)
        self._things = joined(plants, obstacles)
        self._ground = ground_arrays(world, shadow, look)
        self._leaves = leaf_textures(look.texture_seed)
        self._surfaces = ground_textures(world, to_sun, look)
        self._targets: Targets | None = None

    def render(
        self,
        map_from_camera: FloatArray,
        camera: CameraSpec,
        *,
        noise_seed: int | None,
        supersample: int = 1,
    ) -> Rendering:
        """Draw the view of an optical frame at `map_from_camera` (4, 4).

        Without a noise seed the sensor has no noise. With `supersample` n every pixel is the
        mean of n x n drawn ones, and shows the plant that most of them show.
        """
        view = _view(map_from_camera, camera, supersample)
        targets = self._buffers(view.height, view.width)
        picture = _blank(camera)
        with _workers(self._threads) as run:
            self._draw(view, targets, float(supersample), run)
            sensor = _sensor(self.appearance, camera, noise_seed)
            run(
                lambda first, last: finish_rows(
                    first, last, supersample, view, self._lamp, self._ground, self._surfaces,
                    targets, sensor, picture,
                ),
                camera.height_px,
            )  # fmt: skip
        return Rendering(
            image_rgb=picture.image, depth_m=picture.depth, class_id=picture.label,
            instance=picture.instance,
        )  # fmt: skip

    def _draw(self, view: View, targets: Targets, detail: float, run: Run) -> None:
        """Fill the targets with everything that stands on the ground."""
        forms, things = self._forms, self._things
        count = len(things.form)
        depth_m, size_px = np.empty(count, np.float32), np.empty(count, np.float32)
        cull(forms, things, view, LEAST_PX * detail, depth_m, size_px)
        seen: Longs = np.flatnonzero(depth_m > 0.0)
        seen = seen[np.argsort(depth_m[seen], kind="stable")]
        lod = np.searchsorted(-np.array(LOD_PX) * detail, -size_px[seen], side="left")
        mesh: Longs = things.form[seen] + lod * forms.forms
        vertices = forms.vertices[mesh]
        start: Longs = np.cumsum(vertices) - vertices
        point = np.empty((int(vertices.sum()), 6), np.float32)
        box: Singles = np.empty((len(seen), 5), np.float32)
        run(
            lambda first, last: project(
                first, last, seen, mesh, start, forms, things, view, self._lamp, point, box
            ),
            len(seen),
        )
        run(
            lambda first, last: draw_band(
                first, last, seen, mesh, start, forms, things, view, self._leaves, point, box,
                targets,
            ),
            view.height,
        )  # fmt: skip
        if self.world.terrain is not None:
            mesh_points = terrain_points(view, self._ground)
            run(
                lambda first, last: draw_terrain(first, last, mesh_points, view, targets),
                view.height,
            )

    def _buffers(self, height: int, width: int) -> Targets:
        if self._targets is None or self._targets.label.shape != (height, width):
            rough = self.world.terrain is not None
            self._targets = Targets(
                colour=np.empty((height, width, 3), np.float32),
                inverse_depth=np.empty((height, width), np.float32),
                label=np.empty((height, width), np.uint8),
                instance=np.empty((height, width), np.int32),
                place=np.empty((height, width, 2) if rough else (0, 0, 2)),
            )
        return self._targets


@contextmanager
def _workers(threads: int) -> Iterator[Run]:
    """How to run a function over slices of a range: in this thread, or shared by several."""
    if threads == 1:
        yield lambda work, count: work(0, count)
        return
    with ThreadPoolExecutor(threads) as pool:

        def shared(work: Callable[[int, int], None], count: int) -> None:
            slices = 4 * threads
            edges = [count * k // slices for k in range(slices + 1)]
            for done in [pool.submit(work, *pair) for pair in pairwise(edges)]:
                done.result()

        yield shared


def _view(map_from_camera: FloatArray, camera: CameraSpec, fine: int) -> View:
    width, height = camera.width_px * fine, camera.height_px * fine
    return View(
        eye=np.array(map_from_camera[:3, 3], dtype=float),
        camera_from_map=np.ascontiguousarray(inverse(map_from_camera)[:3, :3]),
        focal_px=camera.focal_px * fine, cx_px=(width - 1) / 2.0, cy_px=(height - 1) / 2.0,
        near_m=camera.clip_near_m, far_m=camera.clip_far_m, width=width, height=height,
    )  # fmt: skip


def _blank(camera: CameraSpec) -> Picture:
    shape = (camera.height_px, camera.width_px)
    return Picture(
        np.empty((*shape, 3), np.uint8), np.empty(shape, np.float32), np.empty(shape, np.uint8),
        np.empty(shape, np.int32),
    )  # fmt: skip


def _sensor(look: Appearance, camera: CameraSpec, noise_seed: int | None) -> Sensor:
    gain = np.array(look.white_balance) * look.exposure
    curve = np.empty(0, np.float32)
    if look.gamma != 1.0:
        level = np.arange(256 * CURVE_STEPS) / (255.0 * CURVE_STEPS)
        curve = (255.0 * level**look.gamma).astype(np.float32)
    noise = 0.0 if noise_seed is None else 255.0 * camera.noise_std
    # Far apart for successive seeds, so that their counters never meet in one picture.
    seed = np.uint64(((noise_seed or 0) * 0x9E3779B1 << 20) & 0xFFFFFFFFFFFFFFFF)
    return Sensor(gain, curve, noise, seed)
