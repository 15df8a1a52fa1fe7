"""The motor board's own program, run instruction by instruction: it drives, and it stops."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from agribot.description.loader import load_robot
from agribot.drivers.board.agribot_board import AgribotBoard
from agribot.drivers.board.board_codec import FORMATS, stuff
from agribot.drivers.board.board_kinds import open_board
from agribot.drivers.board.board_protocol import (
    ACCEL_RANGE_G,
    COMMAND_TIMEOUT_S,
    GRAVITY_MPS2,
    GYRO_RANGE_DPS,
    LAYOUT,
    MAG_LSB_T,
    TELEMETRY_HZ,
    AckResult,
    AskVersion,
    BoardAck,
    BoardFlag,
    BoardImu,
    BoardKind,
    BoardState,
    BoardVersion,
    ClearLatch,
    StopCause,
)
from firmware.bench.avr_bench import AvrBench
from firmware.build import PREBUILT
from tests import nightly
from tests.firmware.board_on_bench import (
    COUNTS_PER_RAD,
    MAX_ACCEL_RADPS2,
    MAX_RADPS,
    REST,
    STEP_S,
    BoardOnBench,
    Speeds,
    command,
    configure,
)

MakeBoard = Callable[..., BoardOnBench]
FORWARD: Speeds = (4.0, 4.0, 4.0, 4.0)


def drive(board: BoardOnBench, tool: int = 0) -> None:
    board.arm()
    board.run(0.6, FORWARD, tool)
    assert board.is_moving


def assert_stopped(board: BoardOnBench, cause: StopCause) -> None:
    """The stop is latched for this, and commands do not end it."""
    board.run(0.3, FORWARD, tool=0xFF)
    assert not board.is_moving and board.bench.tool == 0 and not board.bench.is_lamp_on
    assert board.state.flags & BoardFlag.STOP_LATCHED
    assert board.state.stop_causes == cause


def test_a_hundred_states_come_every_second_and_none_is_lost(board: BoardOnBench) -> None:
    board.arm()
    board.received.clear()
    board.run(2.0, (3.0, -3.0, 8.0, 0.0))
    states = board.get_all(BoardState)
    assert len(states) == pytest.approx(2 * TELEMETRY_HZ, abs=1)
    assert len(board.get_all(BoardImu)) == pytest.approx(2 * TELEMETRY_HZ, abs=1)
    assert (board.decoder.bad, board.decoder.lost, board.decoder.unknown) == (0, 0, 0)
    period_us = np.diff([state.t_us for state in states])
    assert np.abs(period_us - 1e6 / TELEMETRY_HZ).max() < 300


def test_it_says_which_program_and_which_table_it_has(board: BoardOnBench) -> None:
    board.run(0.05)
    board.send(AskVersion())
    board.run(0.02)
    (version,) = board.get_all(BoardVersion)
    assert version.layout == LAYOUT and version.board is BoardKind.MOTOR


def test_every_edge_of_every_encoder_is_counted(board: BoardOnBench) -> None:
    board.arm()
    board.run(1.5, (12.0, -7.0, 0.3, 2.0))
    board.is_blocked[:] = True
    board.run(0.05)
    assert board.state.counts == board.bench.counts
    assert board.state.encoder_errors == 0


@pytest.mark.parametrize("speed_radps", [1e-6, 1e-12, -1e-300])
def test_wheels_that_all_but_stand_show_no_edge(board: BoardOnBench, speed_radps: float) -> None:
    before = board.bench.counts
    board.bench.advance(0.5, (speed_radps,) * 4)
    assert board.bench.counts == before


def test_encoders_of_ten_thousand_counts_a_turn_are_counted_at_full_speed(
    board: BoardOnBench,
) -> None:
    fast_countps = 26_000  # 10,240 counts a turn at 16 rad/s
    speed_radps = fast_countps / COUNTS_PER_RAD
    board.run(0.05)
    for _ in range(40):
        board.bench.advance(0.01, (speed_radps, -speed_radps, speed_radps, -0.999 * speed_radps))
    board.is_blocked[:] = True
    board.run(0.05)
    assert min(map(abs, board.bench.counts)) > 10_000
    assert board.state.counts == board.bench.counts
    assert board.state.encoder_errors == 0
    assert (board.decoder.lost, board.decoder.bad) == (0, 0)
    assert len(board.get_all(BoardState)) == pytest.approx(0.5 * TELEMETRY_HZ, abs=1)


def test_inertia_and_field_arrive_to_one_count(board: BoardOnBench) -> None:
    accel, gyro, field = (0.5, -1.25, 9.6), (0.02, -0.5, 1.5), (21e-6, -4.5e-6, -40e-6)
    board.bench.set_imu(accel, gyro, 33.0)
    board.bench.set_mag(field)
    board.run(0.2)
    imu = board.get_all(BoardImu)[-1]
    assert imu.accel_mps2 == pytest.approx(accel, abs=ACCEL_RANGE_G * GRAVITY_MPS2 / 32768)
    assert imu.gyro_radps == pytest.approx(gyro, abs=math.radians(GYRO_RANGE_DPS) / 32768)
    assert imu.mag_t == pytest.approx(field, abs=1.01 * MAG_LSB_T)
    assert imu.temperature_c == pytest.approx(33.0, abs=0.03)


def test_the_magnetometer_is_read_with_the_sensitivity_that_it_was_made_with(
    board: BoardOnBench,
) -> None:
    field = (21e-6, -4.5e-6, -40e-6)
    board.bench.set_mag(field, adjustment=(176, 170, 165))
    board.run(0.2)
    assert board.get_all(BoardImu)[-1].mag_t == pytest.approx(field, abs=2.01 * MAG_LSB_T)


def test_voltage_and_currents_are_told(board: BoardOnBench) -> None:
    board.bench.set_battery(22.2)
    board.bench.set_currents((1.0, -2.0, 0.0, 8.0))
    board.run(0.1)
    assert board.state.battery_v == pytest.approx(22.2, abs=0.08)
    assert board.state.current_a == pytest.approx((1.0, 2.0, 0.0, 8.0), abs=0.11)


@pytest.mark.parametrize(("lag_s", "gain"), [(0.02, 0.8), (0.1, 1.2), (0.3, 0.8), (0.3, 1.2)])
def test_wheels_reach_their_speed_and_overshoot_by_a_tenth_at_most(
    make_board: MakeBoard, lag_s: float, gain: float
) -> None:
    board = make_board(lag_s=lag_s, gain=gain)
    board.arm()
    speeds = (4.0, -2.0, 8.0, 1.0)
    board.run(2.0, speeds)
    share = np.array(board.history[-round(2.0 / STEP_S) :]) / speeds
    assert share.max() < 1.1
    assert share[-100:].mean(axis=0) == pytest.approx(1.0, abs=0.03)


def test_a_speed_beyond_the_limit_is_driven_at_the_limit(board: BoardOnBench) -> None:
    board.arm()
    board.run(2.5, (40.0, -40.0, 40.0, -40.0))
    assert np.abs(board.speed_radps) == pytest.approx(MAX_RADPS, rel=0.03)


def test_wheels_gain_and_lose_speed_no_faster_than_they_may(make_board: MakeBoard) -> None:
    board = make_board(lag_s=0.03)
    board.arm()
    board.run(1.5, (10.0, 10.0, -10.0, 10.0))
    board.run(1.5, (-10.0, -10.0, 10.0, -10.0))
    over_s = 0.1  # longer than a count lasts
    change = np.abs(np.diff(np.array(board.history)[:: round(over_s / STEP_S)], axis=0))
    assert change.max() / over_s == pytest.approx(MAX_ACCEL_RADPS2, rel=0.15)


def test_flips_turn_motor_and_encoder_round(make_board: MakeBoard) -> None:
    board = make_board()
    board.arm(configure(motor_flips=0b0010))
    board.send(command((2.0, 0.0, 2.0, 2.0)))
    board.run(0.1)
    assert board.state.duty_ratio[0] > 0.0
    right = make_board()
    right.arm(configure(motor_flips=0b1010, encoder_flips=0b1010))
    right.run(1.0, (2.0, 2.0, 2.0, 2.0))
    assert right.speed_radps * (1, -1, 1, -1) == pytest.approx(2.0, rel=0.1)
    assert all(speed > 0 for speed in right.state.speed_countps)


def test_without_a_configuration_and_a_command_of_no_speed_nothing_turns(
    board: BoardOnBench,
) -> None:
    board.run(0.3, FORWARD)
    assert board.state.stop_causes == StopCause.BEGAN
    assert board.ask(ClearLatch()) is AckResult.DONE
    board.run(0.3, REST)
    board.run(0.3, FORWARD)
    assert not board.is_moving and board.state.flags & BoardFlag.NOT_CONFIGURED
    assert board.ask(configure()) is AckResult.DONE
    board.run(0.3, FORWARD)
    assert not board.is_moving and board.state.flags & BoardFlag.WAITS_FOR_ZERO
    board.run(0.1, REST)
    board.run(0.3, FORWARD)
    assert board.is_moving


def test_where_the_link_is_lost_motors_and_tool_are_off_in_time(board: BoardOnBench) -> None:
    drive(board, tool=0b101)
    assert board.bench.tool == 0b101 and board.bench.is_lamp_on
    board.send(command(FORWARD, tool=0b101))
    lost_s = board.bench.t_s
    while board.is_moving or board.bench.tool:
        board.run(STEP_S)
    assert 0.9 * COMMAND_TIMEOUT_S < board.bench.t_s - lost_s <= COMMAND_TIMEOUT_S
    board.run(0.1)
    assert board.state.flags & BoardFlag.NO_COMMAND and board.state.tool == 0
    board.run(0.3, FORWARD)
    assert board.is_moving, "a line that comes back is no latched stop"


def test_the_emergency_stop_acts_within_milliseconds_and_stays_latched(
    board: BoardOnBench,
) -> None:
    drive(board, tool=1)
    board.bench.set_estop(pressed=True)
    board.bench.advance(0.004, FORWARD)
    assert not board.is_moving and board.bench.tool == 0
    board.run(0.1, FORWARD)
    assert board.state.flags & BoardFlag.ESTOP_PRESSED
    assert board.ask(ClearLatch()) is AckResult.STILL_PRESSED
    board.bench.set_estop(pressed=False)
    assert_stopped(board, StopCause.ESTOP)
    assert board.ask(ClearLatch(key=1)) is AckResult.BAD_VALUE
    assert_stopped(board, StopCause.ESTOP)
    assert board.ask(ClearLatch()) is AckResult.DONE
    board.run(0.2, FORWARD)
    assert not board.is_moving, "the speed that was wanted before must not come back by itself"
    board.run(0.1, REST)
    board.run(0.2, FORWARD)
    assert board.is_moving


def test_a_spark_on_the_wire_of_the_emergency_stop_is_none(board: BoardOnBench) -> None:
    drive(board)
    for _ in range(20):
        board.bench.set_estop(pressed=True)
        board.bench.advance(0.0003, FORWARD)
        board.bench.set_estop(pressed=False)
        board.bench.advance(0.0047, FORWARD)
    board.run(0.05)
    assert board.is_moving and not board.state.stop_causes


def test_the_bumper_stops_once_and_lets_the_robot_back_off(board: BoardOnBench) -> None:
    drive(board)
    board.bench.set_bumper(pressed=True)
    assert_stopped(board, StopCause.BUMPER)
    assert board.ask(ClearLatch()) is AckResult.DONE
    board.run(0.1, REST)
    board.run(0.5, (-2.0, -2.0, -2.0, -2.0))
    assert board.is_moving and board.state.flags & BoardFlag.BUMPER_PRESSED
    board.bench.set_bumper(pressed=False)
    board.run(0.1, REST)
    board.bench.set_bumper(pressed=True)
    assert_stopped(board, StopCause.BUMPER)


def test_an_empty_battery_stops_and_cannot_be_cleared_away(board: BoardOnBench) -> None:
    drive(board)
    board.bench.set_battery(17.5)
    board.run(0.5, FORWARD)
    assert board.is_moving, "a load may pull the voltage down for a moment"
    board.run(0.7, FORWARD)
    assert_stopped(board, StopCause.BATTERY)
    assert board.ask(ClearLatch()) is AckResult.STILL_LOW
    board.bench.set_battery(23.0)
    assert_stopped(board, StopCause.BATTERY)
    assert board.ask(ClearLatch()) is AckResult.DONE


def test_a_current_over_the_limit_stops_and_names_its_wheel(board: BoardOnBench) -> None:
    drive(board)
    board.bench.set_currents((1.0, 1.0, 14.0, 1.0))
    assert_stopped(board, StopCause.MOTOR)
    assert board.state.motor_faults == 0b0100
    assert board.state.flags & BoardFlag.MOTOR_FAULT


def test_a_wheel_that_does_not_turn_stops_all_and_is_named(board: BoardOnBench) -> None:
    drive(board)
    board.is_blocked[1] = True
    board.run(2.0, FORWARD)
    assert_stopped(board, StopCause.MOTOR)
    assert board.state.motor_faults == 0b0010_0000


@pytest.mark.parametrize("part", ["encoder", "motor"])
@pytest.mark.parametrize("lag_s", [0.02, 0.1, 0.3])  # in the air, and under a heavy robot
def test_a_wheel_that_is_wired_the_wrong_way_round_is_off_and_named_before_it_runs_away(
    make_board: MakeBoard, part: str, lag_s: float
) -> None:
    board = make_board(lag_s=lag_s)
    board.arm()
    sign = board.encoder_sign if part == "encoder" else board.motor_sign
    sign[2] = -1.0
    board.run(0.3, FORWARD)
    assert not board.is_moving
    assert np.abs(board.history).max() < 1.2 * max(FORWARD)
    assert_stopped(board, StopCause.REVERSED)
    assert board.state.motor_faults == 0b0100_0000
    sign[2] = 1.0
    assert board.ask(ClearLatch()) is AckResult.DONE
    board.run(0.05, REST)
    board.run(0.6, FORWARD)
    assert board.is_moving and not board.state.motor_faults


@pytest.mark.parametrize("speed", [2.0, 4.0, 12.0])
def test_encoders_that_turn_round_under_way_stop_all_wheels_within_a_fifth_of_a_second(
    board: BoardOnBench, speed: float
) -> None:
    board.arm()
    board.run(1.5, (speed,) * 4)
    board.encoder_sign[:] = -1.0
    board.run(0.2, (speed,) * 4)
    assert not board.is_moving
    assert_stopped(board, StopCause.REVERSED)


@nightly.one_by_one("lag_s", [0.3, 0.02, 0.1], in_suite=2)
@nightly.one_by_one("speed", [MAX_RADPS, 2.0, 8.0], in_suite=1)
def test_a_robot_that_changes_its_direction_at_once_is_no_wheel_the_wrong_way_round(
    make_board: MakeBoard, lag_s: float, speed: float
) -> None:
    board = make_board(lag_s=lag_s)
    board.arm()
    for _ in range(3):
        board.run(0.7, (speed, -speed, speed, -speed))
        board.run(0.7, (-speed, speed, -speed, speed))
    assert not board.state.stop_causes and board.is_moving


@nightly.one_by_one("push_radps2", [-40.0, 40.0, -20.0, 20.0], in_suite=2)  # of 0.37 g at most
def test_neither_slopes_nor_people_who_push_are_a_wheel_the_wrong_way_round(
    board: BoardOnBench, push_radps2: float
) -> None:
    """It rolls off before it drives, starts upwards and downwards, stands, and is shoved."""
    board.arm()
    board.push_radps2 = push_radps2
    board.run(0.6)
    board.run(0.1, REST)
    for speeds in ((1.0,) * 4, REST, (-1.0,) * 4, FORWARD):
        board.run(1.0, speeds)
    for push in (push_radps2, -push_radps2, 0.0) * 2:
        board.push_radps2 = push
        board.run(0.3, REST)
        board.run(0.3, (2.0,) * 4)
    assert not board.state.stop_causes


def test_an_unplugged_imu_is_told_costs_no_state_and_comes_back(board: BoardOnBench) -> None:
    board.run(0.5)
    board.bench.plug_imu(is_there=False)
    board.received.clear()
    board.run(0.5)
    assert len(board.get_all(BoardState)) == pytest.approx(0.5 * TELEMETRY_HZ, abs=1)
    assert len(board.get_all(BoardImu)) <= 2, "old numbers must not go on"
    assert board.state.flags & BoardFlag.IMU_FAULT
    board.bench.plug_imu(is_there=True)
    board.bench.set_imu((0.0, 0.0, GRAVITY_MPS2), (0.0, 0.0, 1.0))
    board.bench.set_mag((3e-5, 0.0, 0.0))
    board.received.clear()
    board.run(0.8)
    assert not board.state.flags & (BoardFlag.IMU_FAULT | BoardFlag.MAG_FAULT)
    imu = board.get_all(BoardImu)[-1]
    assert imu.gyro_radps[2] == pytest.approx(1.0, abs=1e-3), "with the ranges of the protocol"
    assert board.decoder.lost == 0


@pytest.mark.parametrize(("clocks", "is_freed"), [(1, True), (9, True), (10_000, False)])
def test_a_chip_that_holds_the_bus_is_told_costs_no_state_and_is_clocked_until_it_lets_go(
    clocks: int, is_freed: bool, board: BoardOnBench
) -> None:
    board.run(0.5)
    board.bench.hold_sda(clocks)
    board.received.clear()
    board.run(0.8)
    states = board.get_all(BoardState)
    assert len(states) == pytest.approx(0.8 * TELEMETRY_HZ, abs=1) and board.bench.resets == 0
    assert any(state.flags & BoardFlag.IMU_FAULT for state in states)
    fault = board.state.flags & (BoardFlag.IMU_FAULT | BoardFlag.MAG_FAULT)
    assert (not fault) is is_freed
    assert (len(board.get_all(BoardImu)) > 10) is is_freed


def test_a_program_that_hangs_is_reset_stops_and_says_so(board: BoardOnBench) -> None:
    drive(board, tool=1)
    board.bench.hang()
    hung_s = board.bench.t_s
    while not board.bench.resets:
        board.bench.advance(0.01, FORWARD)
    assert board.bench.t_s - hung_s < 0.15
    board.bench.advance(0.01, FORWARD)
    assert not board.is_moving and board.bench.tool == 0
    board.received.clear()
    board.run(0.5, FORWARD)
    assert not board.is_moving
    wanted = BoardFlag.WATCHDOG_RESET | BoardFlag.STOP_LATCHED | BoardFlag.NOT_CONFIGURED
    assert board.state.flags & wanted == wanted
    board.arm()
    board.run(0.3, FORWARD)
    assert board.is_moving


def test_behind_the_bootloader_of_a_mega_it_tells_a_reset_by_its_watchdog_from_one_by_its_button(
    bench_library: ctypes.CDLL, bootloader: Path
) -> None:
    bench = AvrBench(bench_library, PREBUILT / "motor_board.hex", bootloader=bootloader)
    board = BoardOnBench(bench)
    board.run(1.5)
    for harm, has_hung in ((bench.reset, False), (bench.hang, True), (bench.reset, False)):
        harm()
        board.received.clear()
        board.run(1.5)
        assert (BoardFlag.WATCHDOG_RESET in board.state.flags) is has_hung
    bench.close()


@pytest.mark.parametrize("options", ["", "?full_speed_radps=30", "?kp=2&ti_s=0.02"])
def test_the_board_takes_what_the_driver_configures_for_the_robot_that_is_described(
    options: str, board: BoardOnBench
) -> None:
    motors = {"counts_per_turn": 10240.0, "full_speed_radps": 40.0}
    driver = open_board(f"tcp://localhost:1{options}", load_robot(), motors).board
    assert isinstance(driver, AgribotBoard)
    board.arm(driver._config)


@nightly.all_or_first("blocks", range(1000), 60, "kB")
def test_no_bytes_on_the_line_move_the_robot_or_stop_its_states(
    board: BoardOnBench, blocks: tuple[int, ...]
) -> None:
    rng = np.random.default_rng(1)
    board.run(0.05)
    for block in blocks:
        data = rng.bytes(1000) if block % 2 else make_wrong_frames(rng)
        board.bench.send(data)
        while board.bench.waiting:
            board.bench.advance(0.02, REST)
            assert not board.is_moving
            board.decoder.feed(board.bench.receive())
    board.run(0.1)
    assert board.bench.resets == 0
    lost, bad = board.decoder.lost, board.decoder.bad
    assert bad == 0
    board.bench.send(b"\0")
    board.arm()
    assert (board.decoder.lost, board.decoder.bad) == (lost, bad)
    assert board.state.bad_frames > 0


def make_wrong_frames(rng: np.random.Generator) -> bytes:
    """Make a kilobyte of frames that are whole, with any type, length and content."""
    from binascii import crc_hqx

    out = b""
    types = [*FORMATS, 0x00, 0x14, 0x7F, 0xFF]
    while len(out) < 1000:
        body = bytes([int(rng.choice(types))]) + rng.bytes(int(rng.integers(1, 90)))
        if body[0] == ClearLatch.number:
            body = body[:2] + b"\x01\x02"
        out += stuff(body + crc_hqx(body, 0).to_bytes(2, "little")) + b"\0"
    return out


def test_a_frame_of_an_unknown_type_or_a_wrong_length_is_answered(board: BoardOnBench) -> None:
    from binascii import crc_hqx

    board.run(0.05)
    for body in (b"\x7f\x05", b"\x10\x06\x01"):
        board.bench.send(stuff(body + crc_hqx(body, 0).to_bytes(2, "little")) + b"\0")
    board.run(0.05)
    assert board.get_all(BoardAck) == [
        BoardAck(of_type=0x7F, of_seq=5, result=AckResult.UNKNOWN_TYPE),
        BoardAck(of_type=0x10, of_seq=6, result=AckResult.BAD_LENGTH),
    ]


def test_a_configuration_that_makes_no_sense_is_refused(board: BoardOnBench) -> None:
    board.run(0.05)
    assert board.ask(configure(full_speed_countps=0)) is AckResult.BAD_VALUE
    assert board.ask(configure(ti_s=0.001)) is AckResult.BAD_VALUE
    assert board.ask(configure(max_accel_countps2=0)) is AckResult.BAD_VALUE


def test_the_same_inputs_give_the_same_bytes(make_board: MakeBoard) -> None:
    said = []
    for _ in range(2):
        board = make_board()
        board.arm()
        board.run(0.5, (3.0, 1.0, -5.0, 2.0))
        said.append(board.received)
    assert said[0] == said[1]
