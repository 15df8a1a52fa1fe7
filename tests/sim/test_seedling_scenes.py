"""Seedlings close from above: what stands there, and what a camera for two bands makes of it."""

from __future__ import annotations

import numpy as np

from agribot.core.messages import PlantClass
from agribot.sim.seedling_scenes import GRASSES, LOOKALIKES, sample_seedlings, to_red_infrared

SCENES = 60


def test_every_scene_is_one_crop_among_weeds_of_several_species() -> None:
    crops, weeds, kinds = [], set(), []
    for k in range(SCENES):
        plants = sample_seedlings(np.random.default_rng([4, k])).plants
        crops.append({plant.species for plant in plants if plant.plant == PlantClass.CROP})
        found = {plant.species for plant in plants if plant.plant == PlantClass.WEED}
        weeds |= found
        kinds.append(len(found))
    assert {len(crop) for crop in crops} == {1}
    assert set().union(*crops) == {"carrot", "parsley"}
    assert {*GRASSES, *LOOKALIKES, "knotweed", "quickweed", "milk_thistle"} <= weeds
    assert min(kinds) >= 1 and max(kinds) >= 4


def test_labels_stand_in_some_scenes_below_the_camera() -> None:
    scenes = [sample_seedlings(np.random.default_rng([4, k])) for k in range(SCENES)]
    assert 0.05 < np.mean([bool(scene.obstacles) for scene in scenes]) < 0.3
    for label in (label for scene in scenes for label in scene.obstacles):
        (shape,) = label.shapes
        length_m = shape.size_m[1] if shape.kind == "cylinder" else shape.size_m[2]
        assert 0.0 < label.z_map_m + length_m / 2.0 < 0.2


def test_grains_lie_on_the_soil_and_never_on_leaves() -> None:
    picture = np.full((120, 160, 3), 100, dtype=np.uint8)
    picture[:, 80:] = (40, 180, 40)  # leaves
    with_grains = 0
    for k in range(SCENES):
        bands = to_red_infrared(picture, np.random.default_rng([9, k]))
        red, infrared, again = np.moveaxis(bands, 2, 0)
        assert np.array_equal(red, again)
        assert (infrared[:, 80:] > red[:, 80:]).all()
        with_grains += bool((red[:, :80] > 160).any())
    assert 0.2 < with_grains / SCENES < 0.8
