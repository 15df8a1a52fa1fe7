"""What the camera saw of single crop plants on a piece of way, put together by the odometry."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from agribot.autonomy.estimate.filter.history import Motion
from agribot.autonomy.estimate.filter.stem_map import COUNT_CELL_M
from agribot.core.messages import FloatArray, MapPoint, PlantClass, Scene
from agribot.core.pose import Pose2

# Looks nearer to each other than this are of one plant; pictures after which it counts.
SAME_M, LOOKS = 0.09, 3
# Pictures that must show ground, and its least distance within their edges.
VIEWS, INSIDE_M = 3, 0.08


class PlantWindow:
    """Call `add` with every picture, `cut` where a piece of way ends.

    Places are those of the odometry, in the map's axes. What was in an earlier piece of way, and is
    still in view, is not counted again.
    """

    def __init__(self) -> None:
        self._plants = np.empty((0, 3))  # x and y of each plant, and the looks at it
        self._views: Counter[tuple[int, int]] = Counter()
        self._counted_m = np.empty((0, 2))
        self._counted: set[tuple[int, int]] = set()

    @property
    def plants(self) -> FloatArray:
        """Plants that enough pictures show, (N, 2)."""
        kept: FloatArray = self._plants[self._plants[:, 2] >= LOOKS, :2]
        if len(kept) and len(self._counted_m):
            apart_m = np.hypot(*np.moveaxis(kept[:, None] - self._counted_m[None], -1, 0))
            kept = kept[apart_m.min(axis=1) > SAME_M]
        return kept

    @property
    def ground(self) -> FloatArray:
        """Middles of squares of ground that enough pictures show, (N, 2)."""
        cells = [
            cell for cell, views in self._views.items()
            if views >= VIEWS and cell not in self._counted
        ]  # fmt: skip
        middles: FloatArray = (np.array(cells, dtype=float).reshape(-1, 2) + 0.5) * COUNT_CELL_M
        return middles

    def add(self, scene: Scene, then: Motion, yaw_rad: float) -> None:
        """Take in a picture that was taken at a point of the odometry, with that heading."""
        pose = Pose2(then.x_m, then.y_m, yaw_rad)
        for plant in scene.plants:
            if plant.plant is PlantClass.CROP and math.isfinite(plant.x_body_m + plant.y_body_m):
                self._add_plant(*pose.transform(plant.x_body_m, plant.y_body_m))
        x_m, y_m = _fill(scene.view_body_m)
        at_m = np.column_stack(pose.transform(x_m, y_m))
        cells = np.floor(at_m / COUNT_CELL_M).astype(int)
        self._views.update(set(map(tuple, cells.tolist())))

    def cut(self) -> None:
        """Begin another piece of way: what was seen by now has been counted."""
        counted = {cell for cell, views in self._views.items() if views >= VIEWS}
        self._counted_m, self._counted = self._plants[self._plants[:, 2] >= LOOKS, :2], counted
        self._plants, self._views = np.empty((0, 3)), Counter()

    def _add_plant(self, x_m: float, y_m: float) -> None:
        apart_m = np.hypot(self._plants[:, 0] - x_m, self._plants[:, 1] - y_m)
        if len(apart_m) and apart_m.min() <= SAME_M:
            plant = self._plants[int(np.argmin(apart_m))]
            plant[2] += 1.0
            plant[:2] += ((x_m, y_m) - plant[:2]) / plant[2]
        else:
            self._plants = np.vstack([self._plants, (x_m, y_m, 1.0)])


def _fill(view_body_m: Sequence[MapPoint]) -> tuple[FloatArray, FloatArray]:
    """List places inside a convex polygon, somewhat within its edges."""
    corners = np.array(view_body_m, dtype=float).reshape(-1, 2)
    if len(corners) < 3:
        return np.empty(0), np.empty(0)
    low, high = corners.min(axis=0), corners.max(axis=0)
    step_m = COUNT_CELL_M / 1.5
    grid = np.meshgrid(*(np.arange(a, b, step_m) for a, b in zip(low, high, strict=True)))
    x_m, y_m = (axis.ravel() for axis in grid)
    side = np.roll(corners, -1, axis=0) - corners
    out_m = (
        side[:, :1] * (y_m - corners[:, 1:]) - side[:, 1:] * (x_m - corners[:, :1])
    ) / np.maximum(np.hypot(side[:, :1], side[:, 1:]), 1e-9)
    inside = (out_m.min(axis=0) >= INSIDE_M) | (out_m.max(axis=0) <= -INSIDE_M)
    return x_m[inside], y_m[inside]
