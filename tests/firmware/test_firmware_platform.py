"""`--platform firmware`: the simulated robot whose motor board is real firmware, byte by byte."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable
from pathlib import Path
from unittest.mock import ANY

import pytest

from agribot.app.mission_file import read_mission
from agribot.app.rerun import compare_passes, read_pass, rerun
from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.app.whole_job import read_job
from agribot.core import config
from agribot.core.facts import (
    BatteryEmpty,
    BoardHoldsStop,
    BoardHung,
    BoardStopped,
    ButtonPressed,
    ClockJumped,
    ContactorSilent,
    Fact,
    InputSilent,
    LineNoisy,
    MotorsReportFault,
    SensorSilent,
    Touched,
    WheelsReversed,
    WheelsWrong,
)
from agribot.core.messages import ClearStop, GnssQuality, TickRecord, Visit, Who
from agribot.record import run_files
from agribot.record.events import read_events
from tests import machine, nightly
from tests.finding import find, holds

SETTINGS = ["perception.enabled=false", "seed=3"]
M_PER_DEG = 111_320.0
PLACES = ((-2.0, 1.5), (-1.0, 2.5))  # from the mark of the farm: ahead, then to the right


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine.require("simavr")
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path / "home"))
    for write in ("write_page", "write_map"):  # a third of each drive, and looked at elsewhere
        monkeypatch.setattr(run_files, write, lambda *_: None)


def drive(
    out: Path, platform: str, seconds: float, *more: str,
    meddle: Callable[[SimulatedRun, TickRecord], None] = lambda run, record: None,
) -> tuple[list[TickRecord], tuple[float, float]]:  # fmt: skip
    """Visit PLACES for this time; return the ticks and the robot's true position at the end."""
    settings = config.load(
        "farm", [*SETTINGS, f"platform={platform}", f"duration_s={seconds}", *more]
    )
    with simulate(settings, out) as run:
        run.inbox.post(Visit(places_map_m=PLACES), Who("Ann"))
        ticks = []
        for record in run.ticks():
            ticks.append(record)
            meddle(run, record)
        truth = run.truth()
        run.finish()
    return ticks, (truth.x_map_m, truth.y_map_m)


def decisions(out: Path) -> list[str]:
    """What the robot decided and reported, in order, without numbers."""
    events = [json.loads(line) for line in (out / "events.jsonl").read_text().splitlines()]
    kinds = {"mission", "gate", "stop", "hold", "resume", "ready"}
    return ["".join(c for c in f"{e['kind']} {e['reason']}" if not c.isdigit())
            for e in events if e["kind"] in kinds]  # fmt: skip


def test_the_same_mission_through_bytes_and_firmware_is_decided_as_on_the_simulator(
    tmp_path: Path,
) -> None:
    by_sim, sim_end = drive(tmp_path / "sim", "sim", 16.0)
    by_bytes, bytes_end = drive(tmp_path / "bytes", "firmware", 16.0)
    assert decisions(tmp_path / "bytes") == decisions(tmp_path / "sim")
    assert math.dist(sim_end, bytes_end) < 0.05
    assert by_bytes[-1].status.waypoints_reached == by_sim[-1].status.waypoints_reached == 2
    told = [tick for tick in by_bytes if tick.batch.board]
    assert len(told) == len(by_bytes)
    samples = sum(len(tick.batch.wheels) for tick in by_bytes)
    assert samples == pytest.approx(2 * len(by_bytes), abs=3), "100 Hz in ticks of 50 Hz"
    # Currents of the board and torques of the simulator's own are those of the same ground.
    sim_nm, bytes_nm = measure_drag(by_sim), measure_drag(by_bytes)
    assert bytes_nm == pytest.approx(sim_nm, rel=0.3)


def measure_drag(ticks: list[TickRecord]) -> float:
    """Mean torque of all wheels while the robot drives at an even speed."""
    cruise = [
        t
        for t in ticks
        if t.command.drive.v_mps > 0.38 and abs(t.command.drive.yaw_rate_radps) < 0.1
    ]
    efforts = [w.effort_nm for t in cruise for w in t.batch.wheels]
    assert len(efforts) > 100 and None not in efforts
    return sum(sum(effort or ()) for effort in efforts) / len(efforts)


def test_a_run_on_firmware_repeats_bit_by_bit_and_so_does_its_replay(tmp_path: Path) -> None:
    once, end = drive(tmp_path / "one", "firmware", 3.5)
    again, end_again = drive(tmp_path / "two", "firmware", 3.5)
    assert end == end_again
    assert [t.command for t in once] == [t.command for t in again]
    assert [t.batch.wheels for t in once] == [t.batch.wheels for t in again]
    assert max(t.command.drive.v_mps for t in once) > 0.3
    path = tmp_path / "one" / "run.mcap"
    before = read_pass(path)
    replayed, _ = rerun(path, config.load("farm", SETTINGS))
    assert compare_passes(before, replayed).first is None


