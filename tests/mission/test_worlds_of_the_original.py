"""Missions in worlds laid out as those of the original, and in one that states no place on Earth.

Each drives the rows that the world itself has.
"""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from agribot.app.simulated_run import simulate
from agribot.app.world_rows import take_world_rows
from agribot.core.config import RunConfig, load
from agribot.description.package import ROOT
from agribot.record.report import Report
from tests import nightly
from tests.description.test_drive_kinds import wheel

ROWS = {"Farm": 6, "final": 4, "world1": 6, "volcano": 4}
UNSEEN = ("perception.enabled=false", "record.enabled=false", "sim.sensors='rtk'")
PLACE = re.compile(r"<spherical_coordinates>.*?</spherical_coordinates>", re.DOTALL)


def settle(world: str, *settings: str) -> RunConfig:
    return take_world_rows(load("farm", [*UNSEEN, f"world={world}", *settings]))


def drive(config: RunConfig, folder: Path) -> Report:
    with simulate(config, folder) as run:
        for _ in run.ticks():
            pass
        return run.finish()


def without_place(folder: Path) -> str:
    """The world `world1` as Gazebo kept worlds then: nothing says where on Earth it is."""
    text, count = PLACE.subn("", (ROOT / "worlds" / "world1.world").read_text())
    assert count == 1
    (folder / "nowhere.world").write_text(text)
    return str(folder / "nowhere.world")


@pytest.mark.parametrize("world", ROWS)
def test_each_world_says_which_rows_are_driven_in_it(world: str) -> None:
    assert settle(world).field.row_count == ROWS[world]


@nightly.by_day(
    "test_each_world_says_which_rows_are_driven_in_it",
    "test_a_world_without_a_place_on_earth_has_the_rows_of_the_one_with_it",
)
@pytest.mark.parametrize("world", [*ROWS, "nowhere"])
def test_all_rows_of_each_world_are_driven_and_nothing_is_crushed(
    world: str, tmp_path: Path
) -> None:
    file = without_place(tmp_path) if world == "nowhere" else world
    report = drive(settle(file), tmp_path / "run")
    assert report.ok, report.reason
    assert report.mission.rows_done == report.mission.rows_total == ROWS.get(world, 6)
    assert not report.tracking.plants_crushed


def test_a_world_without_a_place_on_earth_has_the_rows_of_the_one_with_it(tmp_path: Path) -> None:
    known, unknown = settle("world1").field, settle(without_place(tmp_path)).field
    same = ("first_row_start_map_m", "row_yaw_deg", "row_count", "start_map_m", "start_yaw_deg")
    assert [getattr(known, name) for name in same] == [getattr(unknown, name) for name in same]


@nightly.by_day(
    "tests/sim/test_six_wheels.py::test_every_wheel_carries_its_part_and_turns_with_its_side"
)
@pytest.mark.parametrize("preset", ["kind", "field"])
def test_six_wheels_drive_all_rows_of_the_farm(preset: str, tmp_path: Path) -> None:
    text = (ROOT / "urdf" / "agribot.urdf").read_text()
    middle = wheel("right_wheel_M", 0.0, -0.3908) + wheel("left_wheel_M", 0.0, 0.3908)
    middle = middle.replace("0.16", "0.09").replace(' 0"/><axis', ' -0.1908"/><axis')
    (tmp_path / "six.urdf").write_text(text.replace("</robot>", f"{middle}</robot>"))
    config = msgspec.structs.replace(
        settle("Farm", f"sim.preset={preset}", "seed=1"), robot=str(tmp_path / "six.urdf")
    )
    report = drive(config, tmp_path / "run")
    assert report.ok, report.reason
    assert report.mission.rows_done == 6 and not report.tracking.plants_crushed
