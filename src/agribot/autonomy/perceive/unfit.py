"""Whether a picture shows plants well enough: by its light, and by what its network knows."""

from __future__ import annotations

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.picture_light import find_fault
from agribot.core.facts import AnyFact, PlantsStrange
from agribot.core.messages import ByteArray


def find_unfit(image_rgb: ByteArray, class_map: ClassMap) -> AnyFact | None:
    """Find why a picture is unfit to find plants in; None where it is fit."""
    if fault := find_fault(image_rgb):
        return fault
    doubt, most = class_map.doubt, class_map.most_doubt
    if doubt is None or most is None or doubt <= most:
        return None
    return PlantsStrange(doubt, most)
