"""What went wrong is said, in the exit status, in the report and in the event log."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.record.replay import read_ticks
from tests import nightly
from tests.mission.conftest import FEW_HZ, ShortRun, see_at


@nightly.by_day(
    "tests/mission/test_cheap_gnss.py::"
    "test_without_the_camera_a_cheap_receiver_stops_before_it_crushes_the_crop",
    "tests/mission/test_waypoint_mission.py::"
    "test_a_receiver_with_five_metres_of_drift_does_not_claim_the_waypoints",
)
@pytest.mark.parametrize("preset", ["m8n", "seed"])
def test_cheap_receivers_run_to_an_honest_report(
    preset: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / preset
    arguments = ["run", "farm", "--sensors", preset, "--seed", "1", "--out", str(out), "--json"]
    settings = ["--set", "perception.enabled=false", "--set", "mission.stall_timeout_s=20"]
    status = main([*arguments, *settings])
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["ok"] is (status == 0)
    assert report["reason"]
    succeeded = report["mission"]["rows_done"] == 6 and report["tracking"]["plants_crushed"] == 0
    assert report["ok"] <= succeeded
    assert report["weeds"]["precision"] is None  # no camera: not applicable, not zero


@pytest.mark.figures
def test_a_mission_cut_short_is_not_a_success(short_run: ShortRun) -> None:
    _, report = short_run("short", "perception.enabled=false", seconds=5.0)
    assert not report.ok
    assert "5" in report.reason


def test_ctrl_c_stops_the_robot_leaves_everything_readable_and_no_graphics_library_was_loaded(
    tmp_path: Path,
) -> None:
    out = tmp_path / "run"
    code = (
        "import sys; from agribot.cli.main import main; status = main(sys.argv[1:]);"
        "print(open('/proc/self/maps').read()); sys.exit(status)"
    )
    arguments = ["run", "farm", "--speed", "4", "--out", str(out)]
    arguments += ["--set", see_at(FEW_HZ)]
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    program = subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
    )  # fmt: skip
    assert program.stderr is not None
    next(line for line in program.stderr if line.startswith("["))  # progress: it drives
    program.send_signal(signal.SIGINT)
    loaded, complaint = program.communicate(timeout=120)
    assert program.returncode == 130, complaint
    report = json.loads((out / "report.json").read_text())
    assert report["ok"] is False
    assert "interrupted" in report["reason"]
    ticks = list(read_ticks(out / "run.mcap"))
    assert ticks
    assert ticks[-1].command.drive.v_mps == 0.0
    assert ticks[-1].command.drive.yaw_rate_radps == 0.0
    assert "libmujoco" in loaded
    for library in ("libGL.", "libEGL", "libOSMesa", "libvulkan", "libX11", "libGLX"):
        assert library not in loaded
