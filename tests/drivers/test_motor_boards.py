"""Motor boards as codecs: wheel speeds out, what they report in, for three kinds of boards."""

from __future__ import annotations

import math
import struct
from binascii import crc_hqx
from itertools import pairwise

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agribot.core.errors import ConfigError
from agribot.core.facts import (
    BoardHung,
    BoardStopped,
    BoardUnconfigured,
    ControllerFault,
    WheelsReversed,
)
from agribot.core.messages import WHEEL_NAMES, ImplementCommand
from agribot.description.loader import load_robot
from agribot.drivers.board import board_kinds, vesc_packets
from agribot.drivers.board.agribot_board import AgribotBoard
from agribot.drivers.board.board_codec import encode
from agribot.drivers.board.board_link import BoardLink
from agribot.drivers.board.board_protocol import AckResult, BoardAck, BoardConfig, StopCause
from agribot.drivers.board.motor_board import BoardReport, CountsBroken, MotorBoard, StampedReport
from agribot.drivers.board.motor_watch import MotorWatch
from tests.drivers.board_emulator import BoardEmulator
from tests.drivers.esc_fakes import FakeVesc

ROBOT = load_robot()
STILL = ImplementCommand()
COUNTS_PER_TURN = ROBOT.drive.encoder_ticks_per_rev * ROBOT.drive.gear_ratio
MOTORS = {
    "counts_per_turn": COUNTS_PER_TURN, "full_speed_radps": 40.0, "pole_pairs": 7.0, "gear": 10.0
}  # fmt: skip


def open_board(options: str) -> MotorBoard:
    return board_kinds.open_board(f"tcp://localhost:1?{options}", ROBOT, MOTORS).board


class Bench:
    """A board and its driver without a line between them; `cut` is how long the pieces are."""

    def __init__(self, options: str = "board=agribot", cut: int = 7) -> None:
        self.driver, self.board, self._cut = open_board(options), BoardEmulator(), cut
        self.board.feed(self.driver.open())

    def run(self, seconds: float, speeds: tuple[float, float, float, float] = (0.0,) * 4,
            implement: ImplementCommand = STILL) -> list[StampedReport]:  # fmt: skip
        found = []
        for tick in range(round(seconds * 100)):
            if tick % 2 == 0:
                self.board.feed(self.driver.poll() + self.driver.drive(speeds, implement))
            said = self.board.advance()
            for k in range(0, len(said), self._cut):
                found += self.driver.feed(said[k : k + self._cut])
        return found

    def arm(self) -> Bench:
        self.run(0.1)
        self.board.feed(self.driver.clear_stop())
        self.run(0.1)
        return self


def last(reports: list[StampedReport]) -> BoardReport:
    return next(r.report for r in reversed(reports) if r.report.wheels is not None)


def test_wheels_turn_as_told_and_tell_how_they_turn() -> None:
    bench = Bench().arm()
    speeds = (3.0, -2.0, 4.0, 1.0)
    wheels = last(bench.run(2.0, speeds)).wheels
    assert wheels is not None
    assert wheels.speed_radps == pytest.approx(speeds, abs=math.tau / COUNTS_PER_TURN)
    turned = [a / w for a, w in zip(wheels.angle_rad, speeds, strict=True)]
    assert min(turned) > 1.0
    assert wheels.faults == ()


def test_a_board_that_was_just_switched_on_turns_no_wheel_until_a_person_clears_its_stop() -> None:
    bench = Bench()
    report = last(bench.run(0.5, (3.0,) * 4))
    assert report.board is not None
    assert report.board.stop == BoardStopped(("began",))
    assert set(bench.board.speed_countps) == {0.0}
    bench.arm()
    report = last(bench.run(0.5, (3.0,) * 4))
    assert report.board is not None
    assert (report.board.stop, report.board.fault) == (None, None)
    assert min(bench.board.speed_countps) > 0.0


def test_the_red_button_the_bumper_and_the_battery_are_told() -> None:
    bench = Bench().arm()
    report = last(bench.run(0.1))
    assert report.board is not None and report.battery is not None and report.bumper is None
    assert set(report.board.inputs) == {"red button", "bumper", "battery", "motors"}
    assert report.battery.voltage_v == pytest.approx(25.2)
    bench.board.is_button_pressed = bench.board.is_bumper_pressed = True
    report = last(bench.run(0.1))
    assert report.board is not None and report.bumper is not None
    assert report.board.is_button_pressed
    assert report.board.stop == BoardStopped(("button", "bumper"))
    assert report.bumper.x_body_m > ROBOT.drive.wheelbase_m / 2.0
    bench.board.battery_v = 4.9  # of the USB line
    report = last(bench.run(0.1))
    assert report.board is not None and report.battery is None
    assert "battery" not in report.board.inputs


