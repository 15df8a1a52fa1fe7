"""Plants of other people's worlds, known by the words in the names of their models and meshes."""

from __future__ import annotations

import re
from typing import NamedTuple

from agribot.core.messages import PlantClass

_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+")
MOST_SIDE_M = 1.5  # width of one plant; a wider mesh is a row or a field of them
HEIGHT_LIMITS_M = (0.02, 3.0)


class PlantName(NamedTuple):
    """Meaning of a word: the class, the species that is drawn, its height without a mesh, m."""

    word: str
    plant: PlantClass
    species: str
    height_m: float


class NamedPlant(NamedTuple):
    """A plant that the name of a mesh or a model speaks of, at `xy_m` of its model."""

    name: PlantName
    xy_m: tuple[float, float]
    height_m: float


def _name(plant: PlantClass, species: str, height_m: float, words: str) -> dict[str, PlantName]:
    return {word: PlantName(word, plant, species, height_m) for word in words.split()}


NAMES: dict[str, PlantName] = {
    **_name(PlantClass.CROP, "maize", 0.5, "maize corn sorghum sunflower"),
    **_name(PlantClass.CROP, "sugar_beet", 0.25, "beet sugarbeet beetroot crop cotton soy soybean "
            "bean tomato pepper potato tobacco strawberry"),
    **_name(PlantClass.CROP, "lettuce", 0.2, "lettuce salad cabbage cauliflower broccoli spinach"),
    **_name(PlantClass.CROP, "carrot", 0.2, "carrot parsnip"),
    **_name(PlantClass.CROP, "onion", 0.25, "onion leek garlic"),
    **_name(PlantClass.CROP, "parsley", 0.2, "parsley celery"),
    **_name(PlantClass.WEED, "goosefoot", 0.12, "weed goosefoot nettle"),
    **_name(PlantClass.WEED, "thistle", 0.15, "thistle dandelion"),
    **_name(PlantClass.WEED, "amaranth", 0.15, "amaranth pigweed"),
}  # fmt: skip


def find_plant_name(text: str) -> PlantName | None:
    """Find the plant that a name or a URI speaks of, in one or more of it; None without any."""
    words = [word.lower() for word in _WORDS.findall(text)]
    forms = [
        form for word in words for form in (word, word.removesuffix("s"), word.removesuffix("es"))
    ]
    return next((NAMES[form] for form in forms if form in NAMES), None)
