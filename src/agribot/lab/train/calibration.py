"""Temperatures for the logits, so that the confidence is the share of right answers.

Dividing logits by a number changes no class, only the confidence. Source: Guo et al.
2017 (temperature scaling, expected calibration error). Most pixels are soil that a network is
right about, so that each class has a temperature of its own: that of the pixels called so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.pictures import resize_nearest
from agribot.lab.train.data import LabelledImage

# Class logits (1, 3, h, w) of an image (1, H, W, 3) uint8.
Logits = Callable[[Tensor], Tensor]

BINS = 15
EVERY_PX = 4  # neighbours say nearly the same
LEAST_PIXELS = 100  # least pixels for a temperature
MAX_TEMPERATURE = 8.0  # limit, and 1 over it: for a few pixels that are all right, or all wrong


class Temperatures(msgspec.Struct, frozen=True, kw_only=True):
    """Divisors of the logits of pixels called weed, crop and soil."""

    weed: float = 1.0
    crop: float = 1.0
    soil: float = 1.0

    def divide(self, logits: Tensor) -> Tensor:
        """Divide logits (N, 3)."""
        by_class = torch.tensor([self.weed, self.crop, self.soil])  # in the order of PlantClass
        return logits / by_class[logits.argmax(dim=1)][:, None]


AS_TRAINED = Temperatures()


class Calibration(msgspec.Struct, frozen=True, kw_only=True):
    """`images` were set aside to find the temperatures; the errors are those on test images.

    Where no others were kept for that, `is_by_turns`: each image is judged with the temperatures of
    the others; the error after is None for a single image. Errors of plants are over the pixels
    taken for plants alone; None without such pixels, or in a card older than these errors.
    """

    temperatures: Temperatures
    images: int
    error_before: float
    error_after: float | None
    plant_error_before: float | None = None
    plant_error_after: float | None = None
    is_by_turns: bool = False


class _Pixels(NamedTuple):
    """Logits (N, 3) and true classes (N,)."""

    logits: Tensor
    truth: Tensor


def calibrate(
    logits: Logits, aside: Iterable[LabelledImage], tests: Iterable[LabelledImage] = ()
) -> Calibration | None:
    """Find the temperatures of least negative log-likelihood on images that taught nothing.

    `logits` maps an image (1, H, W, 3) to logits (1, 3, h, w). Without `tests` the images set
    aside judge by turns. None: no image could be read.
    """
    found_on = [_sample_pixels(logits, *pair) for pair in aside]
    others = [_sample_pixels(logits, *pair) for pair in tests]
    if not found_on:
        return None
    found = fit_temperatures(_join(found_on))
    judged = _join(others or found_on)
    after = found.divide(judged.logits) if others else _divide_by_turns(found_on)
    is_plant = judged.logits.argmax(dim=1) != PlantClass.SOIL
    return Calibration(
        temperatures=found,
        images=len(found_on),
        error_before=calibration_error(*judged),
        error_after=None if after is None else calibration_error(after, judged.truth),
        plant_error_before=_find_error(judged.logits, judged.truth, is_plant),
        plant_error_after=None if after is None else _find_error(after, judged.truth, is_plant),
        is_by_turns=not others,
    )


def fit_temperatures(pixels: tuple[Tensor, Tensor]) -> Temperatures:
    """Fit to logits (N, 3) and true classes (N,): for each class one to those called so."""
    logits, truth = pixels
    called = logits.argmax(dim=1)
    weed, crop, soil = (
        round(fit_temperature(logits[called == k], truth[called == k]), 4) for k in PlantClass
    )
    return Temperatures(weed=weed, crop=crop, soil=soil)


def fit_temperature(logits: Tensor, truth: Tensor) -> float:
    """Fit to logits (N, 3) and true classes (N,); 1 where there are too few."""
    if len(truth) < LEAST_PIXELS:
        return 1.0
    log_temperature = torch.zeros(1, requires_grad=True)
    search = torch.optim.LBFGS([log_temperature], max_iter=50, line_search_fn="strong_wolfe")
    most = math.log(MAX_TEMPERATURE)

    def unlikelihood() -> Tensor:
        search.zero_grad()
        colder = torch.exp(-log_temperature.clamp(-most, most))
        loss = functional.cross_entropy(logits * colder, truth)
        loss.backward()  # type: ignore[no-untyped-call]
        return loss

    search.step(unlikelihood)  # type: ignore[no-untyped-call]
    return math.exp(float(log_temperature.detach().clamp(-most, most)))


def calibration_error(logits: Tensor, truth: Tensor) -> float:
    """Average |accuracy - confidence| of their bin over the pixels, logits (N, 3), truth (N,)."""
    sure, guessed = logits.softmax(dim=1).max(dim=1)
    surplus = sure.double() - (guessed == truth).double()
    in_bin = (sure * BINS).long().clamp(max=BINS - 1)
    return float(torch.bincount(in_bin, surplus, BINS).abs().sum() / len(truth))


def _divide_by_turns(images: Sequence[_Pixels]) -> Tensor | None:
    """Divide the logits of each image by the temperatures of all others; None for one image."""
    if len(images) < 2:
        return None
    return torch.cat(
        [
            fit_temperatures(_join([*images[:k], *images[k + 1 :]])).divide(one.logits)
            for k, one in enumerate(images)
        ]
    )


def _find_error(logits: Tensor, truth: Tensor, which: Tensor) -> float | None:
    return calibration_error(logits[which], truth[which]) if which.any() else None


def _join(images: Sequence[_Pixels]) -> _Pixels:
    return _Pixels(*map(torch.cat, zip(*images, strict=True)))


def _sample_pixels(logits: Logits, image_rgb: ByteArray, label: ByteArray) -> _Pixels:
    """Take logits and classes of each EVERY_PX-th pixel of an image."""
    with torch.inference_mode():
        found = logits(torch.from_numpy(image_rgb.copy())[None])[0]
    small = resize_nearest(label, tuple(found.shape[1:]))[::EVERY_PX, ::EVERY_PX]
    counted = torch.from_numpy(small < len(PlantClass))
    values = found[:, ::EVERY_PX, ::EVERY_PX].permute(1, 2, 0)[counted]
    return _Pixels(values.float(), torch.from_numpy(small.astype(np.int64))[counted])
