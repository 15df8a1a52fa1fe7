"""`agribot sim`: the world alone, driven by a twist, a script or live lines."""

from __future__ import annotations

import io
import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from agribot.cli.main import main
from agribot.cli.run.drive_source import LiveTwists, parse_constant, read_script
from agribot.core import topics
from agribot.core.errors import ConfigError
from agribot.core.messages import DriveCommand, SensorBatch
from agribot.record.replay import read_truth
from agribot.sim.platform import SimPlatform
from tests.waiting import PATIENCE_S


def simulate(
    capsys: pytest.CaptureFixture[str], out: Path, *options: str, status: int = 0
) -> dict[str, Any]:
    words = ("sim", "--world", "empty", "--speed", "max", "--json", "--out", str(out), *options)
    assert main(words) == status
    report: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return report


def commands_in(recording: Path) -> int:
    with recording.open("rb") as file:
        return sum(1 for _ in make_reader(file).iter_messages(topics=[topics.CMD_VEL.name]))


def test_a_constant_twist_drives_the_circle_it_says(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    report = simulate(capsys, tmp_path, "--drive=0.4,0.4", "--for", "10", "--sensors", "ideal")
    assert report["ok"]
    truth = read_truth(tmp_path / "run.mcap")
    assert len(truth) == 500
    turned = math.remainder(truth[-1, 3] - truth[249, 3], math.tau)
    assert turned == pytest.approx(0.4 * (truth[-1, 0] - truth[249, 0]), rel=0.03)
    assert report["distance_m"] == pytest.approx(0.4 * 10.0, rel=0.05)


def test_the_recording_holds_sensors_commands_and_truth(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    common = ("sim.base_station=common",)
    simulate(capsys, tmp_path, "--drive=0.2,0", "--for", "2", "--set", *common)
    with (tmp_path / "run.mcap").open("rb") as file:
        seen = Counter(channel.topic for _, channel, _ in make_reader(file).iter_messages())
    assert seen[topics.IMU.name] == 400
    assert seen[topics.JOINT_STATES.name] == seen[topics.GROUND_TRUTH.name] == 100
    assert seen[topics.CMD_VEL.name] == 100
    assert seen[topics.POLE_FIX.name] >= 9
    assert seen[topics.BATTERY.name] == 2
    for latched in (topics.ROBOT_DESCRIPTION, topics.TF_STATIC):
        assert seen[latched.name] == 1
    assert seen[topics.ODOM.name] == 100
    assert topics.ODOMETRY.name not in seen  # there is no estimator


def test_a_script_line_is_said_once_and_the_board_stops_after_its_timeout(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    lines = tmp_path / "drive.txt"
    lines.write_text("# t v yaw_rate\n0.1, 0.4, 0\n")
    once = simulate(capsys, tmp_path / "once", "--script", str(lines), "--for", "4")
    held = simulate(capsys, tmp_path / "held", "--script", str(lines), "--for", "4", "--hold")
    assert commands_in(tmp_path / "once" / "run.mcap") == 1
    assert once["distance_m"] < 0.4 * 0.8  # half a second and the way to rest
    assert abs(once["truth"]["v_mps"]) < 0.01
    assert held["distance_m"] == pytest.approx(0.4 * 3.9, rel=0.06)
    assert held["truth"]["v_mps"] == pytest.approx(0.4, rel=0.03)


def test_the_same_seed_gives_the_same_recording(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    options = ("--drive=0.3,0.2", "--for", "2", "--sensors", "m8n", "--seed", "5")
    for name in ("a", "b"):
        simulate(capsys, tmp_path / name, *options)
    assert (tmp_path / "a" / "run.mcap").read_bytes() == (tmp_path / "b" / "run.mcap").read_bytes()


def test_crops_under_the_wheels_are_counted(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    lines = tmp_path / "drive.txt"
    # From the farm's start mark turn right by 90 degrees, then across the rows.
    lines.write_text("0 0.4 0\n13.9 0 -0.5\n17.04 0.4 0\n")
    report = simulate(
        capsys, tmp_path, "--world", "Farm", "--script", str(lines), "--hold", "--for", "45"
    )
    assert report["plants_total"] > 36
    assert report["plants_crushed"] > 0


def test_a_robot_that_overturns_ends_the_run_with_status_one_and_a_reason(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = SimPlatform.read

    def turn_over_at_one_second(platform: SimPlatform) -> SensorBatch:
        batch = read(platform)
        if batch.t_s > 1.0:
            monkeypatch.setattr("agribot.sim.physics.OVERTURNED_COS", 1.1)  # level is too steep
        return batch

    monkeypatch.setattr(SimPlatform, "read", turn_over_at_one_second)
    report = simulate(capsys, tmp_path, "--drive=0.2,0", "--for", "3", status=1)
    assert not report["ok"]
    assert "overturned at t = 1.0" in report["reason"]
    assert len(read_truth(tmp_path / "run.mcap")) == 51  # what went before is readable


def test_live_lines_keep_the_newest_and_report_a_typing_error() -> None:
    complaints = io.StringIO()
    live = LiveTwists(io.StringIO("0.1 0\n\nfast\n0.4 -0.2\n"), complaints)
    live._thread.join(PATIENCE_S)
    assert live.at(0.02) == DriveCommand(v_mps=0.4, yaw_rate_radps=-0.2)
    assert live.at(0.04) is None
    assert "passed over 'fast'" in complaints.getvalue()
    holding = LiveTwists(io.StringIO("0.1 0\n"), complaints, hold=True)
    holding._thread.join(PATIENCE_S)
    assert holding.at(0.02) == holding.at(9.0) == DriveCommand(v_mps=0.1)


@pytest.mark.parametrize("text", ["0.4", "fast,0", "nan,0", "1,2,3", "inf,0"])
def test_a_twist_that_is_none_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ConfigError, match=r"--drive=0\.4,0\.1"):
        parse_constant(text)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("0 0.4 0\n1 fast 0\n", ":2: '1 fast 0'"),
        ("0 0.4\n", ":1: '0 0.4'"),
        ("0 nan 0\n", ":1: '0 nan 0'"),
        ("2 0.1 0\n1 0.1 0\n", "the command at 1 s stands after a later one"),
    ],
)
def test_a_wrong_script_is_refused_with_its_line(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "drive.txt"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"drive\.txt") as refusal:
        read_script(path, hold=False)
    assert complaint in str(refusal.value)


def test_a_missing_script_is_bad_input(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ("sim", "--world", "empty", "--script", str(tmp_path / "no.txt"), "--out")
    assert main((*words, str(tmp_path))) == 2
    assert "no.txt: cannot be read" in capsys.readouterr().err
