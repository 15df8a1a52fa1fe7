"""Crop pixels of a class map as cells of the ground, known to be plants of the map or not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.errors import PerceptionError
from agribot.core.messages import CropCover, FloatArray

CELL_M = 0.025
# Height of foliage, which is seen from above: a leaf at height h seems to lie h / H of its way
# farther off. Leaves of young crop are 2 to 16 cm high; at the near edge of the view, that is 4 cm
# either way.
FOLIAGE_M = 0.08

# Marks of a pixel without a stem of crop: no leaf of crop, a leaf without a stem, and one whose
# stem is outside the picture.
NO_LEAF, NO_STEM, OUTSIDE = -1, -2, -3
MOST_STEMS = 255

Mask = npt.NDArray[np.bool_]
Owners = npt.NDArray[np.int32]


class StemLeaves(NamedTuple):
    """A plant network's answer on the leaves of one picture.

    `owner` (h, w) is the index of the stem of crop that a pixel points to, or one of the three
    words above; `places_m` (N, 2) is where the stems stand in the body frame, NaN where unknown.
    """

    owner: Owners
    places_m: FloatArray

    def check_shape(self, shape: tuple[int, ...]) -> None:
        """Refuse leaves of a picture of another size.

        Raises: PerceptionError: its pixels are not those of (h, w).
        """
        if self.owner.shape != shape:
            raise PerceptionError(
                f"leaves of {self.owner.shape} pixels over a map of {shape}; use one network for "
                "both"
            )


class CoverGrid:
    """Cell of each pixel of one camera's class maps; built once."""

    def __init__(
        self,
        x_body_m: npt.NDArray[np.float32],
        y_body_m: npt.NDArray[np.float32],
        in_range: Mask,
        camera_xyz_body_m: FloatArray,
    ) -> None:
        """`x_body_m`, `y_body_m` (h, w) are each pixel's ground, `in_range` those that count."""
        nearer = 1.0 - FOLIAGE_M / float(camera_xyz_body_m[2])
        x_camera_m, y_camera_m = camera_xyz_body_m[:2].tolist()
        row = np.floor((x_camera_m + nearer * (x_body_m[in_range] - x_camera_m)) / CELL_M)
        column = np.floor((y_camera_m + nearer * (y_body_m[in_range] - y_camera_m)) / CELL_M)
        first_row, first_column = int(row.min()), int(column.min())
        self._columns = int(column.max()) - first_column + 1
        self._rows = int(row.max()) - first_row + 1
        cell = (row - first_row) * self._columns + column - first_column
        self._cell = np.full(in_range.shape, -1, dtype=np.int64)
        self._cell[in_range] = cell.astype(np.int64)
        self._corner_m = (first_row * CELL_M, first_column * CELL_M)
        self._seen = self._bits(in_range)
        self._seen_cells = np.zeros(self._rows * self._columns, dtype=bool)
        self._seen_cells[self._cell[in_range]] = True

    def cover(
        self, is_crop: Mask, leaves: StemLeaves | None = None, is_weed: Mask | None = None
    ) -> CropCover:
        """Compute it from the crop pixels (h, w) and, if a network gives stems, from their leaves.

        Seams of the ground are lines of crop pixels: leaves are broader. What points to a stem of
        crop is crop as well, whatever its pixels look like and however thin it is.
        """
        crop = middles_of_squares(is_crop) & (self._cell >= 0)
        if leaves is None:
            return self._make(crop, self._seen, weed=self._note_weeds(is_weed))
        leaves.check_shape(is_crop.shape)
        owner = np.where(self._cell >= 0, leaves.owner, NO_LEAF)
        unknown = (owner == NO_STEM) & ~is_crop
        crop |= owner >= 0
        is_cut = np.zeros(self._rows * self._columns, dtype=bool)
        is_cut[self._cell[(owner == OUTSIDE) & ~is_crop]] = True
        is_cut[self._cell[crop | unknown]] = False
        seen = np.packbits(self._seen_cells & ~is_cut).tobytes()
        stems_body_m, owners = self._own(crop, owner, leaves.places_m)
        weed = self._note_weeds(is_weed)
        return self._make(crop, seen, self._bits(unknown), stems_body_m, owners, weed)

    def _note_weeds(self, is_weed: Mask | None) -> bytes:
        return b"" if is_weed is None else self._bits(is_weed & (self._cell >= 0))

    def _own(
        self, crop: Mask, owner: Owners, places_m: FloatArray
    ) -> tuple[tuple[tuple[float, float], ...], bytes]:
        """Find the stems that leaves of crop point to, and for each cell of crop its two."""
        cell, owner = self._cell[crop], owner[crop]
        is_owner = np.zeros(len(places_m), dtype=bool)
        is_owner[owner[owner >= 0]] = True
        is_owner &= np.isfinite(places_m).all(axis=1)
        stems = np.flatnonzero(is_owner)[:MOST_STEMS]
        number = np.zeros(len(places_m) + 1, dtype=np.uint8)
        number[stems] = np.arange(1, len(stems) + 1)
        numbers = number[np.where(owner >= 0, owner, len(places_m))]
        first = np.full(self._rows * self._columns, 255, dtype=np.uint8)
        last = np.zeros_like(first)
        np.minimum.at(first, cell, numbers)
        np.maximum.at(last, cell, numbers)
        holds = np.unique(cell)
        pairs = np.column_stack([first[holds], last[holds]])
        pairs[pairs[:, 0] == 0] = 0
        return tuple((x, y) for x, y in places_m[stems].tolist()), pairs.tobytes()

    def _make(
        self,
        crop: Mask,
        seen: bytes,
        unknown: bytes = b"",
        stems_body_m: tuple[tuple[float, float], ...] = (),
        owners: bytes = b"",
        weed: bytes = b"",
    ) -> CropCover:
        return CropCover(
            x_body_m=self._corner_m[0],
            y_body_m=self._corner_m[1],
            cell_m=CELL_M,
            rows=self._rows,
            columns=self._columns,
            crop=self._bits(crop),
            seen=seen,
            unknown=unknown,
            stems_body_m=stems_body_m,
            owners=owners,
            weed=weed,
        )

    def _bits(self, pixels: Mask) -> bytes:
        holds = np.zeros(self._rows * self._columns, dtype=bool)
        holds[self._cell[pixels]] = True
        return np.packbits(holds).tobytes()


def middles_of_squares(mask: Mask) -> Mask:
    """Find the middles of all squares of three by three pixels that the mask (H, W) fills."""
    flat = mask[:-2] & mask[1:-1] & mask[2:]
    thick = np.zeros_like(mask)
    thick[1:-1, 1:-1] = flat[:, :-2] & flat[:, 1:-1] & flat[:, 2:]
    return thick
