"""`agribot run --platform hardware` as a builder starts it, with every device on a pseudo-terminal.

The motor board is emulated by its table of messages; bytes, lines, threads and clock are real.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import pty
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import ANY

import pytest

from agribot.app.open_run import open_run
from agribot.app.run import Run
from agribot.cli.main import main
from agribot.core import config
from agribot.core.errors import PlatformError
from agribot.core.fact_text import render
from agribot.core.facts import (
    BoardHoldsStop,
    BoardStopped,
    ButtonPressed,
    ContactorInTrouble,
    Disarmed,
    DisarmedAlone,
    Fact,
    FarFromMap,
    MotorsReportFault,
    RelayLost,
    SensorSilent,
)
from agribot.core.geo import Datum
from agribot.core.messages import ClearStop, TickRecord, Who
from agribot.drivers import hardware_platform
from agribot.drivers.board.board_protocol import COMMAND_TIMEOUT_S, StopCause
from agribot.record.replay import read_ticks
from agribot.ui import wire
from tests import nightly
from tests.drivers.hardware_bench import HardwareBench
from tests.drivers.lines import Line, Opened
from tests.finding import find, holds
from tests.ui.client import Page
from tests.ui.page.robots import resumed_with_page
from tests.waiting import PATIENCE_S, interrupted_once, wait_for

pytest.importorskip("serial", reason="pyserial is missing (pip install -e '.[hardware]')")
SETTINGS = [
    "platform=hardware", "perception.enabled=false", "field.row_count=1",
    "safety.clock_jump_s=60",  # a busy machine is no fault of the robot's
]  # fmt: skip
# Of a robot in the bench's own process, which stand still together: it notices a silent bench.
WATCHFUL = [
    "safety.sensor_timeout_s=1.5", "estimate.wheel_timeout_s=1.5", "estimate.imu_timeout_s=1.5",
]  # fmt: skip
# Of a robot in a process of its own: a bench that the machine lets wait is no silent one.
PATIENT = [
    "safety.sensor_timeout_s=60", "estimate.wheel_timeout_s=60", "estimate.imu_timeout_s=60",
]  # fmt: skip
START = (-2.0, 0.0, math.pi / 2.0)  # the mark of the farm
AHEAD_M = 1.2
AND_LIST_MODULES = """
import sys
from agribot.cli.main import main
code = main(sys.argv[1:])
print(*sys.modules)
sys.exit(code)
"""
IN_TERMINAL = """
import fcntl, os, signal, sys, termios
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it is ignored
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[HardwareBench]:
    """A robot on its mark, with a home of its own, so that its stops are."""
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))  # where robots keep each other off
    with HardwareBench(tmp_path, START, config.load("farm").field) as bench:
        yield bench


@pytest.fixture
def places(tmp_path: Path) -> Path:
    """One place, straight ahead."""
    frame = {"type": "Point", "coordinates": list(_ahead())}
    file = tmp_path / "places.geojson"
    file.write_text(json.dumps({"type": "Feature", "properties": {}, "geometry": frame}))
    return file


def _ahead() -> tuple[float, float]:
    from agribot.core.geo import MapFrame

    frame = MapFrame(config.load("farm").field.datum)
    lat_deg, lon_deg, _ = frame.geodetic_from_map(START[0], START[1] + AHEAD_M)
    return lon_deg, lat_deg


def words(bench: HardwareBench, out: Path, *more: str) -> list[str]:
    sets = [word for setting in (*SETTINGS[1:], *PATIENT) for word in ("--set", setting)]
    return ["run", "farm", "--platform", "hardware", *bench.sources, *sets, "--headless",
            "--out", str(out), *more]  # fmt: skip


def open_bench(bench: HardwareBench, out: Path, *more: str, is_armed: bool) -> Run:
    sources = [f"sources.base='{bench.base_uri}'"]
    settings = config.load("farm", [*SETTINGS, *WATCHFUL, *sources, *more])
    return open_run(settings, out, is_armed=is_armed)


