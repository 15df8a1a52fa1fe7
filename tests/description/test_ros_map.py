"""Maps as ROS keeps them: the farm's, and that what is written reads back the same."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.cli.main import main
from agribot.core.errors import DescriptionError
from agribot.description.package import ROOT
from agribot.description.ros_map import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    RosMap,
    load_ros_map,
    make_world_map,
    save_ros_map,
)
from agribot.description.worlds_sdf import load_world

FARM = ROOT / "maps" / "farm.yaml"


def test_the_farm_map_is_20_m_wide_about_the_datum_of_the_farm() -> None:
    farm = load_ros_map(FARM)
    assert farm.cells.shape == (200, 200) and farm.resolution_m == 0.1
    assert (farm.x_min_m, farm.y_min_m) == (-10.0, -10.0)
    assert (farm.occupied_ratio, farm.free_ratio) == (0.65, 0.196)
    assert farm.datum == load_world("Farm").datum


def test_the_farm_map_shows_what_stands_on_the_farm() -> None:
    farm, world = load_ros_map(FARM), load_world("Farm")
    assert np.array_equal(farm.cells, make_world_map(world).cells), (
        f"`agribot world map Farm -o {FARM}` writes it again"
    )
    assert farm.read_cell(0.0, 0.0) == OCCUPIED  # the base station
    person = next(o for o in world.obstacles if o.kind == "person_standing")
    assert farm.read_cell(person.x_map_m, person.y_map_m) == OCCUPIED
    rows = [farm.read_cell(float(x), float(y)) for x in range(1, 7) for y in range(2, 10)]
    assert set(rows) == {FREE} and farm.read_cell(50.0, 0.0) == UNKNOWN
    assert 0.0 < (farm.cells == OCCUPIED).mean() < 0.2


def test_what_is_written_reads_back_the_same(tmp_path: Path) -> None:
    cells = np.random.default_rng(1).choice(
        np.array([OCCUPIED, FREE, UNKNOWN], np.int8), size=(30, 20)
    )
    first = RosMap(cells=cells, resolution_m=0.05, x_min_m=-3.25, y_min_m=7.5)
    save_ros_map(first, tmp_path / "field.yaml")
    again = load_ros_map(tmp_path / "field.yaml")
    assert np.array_equal(again.cells, cells) and again.datum is None
    assert (again.resolution_m, again.x_min_m, again.y_min_m) == (0.05, -3.25, 7.5)


@pytest.mark.parametrize("negate", [0, 1])
def test_the_top_of_the_picture_is_north_and_dark_is_occupied(tmp_path: Path, negate: int) -> None:
    shades = np.full((4, 3), 0 if negate else 255, np.uint8)
    shades[0, 2] = 255 if negate else 0
    Image.fromarray(shades).save(tmp_path / "m.png")
    (tmp_path / "m.yaml").write_text(
        f"image: m.png  # beside it\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: {negate}\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    read = load_ros_map(tmp_path / "m.yaml")
    assert read.read_cell(1.2, 1.8) == OCCUPIED and (read.cells == OCCUPIED).sum() == 1
    assert read.read_cell(0.1, 0.1) == FREE


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("resolution: 0.1", "resolution: 0", "resolution 0"),
        ("resolution: 0.1\n", "", "'resolution' is missing"),
        ("image: farm.png", "image: none.png", "none.png"),
        ("[-10.0, -10.0, 0.0]", "[-10.0, -10.0]", "East, North and yaw"),
        ("free_thresh: 0.196", "free_thresh: some", "free_thresh"),
    ],
)
def test_a_wrong_map_is_named_with_its_fault(
    tmp_path: Path, before: str, after: str, words: str
) -> None:
    text = FARM.read_text()
    assert before in text
    (tmp_path / "farm.yaml").write_text(text.replace(before, after))
    (tmp_path / "farm.png").write_bytes(FARM.with_suffix(".png").read_bytes())
    with pytest.raises(DescriptionError) as raised:
        load_ros_map(tmp_path / "farm.yaml")
    assert "farm.yaml" in str(raised.value) and words in str(raised.value)


def test_the_command_writes_the_map_of_a_world_and_says_what_it_holds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "farm.yaml"
    assert main(["world", "map", "Farm", "-o", str(out), "--json"]) == 0
    written = json.loads(capsys.readouterr().out)
    assert np.array_equal(load_ros_map(out).cells, load_ros_map(FARM).cells)
    assert main(["world", "check", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == written
    assert written["occupied"] > 0 and written["occupied"] + written["free"] == 200 * 200


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "farm.txt"], "end it with .yaml"),
        (["-o", "farm.yaml", "--resolution", "0.001"], "20000 cells along a side"),
        (["-o", "farm.yaml", "--size", "0.01"], "0 cells along a side"),
        (["-o", "nowhere/farm.yaml"], "cannot write"),
    ],
)
def test_a_map_that_cannot_be_written_is_refused_with_what_to_do(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["world", "map", "Farm", *arguments]) == 2
    assert words in capsys.readouterr().err and not list(tmp_path.iterdir())