def test_the_charge_follows_from_the_voltages_of_the_pack_and_is_not_known_without_them() -> None:
    plain, pack = Bench(), Bench("board=agribot&battery_empty_v=18&battery_full_v=25.2")
    for bench, left_ratio in ((plain, math.nan), (pack, 0.5)):
        bench.board.battery_v = 21.6
        battery = last(bench.run(0.1)).battery
        assert battery is not None
        assert battery.charge_ratio == pytest.approx(left_ratio, abs=0.01, nan_ok=True)
    pack.board.battery_v = 26.0
    battery = last(pack.run(0.1)).battery
    assert battery is not None and battery.charge_ratio == 1.0


@pytest.mark.parametrize(
    "options", ["battery_full_v=25", "battery_empty_v=18", "battery_empty_v=25&battery_full_v=18"]
)
def test_half_a_pack_is_refused(options: str) -> None:
    with pytest.raises(ConfigError, match="give both, the full one higher"):
        open_board(f"board=agribot&{options}")


def test_frames_that_break_on_either_way_are_counted_and_a_board_that_begins_anew_is_none() -> None:
    bench = Bench().arm()
    board = bench.driver
    assert isinstance(board, CountsBroken) and board.broken == 0
    spoilt = bytearray(board.drive((1.0,) * 4, STILL))
    spoilt[4] ^= 4
    bench.board.feed(bytes(spoilt) * 2)
    bench.run(0.1)
    assert board.broken == 2
    said = bytearray(bench.board.advance())
    said[5] ^= 4 if said[5] != 4 else 8  # a zero would end the frame
    board.feed(bytes(said))
    assert board.broken == 3
    bench.board.restart()
    bench.run(0.1)
    assert board.broken == 3


def test_a_wheel_that_turns_against_its_motor_is_told_with_what_to_look_at() -> None:
    bench = Bench().arm()
    bench.board.causes, bench.board.motor_faults = StopCause.REVERSED, 0b1010_0000
    board = last(bench.run(0.1)).board
    assert board is not None
    assert board.fault == WheelsReversed(("left_wheel_R", "left_wheel_F"))


@pytest.mark.parametrize("bits", [0b0010, 0b0010_0000])
def test_a_motor_at_fault_is_told_by_its_wheel(bits: int) -> None:
    bench = Bench().arm()
    bench.board.motor_faults = bits
    wheels = last(bench.run(0.1)).wheels
    assert wheels is not None
    assert wheels.faults == (WHEEL_NAMES[1],)


def test_a_board_that_hung_and_began_anew_says_so_and_is_configured_again() -> None:
    bench = Bench().arm()
    bench.board.restart(is_by_watchdog=True)
    report = last(bench.run(0.5))
    assert report.board is not None
    assert report.board.fault == BoardHung()
    assert report.board.stop == BoardStopped(("began",))
    bench.arm()
    wheels = last(bench.run(1.0, (2.0,) * 4)).wheels
    assert wheels is not None
    assert wheels.speed_radps == pytest.approx((2.0,) * 4, abs=1e-2)


def test_times_go_on_where_the_boards_clock_wraps_around_and_begin_anew_with_the_board() -> None:
    bench = Bench().arm()
    bench.board._ticks = 2**32 // 10_000 - 50
    stamps = [report.stamp_s for report in bench.run(1.0) if report.report.wheels]
    assert max(b - a for a, b in pairwise(stamps)) < 0.02
    assert stamps[-1] - stamps[0] == pytest.approx(0.99, abs=0.02)
    bench.board.restart()
    assert bench.run(0.3)[-1].stamp_s < 1.0


class Link:
    """A board's link with a clock that the test sets."""

    def __init__(self, options: str = "board=agribot") -> None:
        self.t_s = 0.0
        self.link = BoardLink(open_board(options), ROBOT.drive, lambda: self.t_s)
        self.greeting = self.link.open()