def test_a_touch_passes_through_contact_and_firmware_and_stops_the_robot(tmp_path: Path) -> None:
    ticks, _ = drive(tmp_path / "run", "firmware", 6.0, "faults=bumper.contact@4")
    (first,) = [t for t in ticks if t.batch.bumper][:1]
    assert 4.0 <= first.batch.t_s < 4.1
    assert find(ticks[-1].status.stopped_fact, Touched).end == "front"
    assert ticks[-1].batch.board[-1].stop == BoardStopped(("bumper",))
    assert ticks[-1].batch.wheels[-1].speed_radps == pytest.approx((0.0,) * 4, abs=0.1)


def test_a_mission_that_was_cut_off_in_a_stop_goes_on_stopped_until_a_person_clears_it(
    tmp_path: Path,
) -> None:
    drive(tmp_path / "run", "firmware", 3.5, "faults=button.pressed@3")
    saved = read_mission(tmp_path / "run")
    assert saved.stopped_fact == ButtonPressed()
    settings = config.load("farm", [*SETTINGS, "platform=firmware", "duration_s=2"])
    with simulate(settings, tmp_path / "again", saved, read_job(tmp_path / "run", saved)) as run:
        for record in run.ticks():
            if record.batch.t_s < 1.5:
                assert record.status.stopped_fact == ButtonPressed()
                assert record.command.drive.v_mps == record.command.drive.yaw_rate_radps == 0.0
                assert record.batch.board[-1].stop or record.batch.t_s < 0.5
            if round(record.batch.t_s, 2) == 1.5:
                run.inbox.post(ClearStop(), Who("Ann"))
    assert not record.status.stopped and not record.batch.board[-1].stop


def test_a_board_that_hangs_is_reset_by_its_watchdog_and_the_robot_stands_until_cleared(
    tmp_path: Path,
) -> None:
    def meddle(run: SimulatedRun, record: TickRecord) -> None:
        if record.batch.t_s == pytest.approx(4.0):
            run.platform._bench.hang()  # type: ignore[attr-defined]

    ticks, _ = drive(tmp_path / "run", "firmware", 6.0, meddle=meddle)
    assert ticks[-1].status.stopped
    assert ticks[-1].batch.board[-1].fault == BoardHung()
    still = [t for t in ticks if t.batch.t_s > 5.0]
    assert all(t.command.drive.v_mps == 0.0 for t in still)
    speeds = [abs(speed) for t in still for w in t.batch.wheels for speed in w.speed_radps]
    assert max(speeds) < 0.1


def test_a_program_that_stands_still_leaves_the_wheels_to_the_boards_watchdog(
    tmp_path: Path,
) -> None:
    ticks, _ = drive(tmp_path / "run", "firmware", 5.5, "faults=program.stalled=2@3")
    (back,) = [t for t in ticks if t.batch.t_s > 2.9 and len(t.batch.wheels) > 150]
    before = [t for t in ticks if t.batch.t_s < back.batch.t_s][-1]
    assert before.command.drive.v_mps > 0.2
    speeds = [max(map(abs, sample.speed_radps)) for sample in back.batch.wheels]
    since_s = [sample.t_s - before.batch.t_s for sample in back.batch.wheels]
    assert max(t_s for t_s, speed in zip(since_s, speeds, strict=True) if speed > 0.2) < 0.8
    assert find(ticks[-1].status.stopped_fact, ClockJumped).off_s == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize(
    ("fault", "found"),
    [
        ("motor.runaway@3", WheelsWrong(ANY, "fast", ANY, ANY)),
        ("board.silent@3", SensorSilent("wheels", ANY, 0.3, ANY)),
        ("inputs.silent@3", InputSilent("red button", ANY, 0.3)),
        ("contactor.silent@3", ContactorSilent(ANY, 0.3)),
        pytest.param(
            "button.pressed@3",
            ButtonPressed(),
            marks=nightly.by_day(
                "test_a_mission_that_was_cut_off_in_a_stop_goes_on_stopped_until_a_person_clears_it"
            ),
        ),
        pytest.param(
            "wheels.stuck=left_wheel_F@3",
            WheelsWrong(("left_wheel_F",), "stand", ANY, ANY),
            marks=nightly.by_day(
                "tests/firmware/test_motor_board.py"
                "::test_a_wheel_that_does_not_turn_stops_all_and_is_named"
            ),
        ),
        pytest.param(
            "wheels.reversed@3",
            WheelsReversed(ANY),
            marks=nightly.by_day(
                "tests/firmware/test_motor_board.py::test_encoders_that_turn_round_under_way"
                "_stop_all_wheels_within_a_fifth_of_a_second"
            ),
        ),
        pytest.param(
            "imu.unplugged@3",
            SensorSilent("imu", ANY, ANY, ANY),
            marks=nightly.by_day(
                "tests/firmware/test_motor_board.py"
                "::test_an_unplugged_imu_is_told_costs_no_state_and_comes_back"
            ),
        ),
        pytest.param(
            "board.hung@3",
            BoardHung(),
            marks=nightly.by_day(
                "test_a_board_that_hangs_is_reset_by_its_watchdog_and_the_robot_stands_until_cleared"
            ),
        ),
    ],
)
def test_faults_at_and_below_the_board_stop_the_robot_and_are_named(
    fault: str, found: Fact, tmp_path: Path
) -> None:
    ticks, _ = drive(tmp_path / "run", "firmware", 4.5, f"faults={fault}")
    before = [t for t in ticks if t.batch.t_s < 3.0]
    assert before[-1].command.drive.v_mps > 0.2 and not before[-1].status.stopped
    status = ticks[-1].status
    assert holds(status.stopped_fact, found) or holds(status.gate.warning_fact, found), status
    (first,) = [t.batch.t_s for t in ticks if t.status.stopped][:1]
    assert first - 3.0 < 1.0


