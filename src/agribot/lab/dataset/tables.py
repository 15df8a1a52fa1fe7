"""The tables of a generated data set: camera poses, plants, and annotations for COCO tools."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agribot.core.errors import MAKE_ROOM, explain_os_error
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.whole_file import write_at_once
from agribot.lab.dataset.records import (
    ImageRecord,
    Recipe,
    encode,
    image_name,
    read_records,
)
from agribot.sim.random_scenes import DENSE, STANDARD, WIDE

POSE_COLUMNS = (
    "image", "field", "x_map_m", "y_map_m", "z_map_m", "qx", "qy", "qz", "qw", "focal_px",
    "cx_px", "cy_px", "width_px", "height_px",
)  # fmt: skip
PLANT_COLUMNS = (
    "image", "instance", "species", "class", "left_px", "top_px", "width_px", "height_px",
    "area_px", "x_map_m", "y_map_m", "size_m",
)  # fmt: skip
# New species go to the end: the numbers of the others are the same in every set.
CATEGORIES = tuple(
    dict.fromkeys(
        (kind, species)
        for one in (STANDARD, DENSE, WIDE)
        for kind, names in (("crop", [name for name, *_ in one.crops]), ("weed", one.weeds))
        for species in names
    )
)


def write_tables(folder: Path, recipe: Recipe) -> dict[str, Any]:
    """Write poses.csv, plants.csv and annotations.json over all complete images; sum them up.

    Raises: RecordingError: a record cannot be read or a table cannot be written.
    """
    records = list(read_records(folder))
    tables = {
        "poses.csv": _encode_csv(
            POSE_COLUMNS, (_make_pose_row(recipe, record) for record in records)
        ),
        "plants.csv": _encode_csv(PLANT_COLUMNS, _make_plant_rows(recipe, records)),
        "annotations.json": encode(make_coco(recipe, records)),
    }
    with explain_os_error(f"cannot write the tables of {folder}", MAKE_ROOM):
        for name, data in tables.items():
            write_at_once(folder / name, data)
    return {
        "images": len(records),
        "fields": len({record.field for record in records}),
        "plants": sum(len(record.plants) for record in records),
        "pixel_ratio": _compute_pixel_ratio(records),
    }


def make_coco(recipe: Recipe, records: Sequence[ImageRecord]) -> dict[str, Any]:
    """Make one COCO object-detection file; segmentations are compressed run lengths."""
    ids = {category: number for number, category in enumerate(CATEGORIES, 1)}
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for record in records:
        images.append({
            "id": record.index, "file_name": image_name(recipe, record.index),
            "width": record.width_px, "height": record.height_px, "field": record.field,
        })  # fmt: skip
        for plant in record.plants:
            annotations.append({
                "id": len(annotations) + 1, "image_id": record.index,
                "category_id": ids[plant.plant, plant.species], "iscrowd": 0,
                "bbox": plant.bbox_px, "area": plant.area_px,
                "segmentation": {"size": [record.height_px, record.width_px], "counts": plant.rle},
                "instance": plant.instance,
            })  # fmt: skip
    return {
        "info": {
            "description": "crop and weed images of the AGRIBOT simulator",
            "version": recipe.version,
        },
        "licenses": [],
        "categories": [
            {"id": number, "name": species, "supercategory": kind}
            for (kind, species), number in ids.items()
        ],
        "images": images,
        "annotations": annotations,
    }


def _make_pose_row(recipe: Recipe, record: ImageRecord) -> tuple[object, ...]:
    map_from_camera = np.array(record.map_from_camera)
    return (
        image_name(recipe, record.index), record.field, *map_from_camera[:3, 3].tolist(),
        *quaternion_xyzw(map_from_camera[:3, :3]), record.focal_px, record.cx_px, record.cy_px,
        record.width_px, record.height_px,
    )  # fmt: skip


def _make_plant_rows(
    recipe: Recipe, records: Iterable[ImageRecord]
) -> Iterable[tuple[object, ...]]:
    for record in records:
        for plant in record.plants:
            yield (
                image_name(recipe, record.index), plant.instance, plant.species, plant.plant,
                *plant.bbox_px, plant.area_px, plant.x_map_m, plant.y_map_m, plant.size_m,
            )  # fmt: skip


def _compute_pixel_ratio(records: Sequence[ImageRecord]) -> dict[str, float | None]:
    total = sum(record.width_px * record.height_px for record in records)
    area = {
        kind: sum(p.area_px for record in records for p in record.plants if p.plant == kind)
        for kind in ("weed", "crop")
    }
    area["soil"] = total - area["weed"] - area["crop"]
    return {
        name.name.lower(): area[name.name.lower()] / total if total else None for name in PlantClass
    }


def quaternion_xyzw(rotation: FloatArray) -> tuple[float, float, float, float]:
    """Compute the unit quaternion of a rotation matrix (3, 3), w not negative."""
    r = rotation
    # Its eigenvector of the largest eigenvalue is the quaternion, for every rotation alike.
    symmetric = np.array([
        [r[0, 0] - r[1, 1] - r[2, 2], 0.0, 0.0, 0.0],
        [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0.0, 0.0],
        [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0.0],
        [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
    ])  # fmt: skip
    _, vectors = np.linalg.eigh(symmetric)  # reads the lower triangle
    x, y, z, w = (vectors[:, -1] * (1.0 if vectors[3, -1] >= 0.0 else -1.0)).tolist()
    return x, y, z, w


def _encode_csv(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue().encode()
