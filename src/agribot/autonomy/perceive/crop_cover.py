"""Crop pixels of a class map as cells of the ground, known to be plants of the map or not."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.core.messages import CropCover, FloatArray

CELL_M = 0.025
# Foliage is seen from above: what stands h high seems to lie h / H of its way farther off. Leaves
# of young crop are 2 to 16 cm high; where they pass out of view, that is 4 cm either way.
FOLIAGE_M = 0.08

Mask = npt.NDArray[np.bool_]


class CoverGrid:
    """Which cell each pixel of the class maps of one camera falls into; built once."""

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

    def cover(self, is_crop: Mask) -> CropCover:
        """Of the crop pixels (h, w). Seams of the ground are lines: leaves are broader."""
        crop = middles_of_squares(is_crop) & (self._cell >= 0)
        return CropCover(
            x_body_m=self._corner_m[0],
            y_body_m=self._corner_m[1],
            cell_m=CELL_M,
            rows=self._rows,
            columns=self._columns,
            crop=self._bits(crop),
            seen=self._seen,
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
