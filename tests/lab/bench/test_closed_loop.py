from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")

from agribot.core.messages import PlantClass
from agribot.description.conditions import load_condition_preset
from agribot.lab.bench import closed_loop
from agribot.lab.bench.closed_loop import (
    LEAST_IOU,
    Condition,
    conditions,
    format_table,
    meets_limits,
)

DRIVEN_S = 1.0


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    wanted = conditions(["beet"], ["low sun"], [1.0], [1])
    return closed_loop.run_conditions(wanted, DRIVEN_S)


def test_every_pixel_of_every_frame_of_a_drive_is_judged(result: dict[str, Any]) -> None:
    (drive,) = result["drives"]
    assert 0.5 * 10.0 * DRIVEN_S <= drive["frames"] <= 10.0 * (DRIVEN_S + 2.5)
    pixels = sum(map(sum, drive["scores"]["confusion"]))
    judged, rest = divmod(pixels, 480 * 640)
    assert rest == 0
    assert 0 < judged <= drive["frames"]
    assert result["fields"]["beet"]["confusion"] == drive["scores"]["confusion"]
    assert result["by"]["light"]["low sun"]["iou"] == drive["scores"]["iou"]
    assert "field beet" in format_table(result)


def test_the_beet_field_fails_below_its_limits_and_other_fields_do_not(
    result: dict[str, Any],
) -> None:
    good = copy.deepcopy(result)
    good["fields"]["beet"]["iou"].update(LEAST_IOU)
    assert meets_limits(good)
    good["fields"]["beet"]["iou"]["weed"] -= 0.001
    assert not meets_limits(good)
    good["fields"]["beet"]["iou"]["weed"] = None
    assert not meets_limits(good)
    assert meets_limits({"fields": {"farm": {"iou": {"weed": 0.0, "crop": 0.0}}}})


def test_growth_stages_are_of_crops_and_not_of_the_farm() -> None:
    found = conditions(["maize", "farm"], ["noon", "overcast"], [0.5, 1.4], [1, 2])
    assert len(found) == 2 * 2 * 2 + 2 * 2
    assert {c.height_ratio for c in found if c.field == "farm"} == {None}


def test_a_condition_changes_the_crop_its_height_and_the_light() -> None:
    def crops(ratio: float) -> list[float]:
        world = closed_loop._make_world(
            Condition(field="lettuce", light="overcast", height_ratio=ratio, seed=3)
        )
        assert world.light == closed_loop.LIGHTS["overcast"]
        found = [p for p in world.plants if p.plant == PlantClass.CROP]
        assert {plant.species for plant in found} == {"lettuce"}
        return [plant.size_m for plant in found]

    small, large = crops(0.5), crops(1.0)
    assert small == pytest.approx([size_m / 2.0 for size_m in large], abs=1e-5)


def test_the_preset_around_a_condition_leaves_its_light_and_growth_alone(tmp_path: Path) -> None:
    around = tmp_path / "around.toml"
    around.write_text(closed_loop._write_preset("field"), encoding="utf-8")
    drawn, field = load_condition_preset(str(around)), load_condition_preset("field")
    assert drawn.sun_elevation_deg is None
    assert drawn.growth_ratio == (1.0, 1.0)
    assert drawn.soil_classes == field.soil_classes
    assert drawn.camera_angle_std_deg == field.camera_angle_std_deg > 0.0
