"""One temperature for all logits, so that the confidence is the share of right answers.

Dividing logits by a number changes no class, only the confidence. Source: Guo et al.
2017 (temperature scaling, expected calibration error).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import msgspec
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from agribot.core.messages import PlantClass
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.evaluate import resize_nearest

# Class logits (1, 3, h, w) of an image (1, H, W, 3) uint8.
Logits = Callable[[Tensor], Tensor]

BINS = 15
EVERY_PX = 4  # neighbours say nearly the same


class Calibration(msgspec.Struct, frozen=True, kw_only=True):
    """`images` were set aside to find the temperature; the errors are those on test images.

    `plant_error_after` is over the pixels taken for plants alone; None where there were none, or
    in a card of before it was measured.
    """

    temperature: float
    images: int
    error_before: float
    error_after: float
    plant_error_after: float | None = None


def calibrate(
    logits: Logits, aside: Iterable[LabelledImage], tests: Iterable[LabelledImage]
) -> Calibration:
    """Find the temperature of least negative log-likelihood on images that nothing else uses.

    `logits` maps an image (1, H, W, 3) to logits (1, 3, h, w).
    """
    values, truth, images = _sample_pixels(logits, aside)
    temperature = fit_temperature(values, truth)
    judged, judged_truth, _ = _sample_pixels(logits, tests)
    return Calibration(
        temperature=round(temperature, 4),
        images=images,
        error_before=calibration_error(judged, judged_truth),
        error_after=calibration_error(judged / temperature, judged_truth),
        plant_error_after=_find_plant_error(judged / temperature, judged_truth),
    )


def fit_temperature(logits: Tensor, truth: Tensor) -> float:
    """Fit to logits (N, 3) and true classes (N,)."""
    log_temperature = torch.zeros(1, requires_grad=True)
    search = torch.optim.LBFGS([log_temperature], max_iter=50, line_search_fn="strong_wolfe")

    def unlikelihood() -> Tensor:
        search.zero_grad()
        loss = functional.cross_entropy(logits * torch.exp(-log_temperature), truth)
        loss.backward()  # type: ignore[no-untyped-call]
        return loss

    search.step(unlikelihood)  # type: ignore[no-untyped-call]
    return math.exp(float(log_temperature.detach()))


def calibration_error(logits: Tensor, truth: Tensor) -> float:
    """Average |accuracy - confidence| of their bin over the pixels, logits (N, 3), truth (N,)."""
    sure, guessed = logits.softmax(dim=1).max(dim=1)
    surplus = sure.double() - (guessed == truth).double()
    in_bin = (sure * BINS).long().clamp(max=BINS - 1)
    return float(torch.bincount(in_bin, surplus, BINS).abs().sum() / len(truth))


def _find_plant_error(logits: Tensor, truth: Tensor) -> float | None:
    is_plant = logits.argmax(dim=1) != PlantClass.SOIL
    return calibration_error(logits[is_plant], truth[is_plant]) if is_plant.any() else None


def _sample_pixels(logits: Logits, pairs: Iterable[LabelledImage]) -> tuple[Tensor, Tensor, int]:
    """Take logits (N, 3) and classes (N,) of every so many pixels, and the number of images."""
    values, truths, images = [], [], 0
    for image_rgb, label in pairs:
        with torch.inference_mode():
            found = logits(torch.from_numpy(image_rgb.copy())[None])[0]
        small = resize_nearest(label, tuple(found.shape[1:]))[::EVERY_PX, ::EVERY_PX]
        counted = torch.from_numpy(small < len(PlantClass))
        values.append(found[:, ::EVERY_PX, ::EVERY_PX].permute(1, 2, 0)[counted])
        truths.append(torch.from_numpy(small.astype(np.int64))[counted])
        images += 1
    return torch.cat(values).float(), torch.cat(truths), images
