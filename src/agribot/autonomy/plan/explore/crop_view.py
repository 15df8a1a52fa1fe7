"""The crop of one picture, and the line of the row that it shows, as places of the map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from agribot.core.messages import CropCover, FloatArray, RowLine
from agribot.core.pose import Pose2


class CropView(NamedTuple):
    """Cells of ground that a picture shows, (N, 2) in the map each: with crop, and all of them."""

    crop_map_m: FloatArray
    seen_map_m: FloatArray


def see_crop(cover: CropCover, pose: Pose2) -> CropView:
    """Place what a cover shows, seen from a pose."""
    count = cover.rows * cover.columns
    crop, seen = (
        np.unpackbits(np.frombuffer(bits, dtype=np.uint8), count=count).astype(bool)
        for bits in (cover.crop, cover.seen)
    )
    row, column = np.divmod(np.arange(count), cover.columns)
    x_m: FloatArray = cover.x_body_m + (row + 0.5) * cover.cell_m
    y_m: FloatArray = cover.y_body_m + (column + 0.5) * cover.cell_m
    at: tuple[FloatArray, FloatArray] = pose.transform(x_m, y_m)
    places = np.column_stack(at)
    return CropView(places[crop & seen], places[seen])


def place_line(line: RowLine, pose: Pose2) -> Pose2 | None:
    """Place the line of a row that a picture shows, seen from a pose, the way the robot looks.

    None: the picture has no line.
    """
    if line.offset_m is None or line.heading_rad is None:
        return None
    here = Pose2(*pose.transform(line.at_ahead_m, 0.0), pose.yaw_rad - line.heading_rad)
    return Pose2(*here.transform(0.0, -line.offset_m), here.yaw_rad)
