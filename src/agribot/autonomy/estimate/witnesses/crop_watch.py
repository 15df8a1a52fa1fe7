"""Plants that stand in the rows of the map, and that the network does not call crop.

The rows are known, so plants in them are crop. A network that calls nearly none of them crop does
not know this crop, and takes it for weeds. The plants show where their row runs, even with a pose
that is decimetres off or a crop that the network does not know.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.autonomy.estimate.filter.field_rows import RowFrame, Rows
from agribot.core.facts import CropUnknown
from agribot.core.geo import wrap_rad
from agribot.core.messages import CropCover, FloatArray
from agribot.core.pose import Pose2

Counts = npt.NDArray[np.int64]

# Length of row that decides, m and in plant spacings: four plants 25 cm apart, three of wider ones.
MEMORY_M, MEMORY_SPACINGS = 1.0, 3.0
LOOK_M, LEAST_LOOKS = 0.05, 5  # way between two looks that count, and how many decide
SLOT_M, BIN_M = 0.1, 0.025  # along the row and across it
REACH_M = 0.3  # search for plants to either side of the mapped line
BINS = round(2.0 * REACH_M / BIN_M)
BAND_BINS = 2  # half width of a row's band, to either side of its middle
MAX_ASLANT_RAD = math.radians(20.0)
LEAST_FILLED = 0.1  # least filled share of the band of a slot with a plant
LEAST_SLOTS = 4  # least slots with plants
LEAST_CONTRAST = 2.0  # contrast of plants in the row against those beside it
# Least share of crop in the row's plant cells for a network that knows the crop, and largest share
# for one that does not.
AGREES_RATIO, STRANGE_RATIO = 0.4, 0.2


class _Slot(NamedTuple):
    """Counts of pictures for a piece of a row, by bins across it."""

    seen: Counts
    crop: Counts
    weed: Counts


class CropWatch:
    """Call `look` with every picture's cover; `fault` says that the rows hold no crop it knows."""

    def __init__(self) -> None:
        self._slots: dict[int, _Slot] = {}
        self._row: int | None = None
        self._looks = 0  # at this row
        self._last: Pose2 | None = None
        self._fault: CropUnknown | None = None
        self._is_accepted = False

    @property
    def fault(self) -> CropUnknown | None:
        return None if self._is_accepted else self._fault

    def accept(self) -> None:
        """Believe the network until it agrees with the rows again: a person says so."""
        self._is_accepted = self._fault is not None

    def look(self, cover: CropCover, map_from_body: Pose2, rows: Rows) -> None:
        """Take a picture, seen from this pose; without rows or bits of weeds it says nothing."""
        if not cover.weed or not rows.has_rows or not self._has_moved(map_from_body):
            return
        frame = rows.at(*map_from_body.xy_m)
        aslant_rad = abs(wrap_rad(map_from_body.yaw_rad - frame.yaw_rad))
        if min(aslant_rad, math.pi - aslant_rad) > MAX_ASLANT_RAD:
            return
        if frame.row != self._row:
            self._row, self._slots, self._looks = frame.row, {}, 0
        self._looks += 1
        self._add(cover, map_from_body, frame)
        memory_m = max(MEMORY_M, MEMORY_SPACINGS * (rows.spacing_m or 0.0))
        self._judge(frame, round(memory_m / SLOT_M))

    def _has_moved(self, pose: Pose2) -> bool:
        last = self._last
        if last is not None and math.dist(last.xy_m, pose.xy_m) < LOOK_M:
            return False
        self._last = pose
        return True

    def _add(self, cover: CropCover, map_from_body: Pose2, frame: RowFrame) -> None:
        """Add the cells of a picture to the slots of the row."""
        seen, crop, weed = (_read(bits, cover) for bits in (cover.seen, cover.crop, cover.weed))
        row, column = np.divmod(np.flatnonzero(seen), cover.columns)
        dx_m, dy_m = map_from_body.rotate(
            cover.x_body_m + (row + 0.5) * cover.cell_m,
            cover.y_body_m + (column + 0.5) * cover.cell_m,
        )
        along_m = frame.along_m + dx_m * frame.forward[0] + dy_m * frame.forward[1]
        right_m = dx_m * frame.right[0] + dy_m * frame.right[1] - frame.off_m
        is_near = (along_m >= 0.0) & (along_m <= frame.length_m)
        is_near &= np.abs(right_m) < min(REACH_M, frame.pitch_m / 2.0)
        slots = np.floor(along_m[is_near] / SLOT_M).astype(int)
        bins = np.floor((right_m[is_near] + REACH_M) / BIN_M).astype(int)
        kinds = crop[seen][is_near], weed[seen][is_near] & ~crop[seen][is_near]
        for slot in np.unique(slots).tolist():
            here = slots == slot
            counts = (here, here & kinds[0], here & kinds[1])
            self._count(slot, _Slot(*(np.bincount(bins[c], minlength=BINS) for c in counts)))

    def _count(self, slot: int, counts: _Slot) -> None:
        before = self._slots.get(slot)
        if before is not None:
            counts = _Slot(*(a + b for a, b in zip(before, counts, strict=True)))
        self._slots[slot] = counts

    def _judge(self, frame: RowFrame, length: int) -> None:
        """Judge the pieces of row nearest to the robot, ahead of it and passed."""
        here = frame.along_m / SLOT_M
        nearest = sorted(self._slots, key=lambda slot: abs(slot + 0.5 - here))[:length]
        self._slots = {slot: self._slots[slot] for slot in nearest}
        if len(nearest) < length or self._looks < LEAST_LOOKS:
            return
        seen, crop, weed = (
            np.array([self._slots[slot][kind] for slot in nearest]) for kind in range(3)
        )
        band = _find_band(seen, crop + weed)
        if band is None:
            return
        share = crop[:, band].sum() / (crop + weed)[:, band].sum()
        if share >= AGREES_RATIO:
            self._fault, self._is_accepted = None, False
        elif share <= STRANGE_RATIO:
            self._fault = CropUnknown(float(share), length * SLOT_M, frame.row + 1)


def _read(bits: bytes, cover: CropCover) -> npt.NDArray[np.bool_]:
    count = cover.rows * cover.columns
    return np.unpackbits(np.frombuffer(bits, dtype=np.uint8), count=count).astype(bool)


def _find_band(seen: Counts, plants: Counts) -> slice | None:
    """Find the bins across of the row that plants (slots, bins) stand in; None: in no row."""
    density: FloatArray = plants.sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    window = np.ones(2 * BAND_BINS + 1)
    smooth = np.convolve(density, window / len(window), "valid")
    first = int(smooth.argmax())
    band = slice(first, first + len(window))
    filled = plants[:, band].sum(axis=1) / np.maximum(seen[:, band].sum(axis=1), 1)
    if (filled >= LEAST_FILLED).sum() < LEAST_SLOTS:
        return None
    beside = np.ones(BINS, dtype=bool)
    beside[max(first - 2 * BAND_BINS, 0) : band.stop + 2 * BAND_BINS] = False
    beside &= seen.sum(axis=0) > 0
    if beside.any() and smooth[first] < LEAST_CONTRAST * density[beside].mean():
        return None
    return band
