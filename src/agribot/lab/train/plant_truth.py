"""Which plant each pixel of a drawn view belongs to, and where the plants' stems stand."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.lens import distort
from agribot.core.messages import ByteArray, FloatArray
from agribot.core.robot import CameraSpec
from agribot.core.whole_file import make_at_once
from agribot.core.world import WorldSpec
from agribot.sim.camera.renderer import Rendering
from agribot.sim.camera.scene import sample_ground_heights
from agribot.sim.ground_surface import GroundSurface

# Least visible pixels that identify a plant.
LEAST_PX = 12
# Range of labels: beyond it a pixel covers more than a weed, and the robot does not look that far.
LABEL_RANGE_M = 3.0


class PlantTruth(NamedTuple):
    """The plants of one picture (H, W).

    `number` (H, W) uint16 is the plant of each pixel, counted from 1, or 0. Of plant k,
    `stem_px[k - 1]` is the place of its stem, right u and down v from the middle of the top left
    pixel, also outside of the picture or behind leaves; `kind[k - 1]` is its PlantClass.
    """

    number: npt.NDArray[np.uint16]
    stem_px: FloatArray
    kind: ByteArray


class DrawnView(NamedTuple):
    """A picture (H, W, 3), the class of its pixels (H, W) and its plants."""

    image_rgb: ByteArray
    label: ByteArray
    plants: PlantTruth


def find_plants(
    drawn: Rendering,
    world: WorldSpec,
    camera: CameraSpec,
    map_from_camera: FloatArray,
    ground: GroundSurface | None = None,
    range_m: float = LABEL_RANGE_M,
) -> PlantTruth:
    """Find the plants that a picture of the world shows near enough to be distinguished.

    The stem of a plant is where the map has it, on the ground.
    """
    shown = _list_shown(drawn, range_m)
    # Number of instance -1, the last, means none.
    number = np.zeros(len(world.plants) + 1, dtype=np.uint16)
    number[shown] = np.arange(1, len(shown) + 1)
    places_m, kind = place_stems(world, shown, ground)
    camera_m = (places_m - map_from_camera[:3, 3]) @ map_from_camera[:3, :3]
    return PlantTruth(
        number=number[drawn.instance], stem_px=project_points(camera_m, camera), kind=kind
    )


def place_stems(
    world: WorldSpec, shown: npt.NDArray[np.intp], ground: GroundSurface | None
) -> tuple[FloatArray, ByteArray]:
    """Return where some of the world's plants stand on the ground, (N, 3) of the map, and what."""
    plants = [world.plants[index] for index in shown]
    places_m = np.array([(p.x_map_m, p.y_map_m, 0.0) for p in plants]).reshape(-1, 3)
    places_m[:, 2] = sample_ground_heights(world, places_m, ground)
    return places_m, np.array([int(p.plant) for p in plants], dtype=np.uint8)


def project_points(camera_m: FloatArray, camera: CameraSpec) -> FloatArray:
    """Project points (N, 3) of the optical frame, ahead of it, to pixels (N, 2), u and v."""
    depth_m = np.maximum(camera_m[:, 2], camera.clip_near_m)
    rays = camera_m[:, :2] / depth_m[:, None]
    if any(camera.distortion):
        rays = distort(rays, camera.distortion)
    matrix = camera.matrix()
    projected: FloatArray = rays * np.diag(matrix)[:2] + matrix[:2, 2]
    return projected


def save_plants(path: Path, plants: PlantTruth) -> None:
    def save(beside: Path) -> None:
        with beside.open("wb") as file:
            np.savez_compressed(file, **plants._asdict())

    make_at_once(path, save)


def load_plants(path: Path) -> PlantTruth:
    with np.load(path) as stored:
        return PlantTruth(*(stored[name] for name in PlantTruth._fields))


def _list_shown(drawn: Rendering, range_m: float) -> npt.NDArray[np.intp]:
    """List the indices of the world's plants with enough pixels that are near enough."""
    near = (drawn.instance >= 0) & (drawn.depth_m <= range_m)
    seen_px = np.bincount(drawn.instance[near])
    return np.flatnonzero(seen_px >= LEAST_PX)
