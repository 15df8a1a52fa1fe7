"""SDF's actors: people and animals that walk."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path

import pytest

from agribot.core.errors import DescriptionError
from agribot.core.world import WorldSpec
from agribot.description.sdf_export import write_world
from agribot.description.worlds_sdf import check_world, load_world
from tests import machine

TOP = """<?xml version="1.0"?>
<sdf version="1.9" xmlns:agribot="urn:agribot:sdf"><world name="yard">
<spherical_coordinates><surface_model>EARTH_WGS84</surface_model>
<world_frame_orientation>ENU</world_frame_orientation><latitude_deg>50</latitude_deg>
<longitude_deg>7</longitude_deg><elevation>0</elevation><heading_deg>0</heading_deg>
</spherical_coordinates>
<include><uri>model://ground_plane</uri></include>
"""
WORKER = """<actor name="worker"><agribot:kind>person_walking</agribot:kind>
<script><loop>LOOP</loop><delay_start>1.5</delay_start><auto_start>true</auto_start>
<trajectory id="0" type="walk">
<waypoint><time>0</time><pose>1 0 0 0 0 3.0</pose></waypoint>
<waypoint><time>2</time><pose>1 3 0 0 0 -3.0</pose></waypoint>
<waypoint><time>6</time><pose>1 -1 0 0 0 -3.0</pose></waypoint>
</trajectory></script></actor>
"""


def _write(folder: Path, actors: str) -> Path:
    file = folder / "yard.world"
    file.write_text(f"{TOP}{actors}</world></sdf>")
    return file


def _load(folder: Path, actors: str) -> WorldSpec:
    return load_world(str(_write(folder, actors)))


@pytest.mark.parametrize(
    ("t_s", "y_m"), [(0.0, 0.0), (1.5, 0.0), (2.5, 1.5), (3.5, 3.0), (5.5, 1.0), (8.5, 1.5)]
)
def test_an_actor_walks_from_waypoint_to_waypoint_and_begins_anew(
    tmp_path: Path, t_s: float, y_m: float
) -> None:
    (walker,) = _load(tmp_path, WORKER.replace("LOOP", "true")).walkers
    assert walker.find_place(t_s)[:2] == pytest.approx((1.0, y_m))


def test_an_actor_turns_the_short_way_and_stops_at_its_end_without_a_loop(tmp_path: Path) -> None:
    (walker,) = _load(tmp_path, WORKER.replace("LOOP", "false")).walkers
    assert abs(walker.find_place(2.5)[2]) == pytest.approx(math.pi)
    assert walker.find_place(100.0) == pytest.approx((1.0, -1.0, -3.0))


def test_actors_of_other_files_get_a_packaged_figure_and_say_so(tmp_path: Path) -> None:
    skin = "<skin><filename>{}</filename></skin><pose>2 1 0 0 0 1</pose>"
    actors = f"<actor name='a'>{skin.format('talk.dae')}</actor>"
    actors += f"<actor name='a'>{skin.format('brown_dog.dae')}</actor>"
    world = _load(tmp_path, actors)
    assert [(w.name, w.kind) for w in world.walkers] == [("a", "person_walking"), ("a_1", "dog")]
    assert world.walkers[0].find_place(50.0) == pytest.approx((2.0, 1.0, 1.0))
    assert sum("its skin is not read" in warning for warning in world.warnings) == 2


def test_walkers_survive_writing_and_reading_and_a_check_finds_no_fault(tmp_path: Path) -> None:
    world = _load(tmp_path, WORKER.replace("LOOP", "true"))
    out = tmp_path / "again.world"
    write_world(world, out)
    assert load_world(str(out)).walkers == world.walkers
    assert check_world(str(out)) == check_world(str(tmp_path / "yard.world")) == ()


@machine.needs("ign")
def test_gazebo_takes_the_actors_that_are_written(tmp_path: Path) -> None:
    out = tmp_path / "again.world"
    write_world(_load(tmp_path, WORKER.replace("LOOP", "true")), out)
    command = ["ign", "sdf", "-k", str(out)]
    assert "Valid" in subprocess.run(command, capture_output=True, text=True, check=False).stdout


@pytest.mark.parametrize(
    ("was", "now", "words"),
    [
        ("<time>6</time>", "<time>2</time>", "waypoint at 2 s is not after 2 s"),
        ("<time>0</time>", "<time>-1</time>", "waypoint at -1 s is not after 0 s"),
        ("person_walking", "unicorn", "no model folder has 'unicorn'"),
        ("LOOP", "perhaps", "<loop> is 'perhaps'"),
        (">1.5<", ">-2<", "<delay_start> is -2 s"),
        ("<time>6</time>", "", "<time>"),
    ],
)
def test_a_walk_that_cannot_be_is_refused_with_its_line(
    tmp_path: Path, was: str, now: str, words: str
) -> None:
    file = _write(tmp_path, WORKER.replace(was, now).replace("LOOP", "true"))
    with pytest.raises(DescriptionError, match="actor 'worker'") as refusal:
        load_world(str(file))
    assert words in str(refusal.value) and "yard.world:8" in str(refusal.value)
    assert any(words in finding.text for finding in check_world(str(file)))