def test_an_arduino_is_told_nothing_before_it_has_spoken_since_its_line_was_opened() -> None:
    bench, board = Link(), BoardEmulator()
    link = bench.link
    for _ in range(2):
        assert bench.greeting == b"" and not link.may_send and not link.has_spoken
        bench.t_s += 1.0
        link.feed(b"A0B0C16384D0E0F131G\r\n\0\0", bench.t_s)
        assert not link.may_send, "what is no frame may be of the program before"
        link.feed(board.advance() + board.advance(), bench.t_s)
        assert not link.may_send, "nor what was still in the line"
        bench.t_s += 0.06
        link.feed(board.advance(), bench.t_s)
        assert link.may_send and not link.has_spoken
        board.feed(link.board.poll())
        link.feed(board.advance(), bench.t_s)
        assert link.has_spoken
        bench.greeting = link.open()


def test_an_arduino_that_falls_silent_is_told_nothing_until_it_speaks_again() -> None:
    bench, board = Link(), BoardEmulator()
    bench.link.feed(board.advance(), bench.t_s - 0.05)
    for _ in range(3):
        bench.link.feed(board.advance(), bench.t_s)
        assert bench.link.may_send
        bench.t_s += 0.09
        assert bench.link.may_send
        bench.t_s += 0.03  # its watchdog resets it after 0.12 s
        assert not bench.link.may_send


def test_what_came_instead_of_a_report_tells_what_to_check() -> None:
    bench, board = Link(), BoardEmulator()
    assert "says nothing; check its power" in bench.link.describe_silence()
    bench.link.feed(b"$GNGGA,,,,,,0,,,,,,,,*78\r\n", bench.t_s)
    assert "says 26 bytes, but no report" in bench.link.describe_silence()
    bench.link.feed(b"\0" + board.advance() + board.advance(), bench.t_s)
    assert "says 4 messages, but does not answer" in bench.link.describe_silence()
    bench.link.open()
    assert "says nothing" in bench.link.describe_silence(), "what was before counts no more"


@pytest.mark.parametrize("options", ["board=vesc&ids=local,12", "board=odrive"])
def test_a_controller_that_only_answers_is_asked_at_once_and_again(options: str) -> None:
    bench = Link(options)
    assert bench.greeting and bench.link.may_send
    bench.t_s = 10.0
    assert bench.link.may_send and bench.link.board.poll()


def test_a_board_that_refuses_its_configuration_is_a_fault() -> None:
    bench = Bench()
    refused = BoardAck(of_type=BoardConfig.number, of_seq=1, result=AckResult.BAD_VALUE)
    for answer, count in (
        (refused, 1),
        (msgspec.structs.replace(refused, result=AckResult.DONE), 0),
    ):
        bench.run(0.1)
        bench.driver.feed(encode(0, answer))
        board = last(bench.run(0.1)).board
        assert board is not None
        assert board.fault == (BoardUnconfigured() if count else None)


def test_a_board_of_another_table_is_trouble_that_says_what_to_do() -> None:
    bench = Bench()
    bench.board = BoardEmulator(layout=1)
    bench.board.feed(bench.driver.open())
    assert bench.run(0.3) == []
    assert "flash the firmware" in bench.driver.trouble


def test_the_implements_sections_are_the_boards_outputs() -> None:
    bench = Bench().arm()
    bench.run(0.1, implement=ImplementCommand(sections_on=(True, False, True)))
    assert bench.board.commands[-1].tool == 0b101


def test_the_imu_is_turned_to_the_axes_of_the_body() -> None:
    bench = Bench("board=agribot&axes=x,-y,-z")
    bench.board.accel_mps2, bench.board.gyro_radps = (1.0, 2.0, -9.81), (0.1, 0.2, 0.3)
    reports = [r.report for r in bench.run(0.5)]
    imu = next(r.imu for r in reports if r.imu)
    assert imu.accel_mps2 == pytest.approx((1.0, -2.0, 9.81), abs=2e-3)
    assert imu.gyro_radps == pytest.approx((0.1, -0.2, -0.3), abs=5e-4)
    assert sum(r.mag is not None for r in reports) == pytest.approx(10, abs=2)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ("board=arduino", "board=arduino.*known: agribot, vesc, odrive"),
        ("board=agribot&counts_per_turn=90000", "more than the board's messages hold"),
        ("board=agribot&kp=x", "kp=x: out of range; give 0"),
        ("board=agribot&colour=red", "unknown option 'colour'"),
        ("board=vesc", "ids=local: not two or four controllers"),
        ("board=vesc&ids=1,999", "'999' is no controller"),
        ("board=odrive&axes=2,3", "axes=2,3"),
    ],
)
def test_a_board_that_means_nothing_is_refused_in_words(options: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why.replace("(", r"\(")):
        open_board(options)


