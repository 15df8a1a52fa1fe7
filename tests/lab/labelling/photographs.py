"""Photographs to be labelled, and a network that is less sure of some than of others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.labelling.guesses import Guess
from agribot.lab.labelling.label_folder import LabelFolder

WIDTH, HEIGHT = 120, 90
SOIL_RGB, PLANT_RGB = (130, 100, 80), (60, 150, 50)
NAMES = ("clear", "dim", "murky")  # in falling order of the network's confidence


def make_photographs(root: Path) -> Path:
    """A beet and a thistle on soil in each; the darker one, the less the network is sure."""
    (root / "images").mkdir(parents=True)
    for number, name in enumerate(NAMES):
        image = np.full((HEIGHT, WIDTH, 3), SOIL_RGB, np.uint8)
        image[20:50, 15:45] = image[50:80, 75:105] = PLANT_RGB
        image[0, 0] = (number, 0, 0)
        Image.fromarray(image).save(root / "images" / f"{name}.png")
    return root


def guess(image_rgb: ByteArray) -> Guess:
    """Call all that is green a weed, and be the less sure the higher the picture's number is."""
    is_green = image_rgb[..., 1] > image_rgb[..., 0]
    class_id = np.where(is_green, PlantClass.WEED, PlantClass.SOIL).astype(np.uint8)
    plant = np.zeros(class_id.shape, np.uint16)
    plant[20:50, 15:45] = 1  # the thistle has no stem that was found
    return Guess(class_id=class_id, plant=plant, doubt=0.02 + 0.16 * int(image_rgb[0, 0, 0]))


def open_folder(root: Path) -> LabelFolder:
    return LabelFolder(root, guess, "guesser")
