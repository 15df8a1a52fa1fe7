"""Fixtures: the pole with a receiver is described as one, and no command drives it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.core.errors import DescriptionError
from agribot.description.loader import check_robot, export_urdf, load_fixture, load_robot
from agribot.description.package import list_fixture_files

GATE = "entry_gate"
POST = '<robot name="post"><link name="post"/></robot>'


def test_the_gate_of_the_farm_is_described_with_its_receiver(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["describe", "--robot", GATE]) == 0
    told = capsys.readouterr().out
    assert "it has no wheels" in told
    assert "/Pole/fix, /Pole/fix_velocity" in told
    assert "sim.base_station" in told
    assert main(["describe", "--robot", GATE, "--check"]) == 0
    assert "0 faults" in capsys.readouterr().out
    assert main(["describe", "--robot", GATE, "--json"]) == 0
    (receiver,) = json.loads(capsys.readouterr().out)["receivers"]
    assert receiver == {
        "link": "gps_pole_link", "rate_hz": 5.0, "height_m": 0.275,
        "topics": ["/Pole/fix", "/Pole/fix_velocity"],
    }  # fmt: skip


def test_its_tree_and_its_urdf_can_be_had_and_other_forms_are_refused_in_words(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["describe", "--robot", GATE, "--tree"]) == 0
    assert "gps_pole_link (fixed" in capsys.readouterr().out
    assert export_urdf(GATE).count("<link ") == 2
    for form in ("--sdf", "--ui"):
        assert main(["describe", "--robot", GATE, form]) == 2
        assert "is for robots, and this has no wheels" in capsys.readouterr().err


def test_a_mission_with_it_is_refused_and_says_what_it_is_good_for(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    words = ["run", "farm", "--robot", GATE, "--headless", "--out", str(tmp_path / "run")]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert "it stands, and cannot be driven" in said
    assert "sim.base_station" in said


def test_a_broken_receiver_is_a_fault_with_its_file(tmp_path: Path) -> None:
    file = tmp_path / "gate.urdf"
    gate = list_fixture_files()[GATE].read_text()
    file.write_text(gate.replace("<bodyName>gps_pole_link", "<bodyName>nowhere"))
    (fault,) = check_robot(str(file))
    assert fault.is_fault
    assert "there is no link 'nowhere'" in str(fault)


@pytest.mark.parametrize(
    "urdf",
    [
        POST.replace("<link", '<link name="left_wheel"/><link', 1),
        POST.replace(
            "</robot>",
            '<gazebo><plugin filename="libgazebo_ros_skid_steer_drive.so"/></gazebo></robot>',
        ),
    ],
    ids=["a link called wheel", "a drive plugin"],
)
def test_a_robot_that_lacks_its_wheels_is_a_faulty_robot_and_no_pole(
    urdf: str, tmp_path: Path
) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text(urdf)
    assert load_fixture(str(file)) is None
    with pytest.raises(DescriptionError):
        load_robot(str(file))


def test_a_robot_is_no_fixture_and_a_post_is_one(tmp_path: Path) -> None:
    assert load_fixture("agribot") is None
    file = tmp_path / "post.urdf"
    file.write_text(POST)
    post = load_fixture(str(file))
    assert post is not None
    assert (post.receivers, post.mass_kg) == ((), 0.0)