def until(run: Run, is_so: object, limit_s: float = 90.0, *, by_hand: bool = False) -> TickRecord:
    """Drive until it is so."""
    assert callable(is_so)
    for record in run.ticks():
        if by_hand:
            run.inbox.drive(0.2, 0.0, Who("Ann"))
        if is_so(record):
            return record
        assert record.batch.t_s < limit_s, record.status
    raise AssertionError(f"the run ended: {run.last and run.last.status}")


def test_a_builder_starts_the_robot_it_drives_to_a_place_and_a_replay_gives_the_same_commands(
    bench: HardwareBench, places: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    options = words(bench, out, "--arm", "--waypoints", str(places), "--for", "300")
    done = subprocess.run(
        [sys.executable, "-c", AND_LIST_MODULES, *options],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    loaded = done.stdout.splitlines()[-1].split()
    assert "agribot.drivers.hardware_platform" in loaded
    assert [name for name in loaded if name.startswith("agribot.sim")] == []
    report = json.loads((out / "report.json").read_text())
    assert report["mission"]["waypoints_reached"] == 1
    x_m, y_m, _ = bench.pose
    assert math.hypot(x_m - START[0], y_m - START[1] - AHEAD_M) < 0.2
    ticks = list(read_ticks(out / "run.mcap"))
    assert {len(tick.batch.wheels) for tick in ticks} >= {2}, "100 Hz in ticks of 50 Hz"
    moved = [tick for tick in ticks if tick.command.drive.v_mps]
    for samples in ("board", "imu", "battery"):
        assert any(getattr(tick.batch, samples) for tick in moved)
    assert main(["replay", str(out / "run.mcap"), "--check"]) == 0
    assert "identical" in capsys.readouterr().out
    assert bench.board.commands[-1].speed_countps == (0, 0, 0, 0)


def test_a_terminal_that_is_closed_stops_the_robot_and_the_run_writes_its_report(
    bench: HardwareBench, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    far, near = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", IN_TERMINAL, sys.executable, "-m", "agribot.cli",
         *words(bench, out, "--arm", "--for", "300")],
        stdin=near, stdout=near, stderr=near, start_new_session=True,
    )  # fmt: skip
    os.close(near)
    try:
        wait_for(lambda: any(any(c.speed_countps) for c in bench.board.commands), "the drive")
        os.close(far)
        assert process.wait(PATIENCE_S) == 130
    finally:
        process.kill()
        process.wait()
    assert bench.board.commands[-1].speed_countps == (0, 0, 0, 0)
    assert "interrupted" in json.loads((out / "report.json").read_text())["reason"]


def test_a_run_that_ends_stops_the_robot_though_a_hand_drives_on(
    bench: HardwareBench, tmp_path: Path
) -> None:
    with open_bench(bench, tmp_path / "run", is_armed=True) as run:
        ended = threading.Event()

        def drive_on() -> None:
            while not ended.wait(0.05):
                run.inbox.drive(0.2, 0.0, Who("Ann"))

        hand = threading.Thread(target=drive_on)
        hand.start()
        try:
            until(run, lambda r: r.command.drive.v_mps > 0.1)
            run.finish("interrupted")
            wait_for(
                lambda: bench.board.commands[-1].speed_countps == (0, 0, 0, 0), "wheels that stand"
            )
            assert run.inbox.takes_hands, "who keeps the page open may drive again"
        finally:
            ended.set()
            hand.join()


def test_a_robot_begins_disarmed_and_moves_when_a_person_has_cleared_that(
    bench: HardwareBench, tmp_path: Path
) -> None:
    with open_bench(bench, tmp_path / "run", is_armed=False) as run:
        record = until(run, lambda r: r.batch.t_s > 1.0)
        assert record.status.stopped_fact == Disarmed()
        assert bench.board.clears == 0
        assert {c.speed_countps for c in bench.board.commands} == {(0, 0, 0, 0)}
        run.inbox.post(ClearStop(), Who("Ann"))
        until(run, lambda r: not r.status.stopped)
        until(run, lambda r: r.batch.board and not r.batch.board[-1].stop)
        assert bench.board.clears >= 1
        run.inbox.drive(0.2, 0.0, Who("Ann"))
        drive(run)
        assert max(c.speed_countps for c in bench.board.commands) > (0, 0, 0, 0)


def drive(run: Run, seconds: float = 0.5) -> TickRecord:
    """By hand."""
    assert run.last is not None
    end_s = run.last.batch.t_s + seconds
    for record in run.ticks():
        run.inbox.drive(0.2, 0.0, Who("Ann"))
        if record.batch.t_s >= end_s:
            return record
    raise AssertionError("the run ended")


def armed(bench: HardwareBench, out: Path) -> Run:
    """A robot that is driven by hand."""
    run = open_bench(bench, out, is_armed=True)
    until(run, lambda r: r.batch.board and not r.batch.board[-1].stop)
    record = drive(run)
    assert record.command.drive.v_mps > 0.1, record.status
    return run


def brown_out(bench: HardwareBench) -> None:
    bench.board.restart()


def press(bench: HardwareBench) -> None:
    bench.board.is_button_pressed = True


def break_motor(bench: HardwareBench) -> None:
    bench.board.motor_faults = 1


def fall_silent(bench: HardwareBench) -> None:
    bench.board.timeout_s = COMMAND_TIMEOUT_S  # its wheels stand by themselves
    bench.board.is_silent = True


def pull_out(bench: HardwareBench) -> None:
    bench.board.timeout_s = COMMAND_TIMEOUT_S
    bench.base.unplug()


@pytest.mark.parametrize(
    ("harm", "why"),
    [
        (press, ButtonPressed()),
        (brown_out, BoardHoldsStop(cause=BoardStopped(("began",)))),
        (break_motor, MotorsReportFault(("right_wheel_R",))),
        (fall_silent, SensorSilent("wheels", ANY, ANY, ANY)),
        (pull_out, SensorSilent("wheels", ANY, ANY, ANY)),
    ],
)
def test_whatever_befalls_the_board_stops_the_robot_with_the_reason(
    harm: object, why: Fact, bench: HardwareBench, tmp_path: Path
) -> None:
    assert callable(harm)
    with armed(bench, tmp_path / "run") as run:
        harm(bench)
        record = until(run, lambda r: r.status.stopped, by_hand=True)
        assert holds(record.status.stopped_fact, why)
        assert record.command.drive.v_mps == 0.0
        wait_for(lambda: not any(map(round, bench.board.speed_countps)), "the wheels to stand")


def test_a_board_that_was_unplugged_is_driven_again_when_it_is_back_and_cleared(
    bench: HardwareBench, tmp_path: Path
) -> None:
    with armed(bench, tmp_path / "run") as run:
        bench.base.unplug()
        assert "silent" in until(run, lambda r: r.status.stopped, by_hand=True).status.stopped
        bench.base.plug_in()
        until(run, lambda r: r.batch.wheels and r.batch.board)

        def is_cleared(record: TickRecord) -> bool:
            if record.status.stopped:  # also anew, where the bench had no time to speak
                run.inbox.post(ClearStop(), Who("Ann"))
            return bool(record.batch.board) and not record.batch.board[-1].stop

        until(run, is_cleared)
        assert drive(run, 1.0).command.drive.v_mps > 0.1
    told = (tmp_path / "run" / "events.jsonl").read_text()
    assert "is lost" in told and "is back" in told


class Relay:
    """An LCUS-1 whose contacts hold the contactor of the bench's motors."""

    def __init__(self, line: Line, bench: HardwareBench) -> None:
        self.line, self._bench, self._heard = line, bench, b""

    def follow(self, _: TickRecord) -> bool:
        """Switch as commanded, and return whether it holds."""
        self._heard += self.line.hear()
        for k in range(0, len(self._heard) - 3, 4):
            self._bench.board.has_power = self._heard[k : k + 4] == bytes.fromhex("A00101A2")
        self._heard = self._heard[len(self._heard) // 4 * 4 :]
        return self._bench.board.has_power


@pytest.fixture
def relay(bench: HardwareBench, tmp_path: Path) -> Iterator[Relay]:
    bench.board.has_power = False
    line = Line(tmp_path)
    yield Relay(line, bench)
    line.unplug()


def with_contactor(bench: HardwareBench, relay: Relay, out: Path) -> Run:
    """A robot that is driven by hand, with a relay in its motors' supply."""
    run = open_bench(bench, out, is_armed=True)
    run.take_sensors([Opened().open("contactor", f"lcus:{relay.line.path}")])
    until(run, relay.follow)
    until(run, lambda r: r.batch.board and not r.batch.board[-1].stop)
    assert drive(run).command.drive.v_mps > 0.1
    return run


def test_a_board_that_runs_away_loses_its_motors_power_until_it_stands_and_is_cleared(
    bench: HardwareBench, relay: Relay, tmp_path: Path
) -> None:
    with with_contactor(bench, relay, tmp_path / "run") as run:
        bench.board.runaway_countps = 3.0 * max(bench.board.speed_countps)
        record = until(run, lambda r: not relay.follow(r), by_hand=True)
        assert record.command.is_power_cut and record.status.stopped
        bench.board.runaway_countps = 0.0

        def is_cleared(record: TickRecord) -> bool:
            if record.status.stopped:  # also anew, for as long as a wheel still turns
                run.inbox.post(ClearStop(), Who("Ann"))
            return relay.follow(record)

        until(run, is_cleared)
        assert not any(map(round, bench.board.speed_countps))
    wait_for(lambda: not relay.follow(record), "the relay to fall off with the program's end")


def test_a_relay_that_is_pulled_out_stops_the_robot_and_is_named(
    bench: HardwareBench, relay: Relay, tmp_path: Path
) -> None:
    with with_contactor(bench, relay, tmp_path / "run") as run:
        relay.line.unplug()
        record = until(run, lambda r: r.status.stopped, by_hand=True)
        lost = RelayLost(str(relay.line.path))
        assert record.status.stopped_fact == ContactorInTrouble(cause=lost)


def test_a_stop_outlives_the_program_until_a_person_clears_it(
    bench: HardwareBench, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = words(bench, tmp_path / "killed", "--arm")
    with subprocess.Popen(
        [sys.executable, "-m", "agribot.cli", *options], stderr=subprocess.DEVNULL
    ) as robot:
        wait_for(lambda: bench.board.clears and not bench.board.causes, "the board to be armed")
        bench.board.is_button_pressed = True
        wait_for(lambda: list((tmp_path / "home" / "stops").glob("*.json")), "the stop on disk")
        robot.send_signal(signal.SIGKILL)
    bench.board.is_button_pressed = False
    bench.forget_commands()
    assert main(words(bench, tmp_path / "again", "--arm", "--for", "2")) == 2
    told = capsys.readouterr().err
    assert render(ButtonPressed()) in told
    assert StopCause.ESTOP in bench.board.causes and not bench.board.commands
    with interrupted_once(lambda: not bench.board.causes):
        main(words(bench, tmp_path / "cleared", "--arm", "--clear-stop"))
    assert not bench.board.causes
    assert not list((tmp_path / "home" / "stops").glob("*.json"))


@contextlib.contextmanager
def on_its_way(
    bench: HardwareBench, places: Path, folder: Path
) -> Iterator[subprocess.Popen[bytes]]:
    """Start a robot of its own process that drives to a place, and is under way."""
    options = words(bench, folder, "--arm", "--waypoints", str(places))
    with subprocess.Popen(
        [sys.executable, "-m", "agribot.cli", *options], stderr=subprocess.DEVNULL
    ) as robot:
        wait_for(lambda: bench.pose[1] - START[1] > 0.3, "the robot to be on its way")
        yield robot


def test_a_run_that_was_killed_in_a_stop_goes_on_once_a_person_has_cleared_it(
    bench: HardwareBench, places: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    killed, again = tmp_path / "killed", tmp_path / "again"
    with on_its_way(bench, places, killed) as robot:
        bench.board.is_button_pressed = True
        wait_for(
            lambda: ButtonPressed().code in (killed / "mission.json").read_text(),
            "the stop in its folder",
        )
        robot.send_signal(signal.SIGKILL)
    bench.board.is_button_pressed = False
    bench.forget_commands()
    resume = ["run", "--resume", str(killed), "--arm", "--headless", "--for", "300"]
    assert main([*resume, "--out", str(tmp_path / "refused")]) == 2
    told = capsys.readouterr().err
    assert render(ButtonPressed()) in told
    assert not bench.board.commands
    assert main([*resume, "--clear-stop", "--out", str(again)]) == 0, capsys.readouterr().err
    assert "None" not in capsys.readouterr().err  # of what only a simulator knows
    report = json.loads((again / "report.json").read_text())
    assert report["mission"]["waypoints_reached"] == 1
    assert [Path(run["folder"]).name for run in report["job"]["runs"]] == ["killed", "again"]
    x_m, y_m, _ = bench.pose
    assert math.hypot(x_m - START[0], y_m - START[1] - AHEAD_M) < 0.2


@nightly.by_day(
    "test_a_run_that_was_killed_in_a_stop_goes_on_once_a_person_has_cleared_it",
    "test_a_stop_outlives_the_program_until_a_person_clears_it",
    "tests/mission/test_protective_stops.py::"
    "test_a_stopped_run_that_is_killed_stands_until_a_person_lets_it_go",
)
@pytest.mark.parametrize("is_remembered", [True, False], ids=["remembered", "in its folder only"])
def test_a_run_that_was_killed_in_a_stop_stands_with_it_until_its_operator_clears_and_resumes(
    bench: HardwareBench, places: Path, tmp_path: Path, *, is_remembered: bool
) -> None:
    killed, again = tmp_path / "killed", tmp_path / "again"
    with on_its_way(bench, places, killed) as robot:
        bench.board.is_bumper_pressed = True
        wait_for(lambda: "bump" in (killed / "mission.json").read_text(), "the stop in its folder")
        wait_for(lambda: list((tmp_path / "home" / "stops").glob("*.json")), "the stop on disk")
        robot.send_signal(signal.SIGKILL)
    if not is_remembered:
        shutil.rmtree(tmp_path / "home" / "stops")
    bench.board.is_bumper_pressed = False
    why = json.loads((killed / "mission.json").read_text())["stopped"]
    assert "the bumper touches something" in why
    wait_for(lambda: not any(bench.board.speed_countps), "the wheels to stand")
    left = bench.pose
    bench.forget_commands()
    with (
        resumed_with_page(killed, again, ["--arm"]) as resumed,
        Page(int(resumed.address.rpartition(":")[2])) as page,
    ):
        page.take_seat()
        assert why in receive_state(page, lambda state: state.stop).stop
        page.ask(wire.ControlMission(action="resume"))
        receive_state(page, lambda state: "clear the stop first" in tell_refusal(state))
        hear_more(bench)
        assert why in page.receive(wire.State).stop
        assert page.ask(wire.ClearStop()).ok
        receive_state(page, lambda state: not state.stop)
        hear_more(bench)
        assert bench.pose == left
        assert {command.speed_countps for command in bench.board.commands} == {(0, 0, 0, 0)}
        assert page.ask(wire.ControlMission(action="resume")).ok
        resumed.process.communicate(timeout=PATIENCE_S)
        assert resumed.process.returncode == 0
    report = json.loads((again / "report.json").read_text())
    assert report["mission"]["waypoints_reached"] == 1
    x_m, y_m, _ = bench.pose
    assert math.hypot(x_m - START[0], y_m - START[1] - AHEAD_M) < 0.2


def receive_state(page: Page, is_so: Callable[[wire.State], object]) -> wire.State:
    def receive() -> wire.State | None:
        state = page.receive(wire.State)
        return state if is_so(state) else None

    return wait_for(receive, "such a state")


def tell_refusal(state: wire.State) -> str:
    return "" if state.mission is None else state.mission.refusal


def hear_more(bench: HardwareBench, commands: int = 50) -> None:
    """Let the robot send its board this many further commands."""
    count = len(bench.board.commands) + commands
    wait_for(lambda: len(bench.board.commands) >= count, "commands to the board")


def test_a_robot_that_nobody_could_arm_is_refused(
    bench: HardwareBench, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words(bench, tmp_path / "run")) == 2
    assert render(DisarmedAlone("hardware")) in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("base", "why"),
    [
        ("", "needs its motor board"),
        ("base=gpsd:", "not the line of a motor board"),
        ("base=serial:/dev/nothing?counts_per_turn=2048&full_speed_radps=8.4", "plugged in"),
        ("base=serial:{path}", "agribot calibrate motors"),
        ("base=serial:{path}?counts_per_turn=2048", "full_speed_radps is not stated"),
        (
            "base=serial:{path}?board=vesc&ids=1,2&pole_pairs=7&gear=10",
            "cannot read the red button",
        ),
    ],
)
def test_a_base_that_cannot_be_driven_is_refused_in_one_line(
    base: str, why: str, bench: HardwareBench, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = ["--source", base.format(path=bench.base.path)] if base else []
    options = ["run", "farm", "--platform", "hardware", "--arm", *source]
    assert main([*options, "--out", str(tmp_path / "run")]) == 2
    assert why in capsys.readouterr().err.strip().splitlines()[-1]


def test_a_board_that_says_nothing_is_refused_in_words(
    bench: HardwareBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hardware_platform, "FIRST_REPORT_S", 0.2)
    bench.board.is_silent = True
    bench.forget_commands()  # that it was about to say something is over
    bench.base.unplug()
    bench.base.plug_in()  # a line in which nothing was said before
    with pytest.raises(PlatformError, match=r"for 0\.2 s it says nothing; check its power"):
        open_bench(bench, tmp_path / "run", is_armed=True)


def test_a_motor_board_of_a_simulated_robot_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["run", "farm", "--source", "base=serial:/dev/x", "--out", str(tmp_path / "run")]
    assert main(options) == 2
    assert "--platform hardware" in capsys.readouterr().err


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[HardwareBench]:
    """A robot in Germany."""
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    field = config.FieldConfig(datum=Datum(lat_deg=48.7, lon_deg=9.2))
    with HardwareBench(tmp_path, (0.0, 0.0, math.pi / 2.0), field) as bench:
        yield bench


def test_a_robot_on_another_continent_than_its_map_stands_and_names_both_places(
    elsewhere: HardwareBench, tmp_path: Path
) -> None:
    with open_bench(elsewhere, tmp_path / "run", is_armed=True) as run:
        run.take_sensors([Opened().open("gnss", f"serial:{elsewhere.gnss.path}")])
        record = until(run, lambda r: holds(r.status.fact, FarFromMap))
        far = find(record.status.fact, FarFromMap)
        assert far.lat_deg == pytest.approx(48.7, abs=5e-4)
        origin = (far.origin_lat_deg, far.origin_lon_deg)
        assert origin == pytest.approx((21.16129, 72.78702), abs=1e-5)
        assert run.stack.mission.path is None


def test_a_robot_whose_settings_state_no_origin_drives_rows_from_its_first_fix(
    elsewhere: HardwareBench, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    options = words(elsewhere, out, "--arm", "--set", "mission.waits_for_goals=false")
    with interrupted_once(lambda: any(any(c.speed_countps) for c in elsewhere.board.commands)):
        main(["run", "hardware", *options[2:]])
    datum = config.load(str(out / "config.toml")).field.datum
    assert (datum.lat_deg, datum.lon_deg) == pytest.approx((48.7, 9.2), abs=1e-4)
    assert (tmp_path / "home" / "first-fix.toml").exists()
    assert any(any(command.speed_countps) for command in elsewhere.board.commands)


def test_ticks_keep_the_time_of_the_clock_and_leave_out_what_was_missed(
    bench: HardwareBench, tmp_path: Path
) -> None:
    with open_bench(bench, tmp_path / "run", is_armed=False) as run:
        until(run, lambda r: r.batch.t_s > 0.5)
        assert run.last is not None
        before_s = run.last.batch.t_s
        threading.Event().wait(0.25)
        after_s = next(run.ticks()).batch.t_s
        assert after_s - before_s >= 0.24
        assert math.remainder(after_s, 0.02) == pytest.approx(0.0, abs=1e-9)
    assert os.environ["AGRIBOT_HOME"].startswith(str(tmp_path))