@pytest.mark.parametrize(
    ("options", "lacks"),
    [
        ("board=agribot", "counts_per_turn"),
        ("board=agribot&counts_per_turn=2048", "full_speed_radps"),
        ("board=vesc&ids=1,2&gear=10", "pole_pairs"),
        ("board=vesc&ids=1,2&pole_pairs=7", "gear"),
        ("board=odrive", "gear"),
    ],
)
def test_a_board_whose_motors_nobody_stated_is_refused(options: str, lacks: str) -> None:
    with pytest.raises(ConfigError, match=f"localhost:1: {lacks} is not stated"):
        board_kinds.open_board(f"tcp://localhost:1?{options}", ROBOT)


def test_what_the_uri_states_of_the_motors_counts_more_than_the_settings() -> None:
    driver = open_board("board=agribot&counts_per_turn=2048&full_speed_radps=8.4")
    assert isinstance(driver, AgribotBoard)
    assert driver._config.full_speed_countps == round(8.4 * 2048 / math.tau)


@pytest.mark.parametrize("speed_radps", [1.0, 3.3])
def test_motors_of_the_parts_list_are_sound_when_they_do_what_they_should(
    speed_radps: float,
) -> None:
    full_radps, winding_ohm, idle_a = 80.0 / 60.0 * math.tau, 2.4, 0.5
    duty = speed_radps / full_radps + idle_a * winding_ohm / 24.0
    watch = MotorWatch(ROBOT.drive, 24.0 / full_radps, winding_ohm)
    four = [speed_radps] * 4
    named = [watch.update(0.01 * k, 24.0, [duty] * 4, four, [idle_a] * 4) for k in range(200)]
    assert set(named) == {()}


def test_motors_are_watched_by_their_current_where_their_winding_is_stated() -> None:
    plain, stated = open_board("board=agribot"), open_board("board=agribot&winding_ohm=2.4")
    assert isinstance(plain, AgribotBoard) and isinstance(stated, AgribotBoard)
    assert plain._motors is None and stated._motors is not None


def test_vesc_controllers_turn_the_wheels_of_their_sides_and_tell_their_faults() -> None:
    driver = open_board("board=vesc&ids=local,12&pole_pairs=7&gear=10")
    fake = FakeVesc(local=3, others=(12,))
    found: list[StampedReport] = driver.feed(fake.answer(driver.open()))
    for _ in range(100):
        fake.advance(0.02)
        out = driver.poll() + driver.drive((2.0, -1.0, 2.0, -1.0), STILL)
        said = fake.answer(out)
        found += driver.feed(said[:9])
        found += driver.feed(said[9:])
    report = found[-1].report
    assert report.wheels is not None and report.battery is not None and report.board is not None
    assert report.wheels.speed_radps == pytest.approx((2.0, -1.0, 2.0, -1.0), rel=0.01)
    assert report.wheels.angle_rad == pytest.approx((4.0, -2.0, 4.0, -2.0), rel=0.06)
    assert report.battery.voltage_v == pytest.approx(24.6)
    assert report.board.inputs == ("battery", "motors")
    fake.faults[12] = 9
    report = driver.feed(fake.answer(driver.poll()))[-1].report
    assert report.wheels is not None and report.board is not None
    assert report.wheels.faults == ("left_wheel_R", "left_wheel_F")
    assert report.board.fault == ControllerFault("12", "MCU under voltage (brown-out)")


def test_a_vesc_packet_is_what_its_protocol_says() -> None:
    payload = struct.pack(">Bi", 8, 4000)
    crc = crc_hqx(payload, 0).to_bytes(2, "big")
    assert vesc_packets.make_packet(payload) == b"\x02\x05" + payload + crc + b"\x03"


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=400), st.integers(1, 40))
def test_vesc_packets_are_found_among_any_noise(noise: bytes, cut: int) -> None:
    decoder, packet = vesc_packets.VescDecoder(), vesc_packets.make_packet(bytes((4, *range(60))))
    data = noise + bytes(700) + packet  # zeros end whatever the noise seemed to begin
    found = [p for k in range(0, len(data), cut) for p in decoder.feed(data[k : k + cut])]
    assert bytes((4, *range(60))) in found


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(["board=agribot", "board=vesc&ids=1,2", "board=odrive"]),
    st.lists(st.binary(max_size=120), max_size=12),
)
def test_no_bytes_break_a_board(options: str, pieces: list[bytes]) -> None:
    driver = open_board(options)
    driver.open()
    for piece in pieces:
        driver.poll()
        for stamped in driver.feed(piece):
            assert stamped.stamp_s >= 0.0
