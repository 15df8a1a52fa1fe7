"""Faults on the command line, in profiles and in sweeps: injected, listed, reported, refused."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.core import config
from agribot.core.errors import ConfigError
from agribot.lab.sweep.plan import plan
from agribot.record.events import read_events
from agribot.record.replay import read_ticks
from agribot.record.report import read_report

pytestmark = pytest.mark.figures
BLIND = ["--set", "perception.enabled=false"]
REFUSED = [
    ("gnss.jmp=2@3", "did you mean 'gnss.jump'?"),
    ("gnss.jump@3", "lacks its value"),
    ("gnss.frozen=1@3", "takes no value"),
    ("gnss.frozen@-3", "no mission has the time"),
    ("gnss.frozen@99", "it never comes"),
    ("camera.off@3", "perception.enabled is false"),
]


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot with RTK, whose fixes jump on the way to the first row."""
    out = tmp_path_factory.mktemp("faults") / "run"
    words = ["run", "farm", *BLIND, "--for", "15", "--out", str(out)]
    assert main([*words, "--fault", "gnss.jump=2@10+3", "--fault", "mag.motor@5"]) == 1
    return out


def test_a_run_tells_when_each_fault_began_and_ended(driven: Path) -> None:
    events = [e for e in read_events(driven / "events.jsonl") if e.kind == "injected"]
    assert [(event.t_s, event.reason) for event in events] == [
        (5.0, "mag.motor@5 begins"),
        (10.0, "gnss.jump=2@10+3 begins"),
        (13.0, "gnss.jump=2@10+3 ends"),
    ]
    settings = tomllib.loads((driven / "config.toml").read_text())
    assert settings["faults"] == ["gnss.jump=2@10+3", "mag.motor@5"]
    assert "gnss.jump=2@10+3 begins" in (driven / "report.html").read_text()


def test_the_robot_itself_is_not_told(driven: Path) -> None:
    for record in read_ticks(driven / "run.mcap"):
        assert {event.request.word for event in record.batch.requests} <= {"cancel"}  # at its end
        assert "jump=2" not in record.reason + record.estimate.reason


def test_the_report_says_what_the_robot_did(driven: Path) -> None:
    safety = json.loads((driven / "report.json").read_text())["safety"]
    jump, motor = safety["faults"]
    assert (jump["name"], jump["t_s"], jump["reaction"]) == ("gnss.jump", 10.0, "stopped")
    assert 10.0 < jump["detected_s"] < 13.0
    assert jump["code"] == "gnss_jumped"
    assert (motor["name"], motor["detected_s"], motor["reaction"]) == ("mag.motor", None, "none")
    assert (safety["crushed_after_fault"], safety["outside_m_max"]) == (0, 0.0)
    assert 0.0 <= safety["stop_distance_m_max"] < 0.5
    assert any("gnss" in noticed["parts"] for noticed in safety["noticed"])
    assert read_report(driven / "report.json").safety.faults[0].is_named


@pytest.mark.parametrize(("text", "said"), REFUSED)
@pytest.mark.parametrize("command", ["run", "sim"])
def test_a_wrong_fault_is_refused_in_one_line_before_anything_moves(
    command: str, text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    words = [command, "farm", *BLIND, "--for", "60", "--out", str(out), "--fault", text]
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not out.exists()


def test_the_world_alone_has_faults_but_none_of_a_stack(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["sim", "farm", "--for", "3", "--speed", "max", "--out", str(tmp_path / "sim")]
    assert main([*words, "--fault", "board.silent@1", "--json"]) == 0
    silent = json.loads(capsys.readouterr().out.splitlines()[-1])["samples"]
    assert silent["wheels"] < silent["imu"] / 3
    assert main([*words, "--fault", "disk.full@1"]) == 2
    assert "runs no stack" in capsys.readouterr().err


def test_a_fault_of_a_robot_that_is_not_simulated_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "farm", *BLIND, "--platform", "my_robot:open_platform"]
    assert main([*words, "--out", str(tmp_path / "run"), "--fault", "gnss.outage@3"]) == 2
    assert "faults are those of the simulator" in capsys.readouterr().err


def test_a_profile_lists_faults_and_the_command_line_adds_to_them(tmp_path: Path) -> None:
    profile = tmp_path / "hard.toml"
    profile.write_text('profile = "hard"\nfaults = ["mag.motor@2"]\n')
    assert config.load(str(profile)).faults == ("mag.motor@2",)
    out = tmp_path / "run"
    words = ["run", str(profile), *BLIND, "--for", "3", "--out", str(out)]
    assert main([*words, "--set", "record.enabled=false", "--fault", "imu.frozen@2+0.1"]) == 1
    settings = tomllib.loads((out / "config.toml").read_text())
    assert settings["faults"] == ["mag.motor@2", "imu.frozen@2+0.1"]


def test_a_sweep_varies_faults() -> None:
    jobs = plan("farm", (1,), (), ["faults=none,gnss.jump=2@30+5,mag.motor@1;imu.frozen@2"])
    assert [job.config().faults for job in jobs] == [
        (),
        ("gnss.jump=2@30+5",),
        ("mag.motor@1", "imu.frozen@2"),
    ]
    with pytest.raises(ConfigError, match=r"did you mean 'gnss\.jump'"):
        plan("farm", (1,), (), ["faults=gnss.jmp=2@30"])
