"""Crop on the ground before a robot, as the cover of an imaginary picture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from agribot.core.messages import CropCover, FloatArray
from agribot.core.pose import Pose2

CELL_M, NEAR_M, COUNT_X, COUNT_Y = 0.025, 0.65, 40, 86
Mask = npt.NDArray[np.bool_]
Grows = Callable[[FloatArray, FloatArray], Mask]


def cover_from(pose: Pose2, grows: Grows) -> CropCover:
    """`grows(x_map_m, y_map_m)` says where leaves of crop are; a metre of ground is in view."""
    side_m = COUNT_Y * CELL_M / 2.0
    x_m: FloatArray = NEAR_M + (np.arange(COUNT_X, dtype=np.float64) + 0.5) * CELL_M
    y_m: FloatArray = (np.arange(COUNT_Y, dtype=np.float64) + 0.5) * CELL_M - side_m
    at: tuple[FloatArray, FloatArray] = pose.transform(x_m[:, None], y_m[None, :])
    crop = np.broadcast_to(grows(*at), (COUNT_X, COUNT_Y))
    return CropCover(
        x_body_m=NEAR_M, y_body_m=-side_m, cell_m=CELL_M, rows=COUNT_X, columns=COUNT_Y,
        crop=np.packbits(crop.ravel()).tobytes(),
        seen=np.packbits(np.ones(crop.size, dtype=bool)).tobytes(),
    )  # fmt: skip
