"""Ground under leaves of crop, known to be plants of the map or not: no implement works there."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agribot.autonomy.weeds.ground_ring import (
    CELL_M,
    SIDE_CELLS,
    GroundRing,
    IndexArray,
    Mask,
    spread_steps,
    wrap,
)
from agribot.autonomy.weeds.poses import PoseAt
from agribot.core.implement.plants import Disc, GroundBox
from agribot.core.messages import CropCover, FloatArray
from agribot.core.pose import Pose2

# Around a plant that stands by itself there is bare ground, but for a leaf or a weed called crop.
RING_M, RING_STEPS, ALONE_RATIO = 0.075, 48, 0.1
# Evidence of the last looks, the newest with the largest weight: two in a row that show crop always
# close a cell. Weeds called crop in a single frame stay weeds. Only two looks in a row without crop
# open it again: one bare look may be a leaf's shadow or its edge.
NEWS_RATIO, CLOSED = 0.35, 0.5


class CropGround:
    """Call `add` for every cover with the pose of its capture; ask `covers` before working.

    Its cells are a ring that moves along with the robot: what lies farther off is forgotten.
    """

    def __init__(self) -> None:
        shape = (SIDE_CELLS, SIDE_CELLS)
        self._ring = GroundRing()
        self._evidence = np.zeros(shape, dtype=np.float32)
        self._is_closed = np.zeros(shape, dtype=bool)
        self._was_bare = np.zeros(shape, dtype=bool)  # in the last look
        self._explained = np.zeros(shape, dtype=np.float32)
        self._stems_m = np.full((4, *shape), np.nan)  # x, y of two, by their last look

    def shift(self, shift: Pose2) -> None:
        """Move all cells by a correction of the pose that they were seen from."""
        self._ring.shift(shift)

    def add(self, cover: CropCover, pose: PoseAt) -> None:
        """Take in what one frame shows; cells that it does not show keep what is known of them."""
        rows, columns = cover.rows, cover.columns
        seen, crop = _grid(cover.seen, rows, columns), _grid(cover.crop, rows, columns)
        stems_m = _place_owners(cover, crop, self._ring.from_map.compose(pose.map_from_body))
        if cover.unknown:
            crop = crop | _grid(cover.unknown, rows, columns)
        i, j, row, column = self._ring.find_covered(cover, pose.map_from_body, seen)
        self._note(i, j, crop[row, column], stems_m[:, row, column])

    def _note(self, i: IndexArray, j: IndexArray, is_crop: Mask, stems_m: FloatArray) -> None:
        at, is_known = wrap(i, j), self._ring.find_held(i, j)
        before = np.where(is_known, self._evidence[at], 0.0)
        self._evidence[at] = now = before + NEWS_RATIO * (is_crop - before)
        is_still_closed = is_known & self._is_closed[at] & ~(self._was_bare[at] & ~is_crop)
        self._is_closed[at] = is_still_closed | (now >= CLOSED)
        self._was_bare[at] = ~is_crop
        self._ring.take(i, j)
        has_stem = np.isfinite(stems_m[0])
        before = np.where(is_known, self._explained[at], 0.0)
        self._explained[at] = np.where(is_crop, before + NEWS_RATIO * (has_stem - before), before)
        cells = (at[0][has_stem], at[1][has_stem])
        self._stems_m[:, cells[0], cells[1]] = stems_m[:, has_stem]

    def covers(
        self, box: GroundBox, known: Sequence[Disc] = (), stems: Sequence[Disc] = ()
    ) -> bool:
        """Whether crop covers any of a box.

        Leaves inside the discs `known` do not count, nor do those that two looks in a row saw
        point into the discs `stems` and nowhere else: of those plants only the stems are spared.
        """
        i, j = self._list_crop(*self._find_cells(box))
        is_unknown = np.ones(len(i), dtype=bool)
        for disc in self._bring(known):
            dx_m, dy_m = (i + 0.5) * CELL_M - disc.x_map_m, (j + 0.5) * CELL_M - disc.y_map_m
            is_unknown &= np.hypot(dx_m, dy_m) > disc.radius_m
        if stems and is_unknown.any():
            here = self._bring(stems)
            is_unknown &= ~self._is_explained(*wrap(i, j), here)
        return bool(is_unknown.any())

    def _is_explained(self, i: IndexArray, j: IndexArray, stems: Sequence[Disc]) -> Mask:
        """Whether all leaves of cells (N,) point to stems in the discs."""
        x_m, y_m, radius_m = np.array(stems).T[:, :, None]
        is_explained: Mask = self._explained[i, j] >= CLOSED
        for at_x_m, at_y_m in (self._stems_m[:2, i, j], self._stems_m[2:, i, j]):
            is_explained &= (np.hypot(at_x_m - x_m, at_y_m - y_m) <= radius_m).any(axis=0)
        return is_explained

    def is_seen(self, box: GroundBox) -> bool:
        """Whether all of a box was looked at."""
        return bool(self._ring.find_held(*self._find_cells(box)).all())

    def _find_cells(self, box: GroundBox) -> tuple[IndexArray, ...]:
        along_m, across_m = spread_steps(box.half_x_m)[:, None], spread_steps(box.half_y_m)[None, :]
        return self._ring.find_cells(box.middle, along_m, across_m)

    def is_alone(self, plant: Disc) -> bool:
        """Whether hardly any crop grows around the disc: its leaves are those of one plant."""
        angle_rad = np.linspace(0.0, math.tau, RING_STEPS, endpoint=False)[None, :]
        radius_m = plant.radius_m + np.linspace(CELL_M, RING_M, 3)[:, None]
        middle = Pose2(plant.x_map_m, plant.y_map_m, 0.0)
        at_m = radius_m * np.cos(angle_rad), radius_m * np.sin(angle_rad)
        i, _ = self._list_crop(*self._ring.find_cells(middle, *at_m))
        return len(i) <= ALONE_RATIO * angle_rad.size * radius_m.size

    def _bring(self, discs: Sequence[Disc]) -> list[Disc]:
        """Bring discs of the map to the grid."""
        move = self._ring.from_map.transform
        return [Disc(*move(disc.x_map_m, disc.y_map_m), disc.radius_m) for disc in discs]

    def _list_crop(self, i: IndexArray, j: IndexArray) -> tuple[IndexArray, IndexArray]:
        """List those of the cells (...,) that crop covers, as often as they are named."""
        is_crop = self._ring.find_held(i, j) & self._is_closed[wrap(i, j)]
        return i[is_crop], j[is_crop]


def _grid(bits: bytes, rows: int, columns: int) -> Mask:
    cells = np.unpackbits(np.frombuffer(bits, dtype=np.uint8), count=rows * columns)
    grid: Mask = cells.reshape(rows, columns).astype(bool)
    return grid


def _place_owners(cover: CropCover, crop: Mask, grid_from_body: Pose2) -> FloatArray:
    """Place the two stems of each cell of crop in the grid: (4, rows, columns), NaN where unknown.

    A cell whose leaves do not all point to a stem has none.
    """
    stems_m = np.full((4, *crop.shape), np.nan)
    if not cover.owners:
        return stems_m
    x_m, y_m = grid_from_body.transform(*np.array(cover.stems_body_m).reshape(-1, 2).T)
    x_m, y_m = np.append(np.nan, x_m), np.append(np.nan, y_m)
    first, last = np.frombuffer(cover.owners, dtype=np.uint8).reshape(-1, 2).T
    stems_m[:, crop] = x_m[first], y_m[first], x_m[last], y_m[last]
    return stems_m
