"""Wrong input ends with status 2 and one message that says what to do; nothing has moved."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.sim.platform import SimPlatform


@pytest.fixture(autouse=True)
def robot_must_not_move(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The program turns an exception into a status: what was commanded is kept and looked at."""
    commands: list[object] = []
    monkeypatch.setattr(SimPlatform, "write", lambda _, command: commands.append(command))
    yield
    assert commands == []


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Run the program, expect status 2 and return its one line of complaint."""
    try:
        status = main(arguments)
    except SystemExit as stop:  # argparse
        status = int(stop.code or 0)
    printed = capsys.readouterr()
    assert status == 2
    assert "Traceback" not in printed.err
    complaint = printed.err.strip().splitlines()[-1]
    assert complaint.startswith("agribot")
    return complaint


def test_unknown_profile_names_the_known_ones(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    complaint = refused(capsys, "run", "fram", "--out", str(tmp_path / "run"))
    assert "fram" in complaint
    assert "did you mean 'farm'" in complaint


def test_unknown_key_says_which_one_was_meant(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = str(tmp_path / "run")
    complaint = refused(capsys, "run", "farm", "--set", "mission.sped_mps=0.4", "--out", out)
    assert "mission.sped_mps" in complaint
    assert "speed_mps" in complaint


def test_value_out_of_range_says_the_limit(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = str(tmp_path / "run")
    complaint = refused(capsys, "run", "farm", "--set", "mission.speed_mps=9", "--out", out)
    assert "2.0" in complaint
    assert "mission.speed_mps" in complaint


def test_unknown_sensor_preset_names_the_known_ones(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = str(tmp_path / "run")
    complaint = refused(capsys, "run", "farm", "--sensors", "rtx", "--out", out)
    assert "rtx" in complaint
    assert "m8n" in complaint


def test_broken_xacro_names_the_file_and_the_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    broken = tmp_path / "broken.urdf.xacro"
    broken.write_text('<?xml version="1.0"?>\n<robot name="r">\n  <link name="a">\n</robot>\n')
    out = str(tmp_path / "run")
    complaint = refused(capsys, "run", "farm", "--robot", str(broken), "--out", out)
    assert "broken.urdf.xacro" in complaint
    assert "line 4" in complaint


def test_world_without_ground_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    world = tmp_path / "void.world"
    world.write_text(
        '<?xml version="1.0"?>\n<sdf version="1.9"><world name="void"></world></sdf>\n'
    )
    out = str(tmp_path / "run")
    complaint = refused(capsys, "run", "farm", "--world", str(world), "--out", out)
    assert "void" in complaint
    assert "ground" in complaint


def test_unknown_world_names_the_known_ones(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    complaint = refused(capsys, "run", "farm", "--world", "Fram", "--out", str(tmp_path / "run"))
    assert "Fram" in complaint
    assert "Farm" in complaint


def test_missing_weights_say_how_to_get_them(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = str(tmp_path / "run")
    missing = str(tmp_path / "nowhere.onnx")
    complaint = refused(capsys, "run", "farm", "--set", f"perception.model={missing}", "--out", out)
    assert "nowhere.onnx" in complaint
    assert "agribot train" in complaint


def test_unwritable_output_folder_is_refused_before_the_start(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    occupied = tmp_path / "file"
    occupied.write_text("here already")
    complaint = refused(capsys, "run", "farm", "--out", str(occupied / "run"))
    assert str(occupied) in complaint
    assert "--out" in complaint


def test_waypoint_ten_kilometres_away_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    far = tmp_path / "far.csv"
    far.write_text("lat,lon\n21.161289,72.787022\n21.251289,72.787022\n")
    out = str(tmp_path / "run")
    complaint = refused(capsys, "run", "farm", "--waypoints", str(far), "--out", out)
    assert "1000" in complaint
    assert "far.csv" in complaint or "waypoint 2" in complaint


@pytest.mark.parametrize("speed", ["0", "-1", "nan", "fast"])
def test_a_simulation_speed_that_is_none_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, speed: str
) -> None:
    complaint = refused(capsys, "run", "farm", f"--speed={speed}", "--out", str(tmp_path / "run"))
    assert speed in complaint
    assert "max" in complaint
