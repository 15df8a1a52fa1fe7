"""The simulated robot is stopped by what happens to it, and waits for a person."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import ANY

import msgspec
import pytest

from agribot.app.mission_file import continue_config, read_mission
from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.cli.main import main
from agribot.core.config import load
from agribot.core.fact_text import render
from agribot.core.facts import (
    CutOffStanding,
    Fact,
    ImuFrozen,
    ImuLineSpoilt,
    Motion,
    MotorDead,
    MotorsReportFault,
    NothingToClear,
    StoppedBy,
    StopToClear,
    Stuck,
    Touched,
    TurnsDisagree,
    Wheel,
    WheelsSwapped,
    WheelsWrong,
)
from agribot.core.messages import (
    BumperSample,
    ControlMission,
    GoTo,
    PressStop,
    RobotCommand,
    SensorBatch,
    TickRecord,
    Who,
)
from tests import nightly
from tests.asking import BY_WORD
from tests.finding import find, holds, is_like

QUICK = ["perception.enabled=false", "record.enabled=false", "sim.sensors='rtk'"]
FROM_S = 8.0  # in the first turn
IN_ROW_S = 22.0
Spoil = Callable[[SensorBatch], SensorBatch]


def opened(out: Path, *more: str) -> SimulatedRun:
    return simulate(load("farm", [*QUICK, *more]), out)


def spoil(session: SimulatedRun, change: Spoil, from_s: float = FROM_S) -> None:
    read = session.platform.read

    def spoilt() -> SensorBatch:
        batch = read()
        return change(batch) if batch.t_s > from_s else batch

    session.platform.read = spoilt  # type: ignore[method-assign]


def misdrive(session: SimulatedRun, change: Callable[[RobotCommand], RobotCommand]) -> None:
    """A board that does not follow its command after `FROM_S`."""
    write, read = session.platform.write, session.platform.read
    now_s = [0.0]

    def seen() -> SensorBatch:
        batch = read()
        now_s[0] = batch.t_s
        return batch

    def wrong(command: RobotCommand) -> None:
        write(change(command) if now_s[0] > FROM_S else command)

    session.platform.read = seen  # type: ignore[method-assign]
    session.platform.write = wrong  # type: ignore[method-assign]


def stopped(session: SimulatedRun, ticks: Iterator[TickRecord]) -> TickRecord:
    """The first tick in which the supervisor stops the robot for good."""
    for record in ticks:
        assert record.batch.t_s < IN_ROW_S + 5.0, "it drives on"
        if isinstance(record.fact, StopToClear):
            assert record.command.drive.v_mps == 0.0
            return record
    raise AssertionError("the run ended without a stop")


def touch(batch: SensorBatch) -> SensorBatch:
    sample = BumperSample(t_s=batch.t_s, x_body_m=0.5, y_body_m=0.0)
    return msgspec.structs.replace(batch, bumper=(sample,))


@pytest.mark.parametrize("mode", ["mission", "goto", "hand"])
def test_a_touch_stops_the_robot_in_its_tick_in_every_mode(tmp_path: Path, mode: str) -> None:
    with opened(tmp_path) as session:
        spoil(session, touch)
        ticks = session.ticks()
        for record in ticks:
            if mode == "hand":
                session.inbox.drive(0.3, 0.0, Who("Ann"))
            elif mode == "goto" and record.batch.t_s > 4.0 and record.status.leg != "to the goal":
                session.inbox.post(GoTo(x_map_m=-2.0, y_map_m=6.0))
            if record.batch.bumper:
                break
        assert holds(record.fact, Touched)
        assert record.command.drive.v_mps == 0.0
        assert session.simulator.truth().v_mps > 0.15, "it drove until then"
        for _ in range(100):
            session.inbox.drive(0.3, 0.0, Who("Ann"))
            record = next(ticks)
            assert record.command.drive.v_mps == 0.0
        assert is_like(record.status.stopped_fact, Touched("front", ANY, ANY, ANY))
        assert record.status.state == "paused"
        assert abs(session.simulator.truth().v_mps) < 0.01


@nightly.one_by_one(
    "motor",
    [
        ("left_wheel_F", "effort"),
        ("right_wheel_R", "servo"),
        ("left_wheel_F", "servo"),
        ("right_wheel_R", "effort"),
    ],
    in_suite=2,
)
def test_a_dead_motor_is_named_within_a_second(tmp_path: Path, motor: tuple[Wheel, str]) -> None:
    wheel, actuation = motor
    with opened(tmp_path, f"sim.actuation='{actuation}'") as session:
        ticks = session.ticks()
        next(record for record in ticks if record.batch.t_s > FROM_S)
        session.simulator.limit_torque(wheel, 0.0)
        record = stopped(session, ticks)
    wrong = WheelsWrong((wheel,), ANY, ANY, ANY)
    named = (MotorDead(wheel), MotorsReportFault((wheel,)), wrong)
    assert any(holds(record.fact, one) for one in named), record.fact
    assert record.batch.t_s - FROM_S < 1.0


def board(v_ratio: float, yaw_ratio: float = 1.0) -> Callable[[RobotCommand], RobotCommand]:
    def change(command: RobotCommand) -> RobotCommand:
        drive = command.drive
        twist = msgspec.structs.replace(
            drive, v_mps=v_ratio * drive.v_mps, yaw_rate_radps=yaw_ratio * drive.yaw_rate_radps
        )
        return msgspec.structs.replace(command, drive=twist)

    return change


@pytest.mark.parametrize(
    ("v_ratio", "motion"),
    [(2.0, "fast"), (-1.0, "backwards"), (0.0, "stand")],
    ids=["runs away", "reversed", "commands lost"],
)
def test_a_board_that_does_not_as_told_is_stopped_within_a_second(
    tmp_path: Path, v_ratio: float, motion: Motion
) -> None:
    with opened(tmp_path) as session:
        misdrive(session, board(v_ratio))
        record = stopped(session, session.ticks())
    assert find(record.fact, WheelsWrong).motion == motion
    assert record.batch.t_s - FROM_S < 1.0


def test_steering_the_wrong_way_round_is_told_within_a_second(tmp_path: Path) -> None:
    with opened(tmp_path) as session:
        misdrive(session, board(1.0, -1.0))
        record = stopped(session, session.ticks())
    assert holds(record.fact, WheelsSwapped)
    assert record.batch.t_s - FROM_S < 1.0


@pytest.mark.parametrize("is_all", [True, False], ids=["all", "one"])
def test_an_encoder_that_sticks_is_named_within_a_second(tmp_path: Path, is_all: bool) -> None:
    stuck: list[tuple[float, ...]] = []

    def stick(batch: SensorBatch) -> SensorBatch:
        wheels = []
        for wheel in batch.wheels:
            stuck[:] = stuck or [wheel.angle_rad]
            angles = stuck[0] if is_all else (*wheel.angle_rad[:3], stuck[0][3])
            wheels.append(msgspec.structs.replace(wheel, angle_rad=angles))
        return msgspec.structs.replace(batch, wheels=tuple(wheels))

    with opened(tmp_path) as session:
        spoil(session, stick)
        record = stopped(session, session.ticks())
    wrong = find(record.fact, WheelsWrong)
    assert wrong.motion == "stand"
    assert len(wrong.wheels) > 1 if is_all else wrong.wheels == ("left_wheel_F",)
    assert record.batch.t_s - FROM_S < 1.0


@pytest.mark.parametrize(
    ("gyro", "wanted"),
    [
        ("off", TurnsDisagree),
        pytest.param(
            "frozen",
            ImuFrozen,
            marks=nightly.by_day(
                "tests/autonomy/control/test_wheel_watch.py::"
                "test_an_imu_that_repeats_itself_is_told_of_a_moving_robot_only",
                "test_a_gyro_that_lies_is_told_within_a_second",
            ),
        ),
    ],
)
def test_a_gyro_that_lies_is_told_within_a_second(
    tmp_path: Path, gyro: str, wanted: type[Fact]
) -> None:
    first: list[SensorBatch] = []

    def lie(batch: SensorBatch) -> SensorBatch:
        first[:] = first or [batch]
        said = first[0].imu[0]
        imu = tuple(
            msgspec.structs.replace(said, t_s=sample.t_s)
            if gyro == "frozen"
            else msgspec.structs.replace(
                sample, gyro_radps=(*sample.gyro_radps[:2], sample.gyro_radps[2] + 0.3)
            )
            for sample in batch.imu
        )
        return msgspec.structs.replace(batch, imu=imu)

    with opened(tmp_path) as session:
        spoil(session, lie, IN_ROW_S)
        record = stopped(session, session.ticks())
    assert holds(record.fact, wanted)
    assert record.batch.t_s - IN_ROW_S < 1.0


@pytest.mark.parametrize(
    ("sensors", "actuation"),
    [
        ("rtk", "effort"),
        *(
            pytest.param(
                *other, marks=nightly.by_day("test_a_robot_without_fault_is_never_stopped")
            )
            for other in (
                ("m8n", "servo"),
                ("legacy", "effort"),
                ("seed", "servo"),
                ("ideal", "servo"),
            )
        ),
    ],
)
def test_a_robot_without_fault_is_never_stopped(
    tmp_path: Path, sensors: str, actuation: str
) -> None:
    """Setting off, a turn, crop rows, a pause and a drive by hand, with every kind of sensor."""
    settings = [f"sim.sensors='{sensors}'", f"sim.actuation='{actuation}'", "duration_s=32"]
    settings += ["field.row_length_m=2", "mission.max_row_std_m=3", "mission.full_speed_std_m=2"]
    with opened(tmp_path, *settings) as session:
        for record in session.ticks():
            assert not record.status.stopped
            assert not record.batch.bumper
            t_s = record.batch.t_s
            if 12.0 < t_s < 13.0:
                session.inbox.drive(-0.3, 0.8 * (t_s - 12.5), Who("Ann"))
            if abs(t_s - 16.0) < 0.01:
                session.inbox.post(ControlMission(action="resume"))
        assert record.status.s_m > 5.0


def test_a_stopped_run_that_is_killed_stands_until_a_person_lets_it_go(tmp_path: Path) -> None:
    first, again = tmp_path / "first", tmp_path / "again"
    with opened(first) as session:
        for record in session.ticks():
            if record.batch.t_s > FROM_S and not record.status.stopped:
                session.inbox.post(PressStop(), Who("Ann"))
            if record.batch.t_s > FROM_S + 1.0:
                break
    saved = read_mission(first)
    config = continue_config(load(str(first / "config.toml")), saved)
    with simulate(config, again, saved) as session:
        session.unattended.is_attended = True
        ticks = session.ticks()
        start = session.simulator.truth()
        for record in ticks:
            assert record.command.drive.v_mps == 0.0
            if record.batch.t_s > 5.0:
                break
        assert record.status.stopped_fact == StoppedBy("Ann")
        for action in ("clear_stop", "resume"):
            session.inbox.post(BY_WORD[action])
        record = next(record for record in ticks if record.batch.t_s > 10.0)
        assert record.status.state == "running"
        driven = session.simulator.truth()
        assert math.hypot(driven.x_map_m - start.x_map_m, driven.y_map_m - start.y_map_m) > 0.5


def test_a_stopped_run_is_not_resumed_where_nobody_could_let_it_go(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = tmp_path / "first"
    with opened(first) as session:
        spoil(session, touch)
        stopped(session, session.ticks())
        next(session.ticks())
    words = ["run", "--resume", str(first), "--for", "8", "--out", str(tmp_path / "again")]
    assert main(words) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    stop = find(read_mission(first).stop, Touched)
    assert is_like(stop, Touched("front", ANY, ANY, ANY))
    assert render(CutOffStanding(str(first), stop, asks_first=False)) in line
    assert not (tmp_path / "again").exists()
    assert main(["run", "farm", "--clear-stop"]) == 2
    assert render(NothingToClear()) in capsys.readouterr().err
    main([*words, "--clear-stop"])
    assert read_mission(tmp_path / "again").s_m > read_mission(first).s_m


def test_a_run_that_nobody_attends_ends_when_its_stop_is_not_cleared(tmp_path: Path) -> None:
    with opened(tmp_path, "mission.stall_timeout_s=3") as session:
        spoil(session, touch)
        for record in session.ticks():
            assert record.batch.t_s < FROM_S + 10.0
        report = session.finish()
    assert not report.ok
    touched = read_mission(tmp_path).stop
    assert isinstance(touched, Touched) and render(touched) in report.reason
    assert "no operator cleared the stop for 3 s" in report.reason
    assert any("bumper" in stop.parts for stop in report.safety.stops)


def test_a_noisy_line_is_told_by_its_name_on_rough_soil(tmp_path: Path) -> None:
    """The same drive without a fault is stopped by nothing."""
    rough = load("rows-10x12", [*QUICK, "sim.preset='field'", "faults=['link.noise=0.2@20']"])
    with simulate(rough, tmp_path) as session:
        for record in session.ticks():
            if record.status.gate.state == "stopped" or record.batch.t_s > 65.0:
                break
        states = [event.reason for event in session.event_log.list_kind("gate")]
        checks = session.event_log.list_kind("check")
    assert holds(record.status.gate.fact, ImuLineSpoilt(3, ANY, ANY))
    assert record.status.gate.state == "stopped"
    assert states[0].startswith("standby -> driving: ")
    assert states[-1].partition(":")[0].endswith("-> stopped")
    assert ["all is good" in check.reason for check in checks] == [True]


def test_in_mud_the_robot_tries_to_back_out_and_then_a_person_has_to_look(tmp_path: Path) -> None:
    rough = load("rows-10x12", [*QUICK, "sim.preset='field'", "faults=['soil.mud=0.1@30']"])
    legs = [""]
    with simulate(rough, tmp_path) as session:
        for record in session.ticks():
            legs += [record.status.leg] * (record.status.leg != legs[-1])
            if record.status.gate.state == "stopped" or record.batch.t_s > 120.0:
                break
        gates = session.event_log.list_kind("gate")
        report = session.finish()
    held = next(gate for gate in gates if gate.state == "held" and holds(gate.fact, Stuck))
    assert held.t_s < 36.0
    assert 1 <= legs.count("backs out to try again") <= 3
    assert holds(record.status.gate.fact, Stuck)
    assert report.tracking is not None
    assert report.tracking.plants_crushed == 0
