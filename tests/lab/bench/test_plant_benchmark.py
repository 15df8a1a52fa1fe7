"""The benchmark of single plants: its fields, its truth and its result."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.ground import ground_to_pixels
from agribot.cli.main import main
from agribot.core.messages import PlantClass
from agribot.description.loader import load_robot
from agribot.lab.bench import plants
from agribot.lab.bench.plant_scenes import SCENES, draw_field, make_stream
from tests import nightly
from tests.autonomy.perceive.drawn_field import GROUND
from tests.autonomy.perceive.drawn_plants import draw_plants

CONTRACT = {
    "crop_recall", "crop_precision", "stem_error_p95_m", "weed_recall", "weed_precision",
    "crops_hit", "pq", "by",
}  # fmt: skip
MAX_RANGE_M = 1.6


def _draw(name: str, preset: str) -> plants.PictureOfPlants:
    scene = SCENES[name]
    (picture,) = plants.draw_pictures(
        scene, load_robot(), MAX_RANGE_M, preset, 1, make_stream(scene, 3)
    )
    return picture


@pytest.mark.parametrize("name", ["beet-7-9", "maize", "weeds-40"])
def test_a_scene_is_what_its_name_says(name: str) -> None:
    scene = SCENES[name]
    world, _ = draw_field(scene, "field", make_stream(scene, 1))
    crops = [plant for plant in world.plants if plant.plant == PlantClass.CROP]
    assert {plant.species for plant in crops} == {scene.species}
    assert np.mean([plant.size_m for plant in crops]) == pytest.approx(scene.height_m, rel=0.1)
    gaps_m = np.diff(sorted(p.x_map_m for p in crops if abs(p.y_map_m - crops[0].y_map_m) < 0.2))
    assert np.median(gaps_m) == pytest.approx(scene.spacing_m, abs=0.02)
    weeds = [p for p in world.plants if p.plant == PlantClass.WEED and 0.0 < p.x_map_m < 7.0]
    assert len(weeds) > 2 * scene.weeds_per_m2


@nightly.one_by_one("preset", ("kind", "field"), in_suite=1)
def test_the_true_stems_lie_among_the_pixels_of_their_plants(preset: str) -> None:
    truth, robot = _draw("beet-4-9", preset).truth, load_robot()
    assert robot.camera is not None
    stems_px = ground_to_pixels(
        truth.plants.places_m, robot.camera.matrix(), robot.body_from_camera()
    )
    for index, (u_px, v_px) in enumerate(stems_px):
        rows, columns = np.nonzero(truth.segments.number == index + 1)
        assert len(rows) >= plants.LEAST_PX
        away_px = np.hypot(columns - u_px, rows - v_px).min()
        assert away_px < 15.0  # the ground is uneven, and pixels are of leaves
    crops = truth.plants.kind == PlantClass.CROP
    assert crops.sum() > 20


def test_plants_out_of_range_need_not_be_found_and_their_pixels_are_not_judged() -> None:
    drawn, truth = _draw("weeds-40", "kind")
    camera_m = load_robot().body_from_camera()[:2, 3]
    assert np.hypot(*(truth.plants.places_m - camera_m).T).max() <= MAX_RANGE_M
    assert np.hypot(*(truth.others.places_m - camera_m).T).max() > MAX_RANGE_M
    judged = drawn.instance[~truth.unjudged]
    assert len(np.unique(judged[judged >= 0])) <= len(truth.plants.kind)


@nightly.one_by_one("preset", ("kind", "field"), in_suite=1)
def test_a_scene_is_the_same_without_the_others(preset: str) -> None:
    one = _draw("beet-4-9", preset).drawn.image_rgb
    assert np.array_equal(one, _draw("beet-4-9", preset).drawn.image_rgb)


def test_leaves_that_touch_are_one_piece_and_two_plants_of_their_stems() -> None:
    pair = (0.80, 0.0, 0.06, PlantClass.CROP), (0.90, 0.0, 0.06, PlantClass.CROP)
    weed = (0.80, 0.25, 0.03, PlantClass.WEED)
    seen = draw_plants(*pair, weed)
    of_stems = plants.find_segments(seen, GROUND)
    assert sorted(of_stems.kind.tolist()) == [PlantClass.WEED, PlantClass.CROP, PlantClass.CROP]
    assert {*np.unique(of_stems.number).tolist()} == {0, 1, 2, 3}
    of_pieces = plants.find_segments(msgspec.structs.replace(seen, plants=None), GROUND)
    assert of_pieces.kind.tolist() == [PlantClass.WEED, PlantClass.CROP]
    assert np.array_equal(of_pieces.number > 0, seen.class_id != PlantClass.SOIL)


def test_the_command_prints_and_writes_the_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = f"bench plants --scenes beet-7-9 --frames 1 --preset kind --json --out {tmp_path}"
    assert main(words.split()) == 0
    said = capsys.readouterr()
    result = json.loads(said.out.splitlines()[-1])
    assert set(result) >= CONTRACT
    (row,) = result["by"]
    assert (row["height_m"], row["spacing_m"], row["weeds_per_m2"]) == (0.07, 0.09, 5.0)
    assert set(row) >= CONTRACT - {"by"}
    assert row["crop_recall"] == result["crop_recall"]
    assert "beet-7-9" in said.err
    assert json.loads((tmp_path / "plants.json").read_text()) == result
    assert "| beet-7-9 |" in (tmp_path / "plants.md").read_text()
    assert main([*words.split(), "--range", "0.8"]) == 0
    near = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert near["max_range_m"] == 0.8
    assert 0 < near["crops_truth"] < result["crops_truth"]