@pytest.mark.parametrize(
    ("fault", "found"),
    [
        ("motor.dead=left_wheel_F@5", MotorsReportFault(("left_wheel_F",))),
        pytest.param(
            "motor.weak=0.005@5",
            WheelsWrong(("right_wheel_F",), ANY, ANY, ANY),
            marks=nightly.by_day(
                "tests/drivers/test_motor_watch.py"
                "::test_a_motor_that_lets_little_through_is_named_within_half_a_second"
            ),
        ),
    ],
)
def test_a_motor_that_does_not_work_is_named_within_a_second_of_a_turn(
    fault: str, found: Fact, tmp_path: Path
) -> None:
    ticks, _ = drive(tmp_path / "run", "firmware", 8.0, f"faults={fault}")
    (first,) = [t for t in ticks if t.status.stopped][:1]
    assert holds(first.status.stopped_fact, found)
    turning = [t for t in ticks if t.batch.t_s > 5.0 and t.command.drive.yaw_rate_radps < -0.3]
    assert first.batch.t_s - turning[0].batch.t_s < 1.0


def list_noise(ticks: list[TickRecord], device: str) -> list[tuple[float, int]]:
    """Reports of a noisy line: their times, and how many messages were broken."""
    notes = [note for tick in ticks for note in tick.batch.notes]
    return [(note.t_s, note.fact.count) for note in notes
            if isinstance(note.fact, LineNoisy) and note.fact.device == device]  # fmt: skip


@nightly.by_day(
    "tests/autonomy/control/test_battery_watch.py"
    "::test_an_empty_battery_stops_the_mission_and_lets_a_hand_drive_after_a_clear",
    "tests/firmware/test_motor_board.py::test_an_empty_battery_stops_and_cannot_be_cleared_away",
)
def test_an_empty_battery_stops_the_robot_and_then_its_board_cuts_the_motors_off(
    tmp_path: Path,
) -> None:
    ticks, _ = drive(tmp_path / "run", "firmware", 15.0, "faults=battery.empty@2")
    volts = [battery.voltage_v for tick in ticks for battery in tick.batch.battery]
    assert volts[10] > 24.5 and volts[-1] < 18.0
    (stopped_s,) = [t.batch.t_s for t in ticks if t.status.stopped][:1]
    (cut_s,) = [t.batch.t_s for t in ticks if t.batch.board and t.batch.board[-1].stop
                and t.batch.t_s > 2.0][:1]  # fmt: skip
    assert 7.0 <= stopped_s < 8.5 and holds(ticks[-1].status.stopped_fact, BatteryEmpty)
    assert cut_s > stopped_s
    assert ticks[-1].batch.board[-1].stop == BoardStopped(("battery",))


@nightly.by_day(
    "tests/autonomy/control/test_battery_watch.py"
    "::test_an_empty_battery_stops_the_mission_and_lets_a_hand_drive_after_a_clear",
    "tests/firmware/test_motor_board.py::test_an_empty_battery_stops_and_cannot_be_cleared_away",
)
def test_a_board_cuts_the_motors_off_by_itself_where_nobody_else_looks_at_the_battery(
    tmp_path: Path,
) -> None:
    ticks, _ = drive(
        tmp_path / "run", "firmware", 15.0, "faults=battery.empty@2",
        "safety.empty_charge_ratio=0", "safety.low_charge_ratio=0", "mission.speed_mps=0.15",
    )  # fmt: skip
    assert holds(ticks[-1].status.stopped_fact, BoardHoldsStop(cause=BoardStopped(("battery",))))
    assert ticks[-1].batch.wheels[-1].speed_radps == pytest.approx((0.0,) * 4, abs=0.1)


