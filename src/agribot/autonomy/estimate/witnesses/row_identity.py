"""Which row the robot is in: how sure that is, from what grows in the rows and beside them.

Rows look alike, but not what lies beside them: left of the first row and right of the last one
nothing grows. The pose may be right to a centimetre across its row and yet be a whole row off.
The probability of each number of rows off is kept, and updated with every stretch of way by Bayes'
rule; stretches of one row share their causes, a gap or a patch of weeds taken for crop, so that the
weight of one row is limited.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np

from agribot.autonomy.estimate.filter.field_rows import RowFrame, Rows
from agribot.core.facts import PlantsElsewhere, Side, WhichRow
from agribot.core.messages import CropCover
from agribot.core.pose import Pose2

# Probability of each number of rows to the right of the believed one, for a robot that a person put
# down on its mark.
PRIOR: dict[int, float] = {-2: 0.002, -1: 0.008, 0: 0.98, 1: 0.008, 2: 0.002}
LEAST_SHARE = 1e-9  # least share of a row in which no plant of the map fits
OTHER_ROW = 1e-6  # probability of every other row, once a person has named the row
# Length of the stretch that is one look, and its distance ahead of the robot.
LOOK_M, AHEAD_M = 0.5, 1.2
# Search for crop to either side of a row, and cells of it that must be in view.
HALF_STRIP_M, MIN_CELLS = 0.2, 60
# Least share of crop in a strip where a row grows, and largest where none does.
CROP_RATIO, BARE_RATIO = 0.05, 0.01
# Probability of a look at crop beside every row, and at bare ground in one, against expected looks;
# and the largest weight of all looks at one strip of a row.
STRAY_CROP, BARE_ROW = math.log(1.0 / 9.0), math.log(1.0 / 3.0)
MOST_CROP, MOST_BARE = math.log(1.0 / 1000.0), math.log(1.0 / 100.0)
# Largest plant spacing at which a look shows anything, and the uncertain length at a row's end.
MAX_SPACING_M, END_M = 0.5, 0.6
MAX_ASLANT_RAD = math.radians(12.0)
# A place this near to the line of a row, in row distances, is in it; between rows it is in none.
IN_ROW_RATIO, OFF_ROW_RATIO = 0.25, 0.7

Strip = Literal[-1, 0, 1]  # to the left, the robot's own row, to the right
STRIPS: tuple[Strip, ...] = (-1, 0, 1)


class _Share(NamedTuple):
    crop: float = 0.0
    seen: float = 0.0


class RowIdentity:
    """Call `look` with what pictures show of crop, `name` for what speaks against the row."""

    def __init__(self, least_certainty: float) -> None:
        self._least = least_certainty
        self._said: dict[tuple[int, Strip, int], float] = {}
        self._began: tuple[float, float] | None = None
        # Evidence of another row, by the plants of a map.
        self.elsewhere: PlantsElsewhere | None = None
        self._by_plants: dict[int, float] = {}
        self._certainty: float | None = None
        self.restart()

    @property
    def certainty(self) -> float:
        """Probability that the robot is in the row in which it believes to be."""
        if self._certainty is None:  # it is asked for in every tick, and changes with few pictures
            self._certainty = self._share(0)
        return self._certainty

    @property
    def doubt(self) -> PlantsElsewhere | WhichRow | None:
        """The question for a person; None while the row is sure enough, or once it is answered."""
        if self.elsewhere is not None:
            return self.elsewhere
        if self.certainty >= self._least:
            return None
        shift = max((s for s in self._log if s), key=self._share)
        side: Side = "right" if shift > 0 else "left"
        return WhichRow(abs(shift), side, self.certainty, self._least)

    def restart(self) -> None:
        """Forget what was seen: these are other rows."""
        self._log = {shift: math.log(share) for shift, share in PRIOR.items()}
        self._certainty = None
        self._said.clear()
        self._by_plants = {}
        self.elsewhere = None
        self._end_look()

    def weigh(self, shares: dict[int, float]) -> None:
        """Take in how likely each number of rows aside is, by all mapped plants until now.

        The rest to 1 is the probability that the plants that were seen are not on the map.
        """
        missing = max(1.0 - sum(shares.values()), 0.0)
        self._by_plants = {shift: shares.get(shift, 0.0) + missing for shift in self._log}
        self._certainty = None

    def confirm_row(self) -> None:
        """Begin anew: a person has said where the robot is."""
        self.restart()
        self._log = {shift: math.log(OTHER_ROW) if shift else 0.0 for shift in PRIOR}

    def doubt_by(self, left: float, right: float) -> None:
        """Take in that the pose may have found the row to the left or right of the true one.

        `right` is the probability that the true row is to the right of the one it found.
        """
        share = {shift: self._share(shift) for shift in self._log}
        for shift, own in share.items():
            came = share.get(shift - 1, 0.0) * right + share.get(shift + 1, 0.0) * left
            self._log[shift] = math.log(own * (1.0 - left - right) + came)
        self._certainty = None

    def look(self, cover: CropCover, pose: Pose2, rows: Rows) -> None:
        """Take in the crop of a picture that was taken at a pose."""
        x_m, y_m = pose.transform(AHEAD_M, 0.0)
        here = rows.at(x_m, y_m)
        aslant_rad = math.remainder(pose.yaw_rad - here.yaw_rad, math.pi)
        is_dense = rows.spacing_m is None or rows.spacing_m <= MAX_SPACING_M
        is_beside = not math.isfinite(here.pitch_m) or abs(aslant_rad) > MAX_ASLANT_RAD
        if not is_dense or is_beside or abs(here.off_m) > IN_ROW_RATIO * here.pitch_m:
            self._end_look()
            return
        self._add(_measure(cover, pose, here, aslant_rad))
        if self._began is None:
            self._began = pose.xy_m
        if math.dist(self._began, pose.xy_m) >= LOOK_M:
            self._conclude((x_m, y_m), here, rows)
            self._end_look()

    def _add(self, shares: Iterable[tuple[Strip, float, float]]) -> None:
        for strip, crop, seen in shares:
            before = self._shares[strip]
            self._shares[strip] = _Share(before.crop + crop, before.seen + seen)

    def _end_look(self) -> None:
        self._shares, self._began = dict.fromkeys(STRIPS, _Share()), None

    def _conclude(self, place: tuple[float, float], here: RowFrame, rows: Rows) -> None:
        """Compare one look with where each row would be, for each number of rows aside."""
        for strip in STRIPS:
            crop, seen = self._shares[strip]
            ratio = crop / seen if seen else math.nan
            if not (ratio >= CROP_RATIO or ratio <= BARE_RATIO):
                continue
            is_crop = ratio >= CROP_RATIO
            grows = {shift: _grows(place, here, rows, shift + strip) for shift in self._log}
            if None in grows.values():
                continue
            for shift, is_row in grows.items():
                if is_row != is_crop:
                    self._object((here.row, strip, shift), is_crop=is_crop)

    def _object(self, key: tuple[int, Strip, int], *, is_crop: bool) -> None:
        """Add to what a strip of a row has said against a number of rows, up to a limit."""
        said, most = (STRAY_CROP, MOST_CROP) if is_crop else (BARE_ROW, MOST_BARE)
        before = self._said.get(key, 0.0)
        self._said[key] = after = min(before, max(before + said, most))
        self._log[key[2]] += after - before
        self._certainty = None

    def _share(self, shift: int) -> float:
        weights = {
            each: value + math.log(max(self._by_plants.get(each, 1.0), LEAST_SHARE))
            for each, value in self._log.items()
        }
        highest = max(weights.values())
        total = sum(math.exp(value - highest) for value in weights.values())
        return math.exp(weights[shift] - highest) / total


def _grows(place: tuple[float, float], here: RowFrame, rows: Rows, rows_right: int) -> bool | None:
    """Whether the map has a row `rows_right` rows right of a place; None where that is unsure."""
    aside_m = here.off_m + rows_right * here.pitch_m
    x_m, y_m = place[0] + aside_m * here.right[0], place[1] + aside_m * here.right[1]
    at = rows.at(x_m, y_m)
    if abs(at.off_m) >= OFF_ROW_RATIO * here.pitch_m:
        return False
    if abs(at.off_m) > IN_ROW_RATIO * here.pitch_m:
        return None
    inside_m = min(at.along_m, at.length_m - at.along_m)
    return None if abs(inside_m) < END_M else inside_m > 0.0


def _measure(
    cover: CropCover, pose: Pose2, here: RowFrame, aslant_rad: float
) -> Iterable[tuple[Strip, float, float]]:
    """Count cells of crop and cells in view in the strips along the rows beside the robot."""
    shape = cover.rows, cover.columns
    cells = [
        np.unpackbits(np.frombuffer(bits, dtype=np.uint8), count=shape[0] * shape[1])
        for bits in (cover.crop, cover.seen)
    ]
    x_m = cover.x_body_m + (np.arange(shape[0]) + 0.5) * cover.cell_m
    y_m = cover.y_body_m + (np.arange(shape[1]) + 0.5) * cover.cell_m
    is_along = math.cos(pose.yaw_rad - here.yaw_rad) > 0.0
    # To the right of the own row, as the rows run.
    left_m = (x_m[:, None] - AHEAD_M) * math.sin(aslant_rad) + y_m[None, :] * math.cos(aslant_rad)
    right_m = (-left_m if is_along else left_m) - here.off_m
    for strip in STRIPS:
        inside = (np.abs(right_m - strip * here.pitch_m) <= HALF_STRIP_M).ravel()
        crop, seen = (float(np.count_nonzero(bits[inside])) for bits in cells)
        if seen >= MIN_CELLS:
            yield strip, crop, seen
