"""Draws labelled images of random fields and writes their files."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
from PIL import Image
from scipy import ndimage

from agribot.app.workers import Stop
from agribot.core.errors import MAKE_ROOM, RecordingError, explain_os_error
from agribot.core.messages import ByteArray, FloatArray, PlantClass
from agribot.core.robot import CameraSpec
from agribot.core.whole_file import write_at_once
from agribot.core.world import Plant, WorldSpec
from agribot.lab.dataset.records import (
    COLOURED,
    ImageRecord,
    Recipe,
    SeenPlant,
    encode,
    image_name,
    record_path,
    stem,
)
from agribot.lab.dataset.run_lengths import instance_run_lengths
from agribot.sim.camera.appearance import Appearance
from agribot.sim.camera.renderer import CameraRenderer, Rendering
from agribot.sim.random_scenes import WIDE, sample_field, sample_look, sample_view
from agribot.sim.seedling_scenes import (
    FINER,
    sample_overhead_view,
    sample_red_infrared_look,
    sample_seedlings,
    to_red_infrared,
)

# Number that keeps these fields apart from the ones that networks are trained and judged on.
STREAM = 211
DEVELOPED = 1_000_003  # number that no view of a field has
Developer = Callable[[ByteArray, np.random.Generator], ByteArray]
Pixels = ByteArray | npt.NDArray[np.uint16]
MOST_INSTANCES = 65535
MOST_DEPTH_MM = 65535
JPEG_QUALITY = 95
PALETTE = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255]], np.uint8)  # weed, crop, soil


def _keep_colours(image_rgb: ByteArray, rng: np.random.Generator) -> ByteArray:
    return image_rgb


class Scenes(NamedTuple):
    """Recipe of a variety's pictures; `developed` turns the colours into its bands."""

    field: Callable[[np.random.Generator], WorldSpec]
    look: Callable[[np.random.Generator], Appearance]
    view: Callable[[np.random.Generator], tuple[CameraSpec, FloatArray]]
    developed: Developer = _keep_colours
    finer: float = 1.0


SCENES = {
    "standard": Scenes(sample_field, sample_look, sample_view),
    "wide": Scenes(partial(sample_field, variety=WIDE), sample_look, sample_view),
    "seedlings": Scenes(
        sample_seedlings, sample_red_infrared_look, sample_overhead_view, to_red_infrared, FINER
    ),
}


class FieldJob(msgspec.Struct, frozen=True, kw_only=True):
    """The images to draw of one field."""

    folder: Path
    recipe: Recipe
    field: int
    indices: tuple[int, ...]


def list_missing_fields(folder: Path, recipe: Recipe, images: int) -> list[FieldJob]:
    """List jobs for those of the first `images` images that are not there yet."""
    jobs = []
    for first in range(0, images, recipe.views_per_field):
        indices = range(first, min(first + recipe.views_per_field, images))
        missing = tuple(k for k in indices if not record_path(folder, k).is_file())
        if missing:
            field = first // recipe.views_per_field
            jobs.append(FieldJob(folder=folder, recipe=recipe, field=field, indices=missing))
    return jobs


def draw_field(job: FieldJob, stop: Stop) -> int:
    """Draw and write the images of a job and return how many there are now of them.

    Raises: RecordingError: a file cannot be written.
    """
    recipe, drawn = job.recipe, 0
    rng = np.random.default_rng([recipe.seed, STREAM, job.field])
    scenes = SCENES[recipe.variety]
    world = scenes.field(rng)
    if len(world.plants) > MOST_INSTANCES:
        raise RecordingError(
            f"field {job.field} has {len(world.plants)} plants, and an instance mask holds at most "
            f"{MOST_INSTANCES}; choose another --variety"
        )
    look = scenes.look(rng)
    renderer = CameraRenderer(world, appearance=look, threads=1, finer=scenes.finer)
    for index in job.indices:
        if stop():
            break
        camera, map_from_camera, noise_seed = choose_view(recipe, index)
        picture = renderer.render(
            map_from_camera, camera, noise_seed=noise_seed, supersample=recipe.supersample
        )
        record = _make_record(index, job.field, camera, map_from_camera, picture, world.plants)
        with explain_os_error(f"cannot write into {job.folder}", MAKE_ROOM):
            _write_image(job.folder, recipe, index, picture)
            write_at_once(record_path(job.folder, index), encode(record))
        drawn += 1
    return drawn