@nightly.one_by_one("late_s", [0.25, 0.1], in_suite=1)
def test_readings_of_the_imu_that_wait_on_the_line_keep_their_times_and_are_reported(
    late_s: float, tmp_path: Path
) -> None:
    ticks, _ = drive(tmp_path / "run", "firmware", 4.5, f"faults=imu.late={late_s}@2")
    ages_s = [t.batch.t_s - t.batch.imu[-1].t_s for t in ticks if t.batch.imu]
    assert min(ages_s[:90]) < 0.02
    assert ages_s[-1] == pytest.approx(late_s, abs=0.02), "also when seconds have passed"
    events = read_events(tmp_path / "run" / "events.jsonl")
    told_s = [event.numbers["late_s"] for event in events if event.code == "imu_late"]
    assert told_s[0] == pytest.approx(late_s, abs=0.005)
    assert not ticks[-1].status.stopped


def test_noise_on_the_line_costs_frames_and_makes_no_false_number(tmp_path: Path) -> None:
    ticks, _ = drive(tmp_path / "run", "firmware", 4.5, "faults=link.noise=0.05@2")
    (first_s, count), *_ = list_noise(ticks, "board")
    assert 2.0 < first_s < 4.0 and count == 3
    assert not ticks[-1].status.stopped
    samples = [w for t in ticks for w in t.batch.wheels]
    assert 0.85 < len(samples) / (2 * len(ticks)) < 0.99
    assert max(abs(speed) for w in samples for speed in w.speed_radps) < 12.0
    assert ticks[-1].command.drive.v_mps > 0.2


def test_fixes_come_as_bytes_at_the_epochs_of_the_receiver_with_their_carrier_and_velocity(
    tmp_path: Path,
) -> None:
    by_sim, _ = drive(tmp_path / "sim", "sim", 2.0)
    by_bytes, _ = drive(tmp_path / "bytes", "firmware", 2.0)
    meant = [fix for tick in by_sim for fix in tick.batch.gnss]
    told = [fix for tick in by_bytes for fix in tick.batch.gnss]
    assert len(told) == len(meant) > 15
    assert [fix.t_s for fix in told] == pytest.approx([fix.t_s for fix in meant], abs=1e-6)
    assert {fix.quality for fix in told} == {GnssQuality.RTK_FIXED}
    assert {fix.velocity_std_mps for fix in told} == {meant[0].velocity_std_mps}
    assert {round(fix.pos_std_m, 3) for fix in told} == {meant[0].pos_std_m}
    # Both robots stand until then: what differs is what bytes cannot carry.
    for one, other in zip(told[1:8], meant[1:8], strict=True):
        assert one.lat_deg == pytest.approx(other.lat_deg, abs=6e-10)
        assert one.lat_deg != other.lat_deg
        assert one.velocity_mps == pytest.approx(other.velocity_mps, abs=6e-4)


@nightly.by_day(
    "test_noise_on_the_line_costs_frames_and_makes_no_false_number",
    "tests/drivers/test_ubx_writer.py"
    "::test_one_false_bit_costs_one_epoch_its_millimetres_at_most_and_makes_no_other_place",
    "tests/drivers/test_ubx_writer.py"
    "::test_many_broken_messages_are_told_once_and_that_they_are_over_once",
)
def test_noise_on_the_line_of_the_receiver_costs_fixes_moves_none_and_is_told(
    tmp_path: Path,
) -> None:
    ticks, _ = drive(tmp_path / "run", "firmware", 6.0, "faults=link.noise=0.2@2")
    fixes = [fix for tick in ticks for fix in tick.batch.gnss]
    assert 0.5 < len(fixes) / 59 < 0.98
    steps_m = [
        M_PER_DEG * math.hypot(b.lat_deg - a.lat_deg, b.lon_deg - a.lon_deg)
        for a, b in itertools.pairwise(fixes)
    ]
    assert max(steps_m) < 0.3, "no false bit becomes a place"
    assert 3 in [count for t_s, count in list_noise(ticks, "receiver") if t_s > 2.0]


def test_the_first_readings_of_the_compass_are_of_the_world(tmp_path: Path) -> None:
    """The chip on the bench shows a field of its own, until it gets the world's."""
    ticks, _ = drive(tmp_path, "firmware", 1.5)
    fields = [sample.field_t for record in ticks for sample in record.batch.mag]
    courses = [math.atan2(field[1], field[0]) for field in fields]
    assert len(courses) > 10
    assert max(courses) - min(courses) < math.radians(30.0)
