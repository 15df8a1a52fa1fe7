"""Targets of whole pictures, for the tests of what is made of them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch

from agribot.core.messages import ByteArray
from agribot.lab.train.picture_stack import PictureStack
from agribot.lab.train.plant_targets import join_heat, make_targets
from agribot.lab.train.plant_truth import DrawnView, PlantTruth


def stack_up(label: ByteArray, plants: PlantTruth) -> PictureStack:
    return PictureStack([DrawnView(np.zeros((*label.shape, 3), dtype=np.uint8), label, plants)], 1)


def tell_targets(label: ByteArray, plants: PlantTruth) -> npt.NDArray[np.float32]:
    """Make the target of a whole picture, (MAPS, rows, columns)."""
    stack = stack_up(label, plants)
    kinds, number = stack.kinds.to(torch.int64), stack.numbers.to(torch.int64)
    targets = make_targets(stack.labels.to(torch.int64), number, stack.stems_px, kinds)
    made: npt.NDArray[np.float32] = targets[0].numpy()
    return made


def join_target_heat(target: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Join the heat of a target (MAPS, rows, columns) to (2, H / SQUARE_PX, W / SQUARE_PX)."""
    heat: npt.NDArray[np.float32] = join_heat(torch.from_numpy(target)[None])[0].numpy()
    return heat
