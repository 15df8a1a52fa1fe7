"""The hardware platform drives real firmware over a serial line, in real time."""

from __future__ import annotations

import ctypes
import json
import math
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from agribot.app.open_run import open_run
from agribot.cli.main import main
from agribot.core import config
from agribot.core.facts import ButtonPressed
from agribot.core.geo import MapFrame
from agribot.core.messages import ClearStop, GnssQuality, Who
from agribot.record.replay import read_ticks
from firmware.bench.avr_bench import AvrBench
from firmware.bench.board_on_line import BoardOnLine
from firmware.build import PREBUILT
from tests import machine, nightly
from tests.drivers.gpsd_daemon import Daemon
from tests.drivers.lines import Line
from tests.drivers.moving_robot import COUNTS_PER_TURN, MovingRobot
from tests.drivers.slow_clock import PACES, run_agribot
from tests.finding import holds
from tests.firmware.robot_on_line import RobotOnLine

OPTIONS = "counts_per_turn=2048&full_speed_radps=30"


def test_a_robot_is_armed_driven_by_hand_and_stopped_by_the_red_button_of_its_firmware(
    bench_library: ctypes.CDLL, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("serial", reason="pyserial is missing (pip install -e '.[hardware]')")
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    bench = AvrBench(bench_library, PREBUILT / "motor_board.hex")
    with BoardOnLine(bench) as board:
        base = f"sources.base='serial:{board.path}?{OPTIONS}'"
        settings = config.load("farm", ["platform=hardware", "perception.enabled=false", base])
        with open_run(settings, tmp_path / "run", is_armed=True) as run:
            is_pressed = has_imu = False
            for record in run.ticks():
                run.inbox.drive(0.3, 0.0, Who("Ann"))
                wheels = record.batch.wheels
                has_imu |= bool(record.batch.imu)
                if not is_pressed and wheels and min(wheels[-1].speed_radps) > 1.0:
                    assert record.batch.battery
                    bench.set_estop(pressed=True)
                    is_pressed = True
                if is_pressed and holds(record.status.stopped_fact, ButtonPressed):
                    break
                if record.status.stopped:  # a busy machine: the board's patience is 0.3 s
                    run.inbox.post(ClearStop())
                assert record.batch.t_s < 60.0, record.status
            assert is_pressed and has_imu
            assert holds(record.status.stopped_fact, ButtonPressed)
            assert record.command.drive.v_mps == 0.0
    assert not any(bench.duty_ratio)
    bench.close()


SETTINGS = [
    "perception.enabled=false", "tick_hz=20",
    # A busy machine is no fault of the robot's.
    "safety.sensor_timeout_s=1.5", "estimate.wheel_timeout_s=1.5", "estimate.imu_timeout_s=1.5",
    "safety.clock_jump_s=10",
]  # fmt: skip
START = (-2.0, 0.0, math.pi / 2.0)  # the mark of the farm
PLACES = ((-2.0, 1.2), (-0.8, 1.2))  # ahead, then to the right
LATE_S = 0.2


def write_places(file: Path) -> Path:
    frame = MapFrame(config.load("farm").field.datum)
    places = [frame.geodetic_from_map(*place)[:2] for place in PLACES]
    features = [
        {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [b, a]}}
        for a, b in places
    ]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return file


def start_as_a_builder(
    board: RobotOnLine, port: int, out: Path, pace: float
) -> subprocess.CompletedProcess[str]:
    """Start a robot with board and receiver plugged in, and wait for its end."""
    sets = [word for setting in SETTINGS for word in ("--set", setting)]
    motors = f"counts_per_turn={COUNTS_PER_TURN:g}&full_speed_radps=30&current_limit_a=0"
    words = ["run", "farm", "--platform", "hardware", "--arm",
             "--source", f"base=serial:{board.path}?{motors}",
             "--source", f"gnss=gpsd://127.0.0.1:{port}", *sets, "--headless",
             "--waypoints", str(write_places(out.parent / "places.geojson")),
             "--for", "40", "--out", str(out)]  # fmt: skip
    return run_agribot(words, pace)


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Line]:
    line = Line(tmp_path)
    yield line
    line.unplug()


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Daemon]:
    daemon = Daemon(tmp_path)
    yield daemon
    daemon.stop()


@nightly.by_day(
    "test_a_robot_is_armed_driven_by_hand_and_stopped_by_the_red_button_of_its_firmware",
    "tests/firmware/test_firmware_platform.py"
    "::test_the_same_mission_through_bytes_and_firmware_is_decided_as_on_the_simulator",
    "tests/firmware/test_firmware_platform.py"
    "::test_a_run_on_firmware_repeats_bit_by_bit_and_so_does_its_replay",
    "tests/drivers/test_real_gpsd.py"
    "::test_every_epoch_comes_once_with_accuracy_and_state_of_the_carrier",
)
@machine.needs("gpsd")
def test_a_builders_robot_with_real_firmware_and_a_real_gpsd_drives_to_its_places_and_replays(
    bench_library: ctypes.CDLL, bootloader: Path, line: Line, daemon: Daemon, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    pytest.importorskip("serial", reason="pyserial is missing (pip install -e '.[hardware]')")
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path))
    daemon.start(line.path)
    for pace in PACES:
        out, robot = tmp_path / f"run{pace}", MovingRobot(START, config.load("farm").field)
        board = RobotOnLine(bench_library, robot, line.blurt, bootloader, pace)
        with board:
            done = start_as_a_builder(board, daemon.port, out, pace)
        report = json.loads((out / "report.json").read_text()) if done.returncode == 0 else {}
        if report.get("mission", {}).get("waypoints_reached") == len(PLACES):
            break
        for stop in (tmp_path / "stops").glob("*.json"):
            stop.unlink()
    else:
        assert board.lag_s > LATE_S, f"{done.stderr}\n{report}"
        pytest.skip(f"this machine is too busy for a board: {board.lag_s:.2f} s late")
    assert math.dist(robot.pose[:2], PLACES[-1]) < 0.2
    ticks = list(read_ticks(out / "run.mcap"))
    fixes = [fix for tick in ticks for fix in tick.batch.gnss]
    assert fixes and {fix.quality for fix in fixes[5:]} == {GnssQuality.RTK_FIXED}
    assert any(tick.batch.imu for tick in ticks) and any(tick.batch.mag for tick in ticks)
    assert not any(board.bench.duty_ratio)
    assert main(["replay", str(out / "run.mcap"), "--check"]) == 0
    assert "identical" in capsys.readouterr().out
