"""Whether labels lie on what is green in their picture, picture by picture.

What is greener than its surroundings is compared with the labels at their place, at every shifted
place, mirrored, turned, and in the pictures beside. Labels of another picture fit no better than at
a place that was drawn by lot.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.plant_cover import excess_green
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.classes import UNLABELLED

Grid = npt.NDArray[np.float64]

# Largest accepted share of misplaced pictures among those that can be judged.
MOST_MISPLACED_RATIO = 0.25
MOST_SIDE_PX = 1024  # largest side; of larger pictures every second, third ... pixel is looked at
SIDE_PX = 192  # side of the grid on which pictures and labels are compared
SURROUNDINGS_RATIO = 6.0  # surroundings over the longer side, 1 sigma
# Measured on 114 photographs of CWFID, Carrot-Weed and Peanut and 72 drawn ones, as they are and
# with the labels of the next picture, mirrored, turned and shifted by 3 %:
LEAST_SIGMAS = 2.5  # least distance in sigmas; measured: 3.4 and more
LEAST_PEAK_RATIO = 0.7  # least ratio to the best shifted place; measured: 0.82 and more
BETTER_RATIO = 1.75  # ratio by which another place fits better; measured: 0.57 of their own at most
CLEAR_SIGMAS = 6.0  # sigmas of a place in a message
ON_GREEN_RATIO = 0.5  # share of the plant pixels: few plants of many may be labelled
# Pictures without green plants, such as grey ones, say nothing.
LEAST_GREEN_STEP = 0.1
LEAST_SMOOTHNESS = 0.3  # correlation of neighbouring places
NOWHERE = "they fit no place in it better than a random one"
MOST_NAMED = 3
NEIGHBOURS = 50  # pictures before and behind, whose labels these may be
_TURNS: Mapping[str, tuple[int, bool]] = {  # quarter turns to the left, then mirrored or not
    "mirrored left to right": (0, True),
    "mirrored upside down": (2, True),
    "turned by 180 degrees": (2, False),
    "turned by 90 degrees to the left": (1, False),
    "turned by 90 degrees to the right": (3, False),
    "mirrored along a diagonal": (1, True),
    "mirrored along the other diagonal": (3, True),
}


class _Sample(NamedTuple):
    """A picture's greenness and its labels' plants, of mean 0 and norm 1, and how well they fit."""

    name: str
    green: Grid
    plants: Grid
    fit: float
    sigma: float
    is_on_green: bool


class PlacementTally:
    """Collects the pictures whose labels do not lie on plants, with what is known of why."""

    def __init__(self) -> None:
        self.misplaced: dict[str, str] = {}
        self._clear: set[str] = set()
        self._before: deque[_Sample] = deque(maxlen=NEIGHBOURS)

    def add(self, name: str, image_rgb: ByteArray, label: ByteArray) -> None:
        """Judge a picture (height, width, 3) and its classes (height, width)."""
        skip = max(1, max(label.shape) // MOST_SIDE_PX)
        image_rgb, label = image_rgb[::skip, ::skip], label[::skip, ::skip]
        step = max(1, -(-max(label.shape) // SIDE_PX))
        fine = excess_green(image_rgb)
        plants, green = _shrink_plants(label, step), _shrink(fine, step)
        if plants is None:
            return
        flat = _normalise(_flatten(green))
        sample, reason = _judge(name, flat, _normalise(plants), step * skip)
        threshold, is_clear = _find_green(green, flat)
        is_green = fine > threshold
        share, base = float(is_green[label < PlantClass.SOIL].mean()), float(is_green.mean())
        is_on_green = share - base > ON_GREEN_RATIO * (1.0 - base)
        sample = sample._replace(is_on_green=is_on_green)
        if is_clear:
            self._clear.add(name)
        if reason and not is_on_green and (is_clear or reason != NOWHERE):
            self.misplaced[name] = reason
        for other in self._before:
            self._compare(sample, other)
            self._compare(other, sample)
        self._before.append(sample)

    def _compare(self, labels: _Sample, picture: _Sample) -> None:
        """Note labels that fit another picture better than their own."""
        if labels.plants.shape != picture.green.shape or labels.is_on_green:
            return
        fit = abs(float((labels.plants * picture.green).sum()))
        if fit > max(BETTER_RATIO * abs(labels.fit), CLEAR_SIGMAS * labels.sigma):
            self.misplaced[labels.name] = f"they are those of {picture.name}"

    @property
    def judged(self) -> int:
        """Count of pictures that show plants, or labels that belong elsewhere."""
        return len(self._clear | self.misplaced.keys())

    @property
    def is_refused(self) -> bool:
        """Whether more are misplaced than a set that is believed may have."""
        return len(self.misplaced) > MOST_MISPLACED_RATIO * self.judged

    def refuse(self, what: str) -> None:
        """Refuse a set with too many misplaced pictures.

        Raises: ConfigError: more than MOST_MISPLACED_RATIO of those that can be judged.
        """
        if self.is_refused:
            raise ConfigError(
                f"{what}: {self.summarise()}; more than {MOST_MISPLACED_RATIO:.0%} are not "
                "believed: check names, axes and turns in the export, or go on with "
                "--keep-misplaced"
            )

    def summarise(self) -> str:
        """Say how many are misplaced, what most have in common, and name the first ones."""
        reasons = list(self.misplaced.values())
        common = max(set(reasons), key=lambda one: (reasons.count(one), one))
        is_common = reasons.count(common) > max(1, len(reasons) / 2)
        what = f", {common}" if is_common else ""
        some = [
            name if reason == common and is_common else f"{name}: {reason}"
            for name, reason in [*self.misplaced.items()][:MOST_NAMED]
        ]
        return (
            f"the labels of {len(reasons)} of {self.judged} pictures do not lie on their plants"
            f"{what} ({'; '.join(some)})"
        )


def _judge(name: str, green: Grid, plants: Grid, step_px: int) -> tuple[_Sample, str]:
    """Compare the place of labels with all others; the reason is empty where they fit theirs."""
    fits = np.fft.irfft2(np.fft.rfft2(green) * np.conj(np.fft.rfft2(plants)), s=green.shape)
    fit, sigma = float(fits[0, 0]), float(fits.std())
    sample = _Sample(name, green, plants, fit, sigma, is_on_green=False)
    peak = np.unravel_index(int(np.abs(fits).argmax()), fits.shape)
    found = {
        what: abs(float((green * _turn(plants, *turn)).sum())) for what, turn in _TURNS.items()
    }
    found[_name_shift(peak, fits.shape, step_px)] = (
        LEAST_PEAK_RATIO * BETTER_RATIO * abs(fits[peak])
    )
    best = max(found, key=lambda what: found[what])
    if found[best] > max(BETTER_RATIO * abs(fit), CLEAR_SIGMAS * sigma):
        return sample, f"they would when {best}"
    is_random = abs(fit - float(fits.mean())) < LEAST_SIGMAS * sigma
    is_beside = abs(fit) < LEAST_PEAK_RATIO * abs(fits[peak])
    return sample, NOWHERE if is_random or is_beside else ""


def _turn(plants: Grid, quarters: int, is_mirrored: bool) -> Grid:
    turned = np.rot90(plants, quarters)
    turned = turned[:, ::-1] if is_mirrored else turned
    if turned.shape == plants.shape:
        return turned
    rows, columns = (
        ((np.arange(size) + 0.5) * (source / size)).astype(np.int64)
        for size, source in zip(plants.shape, turned.shape, strict=True)
    )
    return _normalise(turned[rows[:, None], columns[None, :]])


def _name_shift(peak: tuple[np.intp, ...], shape: tuple[int, ...], step_px: int) -> str:
    down, right = (
        int((at + size // 2) % size - size // 2) * step_px
        for at, size in zip(peak, shape, strict=True)
    )
    sides = ("left" if right < 0 else "right", "up" if down < 0 else "down")
    return f"moved {abs(right)} px {sides[0]} and {abs(down)} px {sides[1]}"


def _find_green(green: Grid, flat: Grid) -> tuple[float, bool]:
    """Find from where on a picture is green, and whether it shows green plants at all."""
    threshold, step = _split_in_two(green)
    if step < LEAST_GREEN_STEP:
        return threshold, False
    smoothness = float(np.corrcoef(flat[:, 1:].ravel(), flat[:, :-1].ravel())[0, 1])
    return threshold, smoothness >= LEAST_SMOOTHNESS


def _split_in_two(values: Grid) -> tuple[float, float]:
    """Find the threshold that splits values best, and how far the means of both sides lie apart.

    Source: Otsu 1979, "A threshold selection method from gray-level histograms".
    """
    ordered = np.sort(values.ravel())
    count = np.arange(1, len(ordered))
    sums = np.cumsum(ordered)
    apart = (sums[-1] - sums[:-1]) / (len(ordered) - count) - sums[:-1] / count
    best = int((count * (len(ordered) - count) * apart**2).argmax())
    return float(ordered[best]), float(apart[best])


def _shrink_plants(label: ByteArray, step: int) -> Grid | None:
    """Shrink the shares of plants in what is labelled; None where only one kind of it is there."""
    is_plant, is_known = label < PlantClass.SOIL, label != UNLABELLED
    if not is_plant.any() or not (label == PlantClass.SOIL).any():
        return None
    plants, known = (_shrink(which.astype(np.float64), step) for which in (is_plant, is_known))
    mean = float(plants.sum() / known.sum())
    shares = np.where(known > 0.5, plants / np.maximum(known, 0.5), mean)
    return shares if float(np.ptp(shares)) > 0.0 else None


def _shrink(values: Grid, step: int) -> Grid:
    """Take the mean of squares of `step` pixels; what is left over at the edges is dropped."""
    height, width = (size // step for size in values.shape)
    squares = values[: height * step, : width * step].reshape(height, step, width, step)
    means: Grid = squares.mean(axis=(1, 3))
    return means


def _flatten(green: Grid) -> Grid:
    """Subtract the surroundings, so that light that changes over the picture counts for nothing."""
    flat = green - _blur(green, max(green.shape) / SURROUNDINGS_RATIO)
    return flat


def _normalise(values: Grid) -> Grid:
    centred = values - values.mean()
    norm = float(np.linalg.norm(centred))
    scaled: Grid = centred / norm if norm > 0.0 else centred
    return scaled


def _blur(values: Grid, std_px: float) -> Grid:
    """Blur along both axes with a normal curve, over a border that mirrors what is inside."""
    radius = int(4.0 * std_px + 0.5)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / std_px) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        pads = [(radius, radius) if axis == along else (0, 0) for along in (0, 1)]
        padded = np.pad(values, pads, mode="symmetric")
        values = np.apply_along_axis(np.convolve, axis, padded, weights, "valid")
    return values
