"""Plants that are not seen whole and alone say nothing of the camera's mount."""

from __future__ import annotations

from agribot.app.calibration.camera import drop_unsteady
from agribot.autonomy.perceive.mount_fit import Look
from agribot.core.messages import GroundPlant, PlantClass

STEP_M = 0.1


def plant(x_m: float, area_m2: float) -> GroundPlant:
    return GroundPlant(
        x_body_m=x_m, y_body_m=0.2, plant=PlantClass.WEED, area_m2=area_m2, confidence=1.0,
        std_m=0.01,
    )  # fmt: skip


def test_sights_in_which_a_plant_is_larger_or_cut_are_left_out() -> None:
    """Ahead of a robot that drives 10 cm from look to look: cut, whole, whole, ..., merged."""
    areas_m2 = [0.002, *[0.005, 0.0052, 0.0049, 0.005, 0.0051, 0.0048], 0.011]
    looks = [
        Look(0.1 * i, (STEP_M * i, 0.0, 0.0), (plant(1.6 - STEP_M * i, area_m2),))
        for i, area_m2 in enumerate(areas_m2)
    ]
    kept = [bool(look.plants) for look in drop_unsteady(looks)]
    assert kept == [False, True, True, True, True, True, True, False]


def test_a_plant_that_was_not_followed_is_left_out() -> None:
    looks = [Look(0.1 * i, (STEP_M * i, 0.0, 0.0), (plant(1.0, 0.005),)) for i in range(8)]
    assert not any(look.plants for look in drop_unsteady(looks))