def choose_view(recipe: Recipe, index: int) -> tuple[CameraSpec, FloatArray, int]:
    """Choose camera, `map_from_camera` (4, 4) and noise seed of an image from its number alone."""
    field, view = divmod(index, recipe.views_per_field)
    # A seed list that ends in 0 would be the field's own: numpy fills short lists with zeros.
    rng = np.random.default_rng([recipe.seed, STREAM, field, view + 1])
    camera, map_from_camera = SCENES[recipe.variety].view(rng)
    camera = msgspec.structs.replace(camera, width_px=recipe.width_px, height_px=recipe.height_px)
    return camera, map_from_camera, int(rng.integers(2**31))


def _make_record(
    index: int,
    field: int,
    camera: CameraSpec,
    map_from_camera: FloatArray,
    picture: Rendering,
    plants: Sequence[Plant],
) -> ImageRecord:
    return ImageRecord(
        index=index,
        field=field,
        width_px=camera.width_px,
        height_px=camera.height_px,
        focal_px=camera.focal_px,
        cx_px=(camera.width_px - 1) / 2.0,
        cy_px=(camera.height_px - 1) / 2.0,
        map_from_camera=tuple(tuple(row) for row in map_from_camera.tolist()),
        plants=_list_seen_plants(picture.instance + 1, plants),
    )


def _list_seen_plants(
    instance: npt.NDArray[np.int32], plants: Sequence[Plant]
) -> tuple[SeenPlant, ...]:
    boxes = ndimage.find_objects(instance)
    areas = np.bincount(instance.ravel(), minlength=1)
    seen = []
    for number, rle in instance_run_lengths(instance).items():
        rows, columns = boxes[number - 1]
        plant = plants[number - 1]
        left, top = columns.start, rows.start
        seen.append(
            SeenPlant(
                instance=number,
                species=plant.species,
                plant="crop" if plant.plant == PlantClass.CROP else "weed",
                bbox_px=(left, top, columns.stop - left, rows.stop - top),
                area_px=int(areas[number]),
                x_map_m=plant.x_map_m,
                y_map_m=plant.y_map_m,
                size_m=plant.size_m,
                rle=rle,
            )
        )
    return tuple(seen)


def _write_image(folder: Path, recipe: Recipe, index: int, picture: Rendering) -> None:
    rng = np.random.default_rng([recipe.seed, STREAM, index, DEVELOPED])
    image_rgb = SCENES[recipe.variety].developed(picture.image_rgb, rng)
    if recipe.format == "jpg":
        image = _encode_image(image_rgb, "JPEG", quality=JPEG_QUALITY)
    else:
        image = _encode_image(image_rgb, "PNG", compress_level=1)
    write_at_once(folder / image_name(recipe, index), image)
    name = f"{stem(index)}.png"
    labels: dict[str, Pixels] = {
        "masks": picture.class_id,
        "instances": (picture.instance + 1).astype(np.uint16),
        "depth": depth_mm(picture.depth_m),
    }
    if recipe.colour_masks:
        labels[COLOURED] = PALETTE[picture.class_id]
    for kind, pixels in labels.items():
        write_at_once(folder / kind / name, _encode_image(pixels, "PNG", compress_level=1))


def depth_mm(depth_m: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
    """Convert (H, W) along the optical axis to mm; 0 where unknown or above 65.535 m."""
    rounded = np.rint(np.where(np.isfinite(depth_m), depth_m, 0.0) * 1000.0)
    return np.where(rounded <= MOST_DEPTH_MM, rounded, 0.0).astype(np.uint16)


def _encode_image(pixels: Pixels, format: str, **options: int) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format=format, **options)
    return buffer.getvalue()
