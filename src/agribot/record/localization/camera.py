"""What the camera of a log saw: plants, rows and doubt of each picture, as a table and a sheet."""

from __future__ import annotations

import base64
import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from PIL import Image, ImageDraw

from agribot.autonomy.perceive.picture_rows import FAR_RATIO, PictureRows
from agribot.core.errors import explain_os_error
from agribot.core.messages import ByteArray, PlantClass
from agribot.core.pose import Pose2
from agribot.record.tiles import format_number

SHOWN = 6  # pictures on the page, evenly over the log
SHOWN_PX, JPEG_QUALITY = 360, 80  # width of one
TINTS = {PlantClass.WEED: (230, 40, 40), PlantClass.CROP: (40, 200, 60)}
TINT_RATIO = 0.6
LINE_RGB = (255, 220, 0)
COLUMNS = (
    "t_s", "x_map_m", "y_map_m", "yaw_map_rad", "crop_ratio", "weed_ratio", "doubt",
    "row_angle_deg", "row_offset_ratio", "row_sure", "unfit",
)  # fmt: skip


class ViewedPicture(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A picture with what the network and its rows say.

    The row is the one nearest to the middle of the lower edge: `row_angle_deg` is the angle of its
    line from upright, positive where it runs to the right on its way down, `row_offset_ratio` the
    distance of its foot from the middle in row spacings, right positive. None without a row.
    """

    t_s: float
    crop_ratio: float
    weed_ratio: float
    doubt: float | None
    unfit: str
    shown: ByteArray
    row_angle_deg: float | None = None
    row_offset_ratio: float | None = None
    row_sure: float | None = None

    def with_rows(self, rows: PictureRows) -> ViewedPicture:
        """Return the picture with the row nearest to the robot's way, and all rows drawn."""
        height, width = self.shown.shape[:2]
        feet = rows.find_feet()
        foot = float(feet[np.argmin(np.abs(feet - 0.5))])
        across_px = (foot - rows.across_ratio) * width
        angle_rad = math.atan2(across_px, (1.0 - rows.down_ratio) * height)
        return msgspec.structs.replace(
            self,
            shown=_draw_rows(self.shown, rows),
            row_angle_deg=math.degrees(angle_rad),
            row_offset_ratio=(foot - 0.5) / rows.spacing_ratio,
            row_sure=rows.sure,
        )


class CameraStudy(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The pictures of a topic that were looked at; `poses` are those of the filter, by time."""

    topic: str
    kind: str
    messages: int
    network: str
    pictures: tuple[ViewedPicture, ...]
    refused: tuple[str, ...] = ()
    poses: Mapping[float, Pose2] = {}

    def summarize(self) -> dict[str, Any]:
        """Summarize as `agribot localize --json` prints it under `camera`."""
        pictures = self.pictures
        crop, weed = (
            float(np.mean([getattr(one, name) for one in pictures]))
            for name in ("crop_ratio", "weed_ratio")
        )
        return {
            "topic": self.topic,
            "messages": self.messages,
            "pictures": len(pictures),
            "rows_found": sum(one.row_angle_deg is not None for one in pictures),
            "crop_ratio": round(crop, 4),
            "weed_ratio": round(weed, 4),
            "unfit": sum(bool(one.unfit) for one in pictures),
            "refused": len(self.refused),
        }


def tint_plants(image_rgb: ByteArray, class_id: ByteArray) -> ByteArray:
    """Tint weeds red and crops green in a picture (H, W, 3), at SHOWN_PX width."""
    mixed = image_rgb.astype(np.float64)
    for kind, rgb in TINTS.items():
        is_kind = class_id == kind
        mixed[is_kind] = (1.0 - TINT_RATIO) * mixed[is_kind] + TINT_RATIO * np.array(rgb)
    height, width = image_rgb.shape[:2]
    size = SHOWN_PX, max(1, round(height * SHOWN_PX / width))
    return np.asarray(Image.fromarray(mixed.astype(np.uint8)).resize(size))


def _draw_rows(shown: ByteArray, rows: PictureRows) -> ByteArray:
    picture = Image.fromarray(shown)
    pen = ImageDraw.Draw(picture)
    depth = 1.0 - rows.down_ratio
    for foot in rows.find_feet().tolist():
        ends = [
            ((rows.across_ratio + (foot - rows.across_ratio) * down) * picture.width,
             (rows.down_ratio + down * depth) * picture.height)
            for down in (FAR_RATIO / depth, 1.0)
        ]  # fmt: skip
        pen.line(ends, fill=LINE_RGB, width=2)
    return np.asarray(picture)


def write_pictures_table(path: Path, study: CameraStudy) -> None:
    """Write pictures.csv; an empty cell is not known.

    Raises: RecordingError: it cannot be written.
    """
    writing = explain_os_error(f"cannot write {path}", "choose another --out")
    with writing, path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        table.writerows(_list_cells(one, study.poses.get(one.t_s)) for one in study.pictures)


def _list_cells(one: ViewedPicture, pose: Pose2 | None) -> list[str]:
    place = (None,) * 3 if pose is None else (pose.x_m, pose.y_m, pose.yaw_rad)
    numbers = (
        *place, one.crop_ratio, one.weed_ratio, one.doubt, one.row_angle_deg, one.row_offset_ratio,
        one.row_sure,
    )  # fmt: skip
    cells = ["" if value is None else f"{value:.4f}" for value in numbers]
    return [f"{one.t_s:.3f}", *cells, one.unfit]


def describe_camera(study: CameraStudy) -> dict[str, object]:
    """Describe the section of the page: counts, pictures evenly over the log, and what is unfit."""
    summary, pictures = study.summarize(), study.pictures
    angles = [abs(one.row_angle_deg) for one in pictures if one.row_angle_deg is not None]
    tiles = (
        ("Pictures looked at", f"{len(pictures)} of {study.messages}", study.topic),
        ("With a row line", str(summary["rows_found"]), "of one camera's pictures together"),
        ("Angle of the line", format_number(_median(angles), 1, "°"), "from upright, median"),
        ("Crop in the picture", f"{summary['crop_ratio']:.1%}", f"by {study.network}"),
        ("Weed in the picture", f"{summary['weed_ratio']:.1%}", "of its pixels"),
        ("Unfit", str(summary["unfit"]), "by light, or plants that the network does not know"),
    )
    unfit = [f"First unfit, {one.t_s:.1f} s: {one.unfit}" for one in pictures if one.unfit]
    refused = [f"Not read, such as: {reason}" for reason in study.refused]
    shown = [(one.t_s, _describe_line(one), _encode(one.shown)) for one in _choose(pictures)]
    return {"tiles": tiles, "shown": shown, "notes": (*unfit[:1], *refused[:1])}


def _choose(pictures: Sequence[ViewedPicture]) -> list[ViewedPicture]:
    count = min(len(pictures), SHOWN)
    return [pictures[(2 * k + 1) * len(pictures) // (2 * count)] for k in range(count)]


def _describe_line(one: ViewedPicture) -> str:
    return "no row line" if one.row_angle_deg is None else f"row at {one.row_angle_deg:+.0f}°"


def _encode(image_rgb: ByteArray) -> str:
    encoded = io.BytesIO()
    Image.fromarray(image_rgb).save(encoded, format="JPEG", quality=JPEG_QUALITY)
    return base64.b64encode(encoded.getvalue()).decode()


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None
