"""A line is heard at one speed after the other, and asked only where that does no harm."""

from __future__ import annotations

import random

import pytest

from agribot.core.fact_text import render
from agribot.core.facts import BoardStopped
from agribot.drivers.imu.imu_devices import BEGINS_S
from agribot.drivers.probe.line_answers import LineAnswer
from agribot.drivers.probe.line_probe import (
    LIMIT_S,
    LineProbe,
    may_ask_silent,
    order_bauds,
)
from tests.drivers import receiver_bytes as written
from tests.drivers import rosserial_bytes
from tests.drivers.esc_fakes import FakeOdrive, FakeVesc
from tests.drivers.tuned_line import (
    Device,
    MegaWithMotorBoard,
    SpeakingReceiver,
    TunedLine,
    be_silent,
)

CHIP = "USB to serial chip CH340, often an Arduino"
RECEIVER = "u-blox receiver"


def probe(
    device: Device, baud: int, what: str = CHIP, *, is_allowed: bool = False
) -> tuple[LineAnswer, TunedLine]:
    line = TunedLine(device, baud)
    may_ask = may_ask_silent(what) or is_allowed
    answer = LineProbe(line, line.now_s, may_ask=may_ask).find(order_bauds(what))
    assert line.t_s < LIMIT_S + 1.0
    return answer, line


def test_a_motor_board_is_asked_only_after_its_bootloader_has_let_it_speak() -> None:
    mega = MegaWithMotorBoard()
    mega.board.is_button_pressed = True
    answer, line = probe(mega, 250_000, "Arduino Mega 2560")
    assert not mega.is_spoiled
    assert (answer.kind, answer.use, answer.baud, answer.is_good) == (
        "motor board", "base", 250_000, True,
    )  # fmt: skip
    assert "firmware 1.0.0" in answer.detail
    assert render(BoardStopped(("began", "button"))) in answer.detail
    assert "ESTOP_PRESSED" in answer.numbers["flags"]
    assert answer.write_uri("/dev/x") == "serial:/dev/x"
    assert line.bauds == [250_000]


def test_the_probe_gives_a_board_no_speed_and_clears_no_stop() -> None:
    mega = MegaWithMotorBoard()
    probe(mega, 250_000)
    assert (mega.board.commands, mega.board.clears) == ([], 0)


def test_what_an_arduino_said_before_it_was_reset_brings_it_no_question_in_its_bootloader() -> None:
    answer, line = probe(SpeakingReceiver(lambda at: written.make_nmea(at)[1], 0.2), 250_000)
    assert answer.kind == "receiver"
    assert line.first_sent_s >= BEGINS_S


def test_what_is_silent_is_told_nothing_at_all() -> None:
    answer, line = probe(be_silent, 9_600)
    assert (answer.kind, answer.is_good, line.sent) == ("silent", False, b"")
    assert len(line.bauds) < len(order_bauds(CHIP)), "no time is lost at speeds that say nothing"


def test_noise_is_no_device_and_gets_no_answer() -> None:
    rng = random.Random(4)
    answer, line = probe(lambda heard, t_s: rng.randbytes(60), 9_600)
    assert (answer.kind, line.sent) == ("unknown", b"")
    assert set(line.bauds) == set(order_bauds(CHIP))


@pytest.mark.parametrize("baud", [9_600, 38_400, 115_200, 460_800])
@pytest.mark.parametrize("what", [CHIP, RECEIVER])
def test_a_receiver_is_found_at_whatever_speed_it_has_and_told_how_it_is(
    what: str, baud: int
) -> None:
    device = SpeakingReceiver(
        lambda at: written.make_ubx_pvt(at) + written.make_ubx_sky(at), 1.0,
        written.make_ubx_version("ZED-F9P"),
    )  # fmt: skip
    answer, _ = probe(device, baud, what)
    assert (answer.kind, answer.use, answer.baud) == ("receiver", "gnss", baud)
    assert "u-blox ZED-F9P" in answer.detail and "2 of 3 satellites" in answer.detail
    assert f"UBX at {baud} baud, 1.0 Hz, single" in answer.detail
    assert "no corrections" in answer.detail
    told = "; ".join(answer.advice)
    assert "agribot gnss configure URI --rate 10" in told and "ntrip=" in told
    options = "" if baud == 38_400 else f"?baud={baud}"
    assert answer.write_uri("/dev/x") == f"serial:/dev/x{options}"


def test_a_receiver_with_corrections_and_a_fixed_carrier_needs_no_advice() -> None:
    device = SpeakingReceiver(
        lambda at: written.make_ubx_pvt(at, carrier=2, h_acc_m=0.02)
        + written.make_ubx_sky(at) + written.make_ubx_cor(2), 0.1,
        written.make_ubx_version("ZED-F9P"),
    )  # fmt: skip
    answer, _ = probe(device, 115_200, RECEIVER)
    assert answer.advice == ()
    assert "10.0 Hz" in answer.detail and "RTK fixed" in answer.detail
    assert "corrections come in" in answer.detail
    assert answer.numbers["corrections_used"] > 0


def test_a_receiver_that_still_searches_is_one_already() -> None:
    answer, _ = probe(SpeakingReceiver(written.make_ubx_searching, 0.2), 38_400, RECEIVER)
    assert answer.is_good and "no fix" in answer.detail and "5.0 Hz" in answer.detail
    assert "open sky" in answer.advice[0]


def test_nmea_of_a_receiver_of_another_maker_is_told_as_that() -> None:
    say = SpeakingReceiver(lambda at: b"".join(written.make_nmea(at, std_m=None)), 1.0)
    answer, _ = probe(say, 9_600)
    assert answer.numbers["language"] == "NMEA" and answer.numbers["fix"] == "single"
    told = "; ".join(answer.advice)
    assert "GST" in told and "its maker" in told and "gnss configure" not in told


def test_lines_of_the_original_are_told_from_our_imu_board_by_what_they_do_not_answer() -> None:
    def print_lines(heard: bytes, t_s: float) -> bytes:
        return b"A0B0C16384D131E0F0G\r\n" if t_s > 1.5 else b""

    answer, line = probe(print_lines, 57_600, "Arduino Mega 2560")
    assert (answer.kind, answer.use) == ("letter imu", "imu")
    assert answer.write_uri("/dev/x") == "serial:/dev/x"
    assert line.sent, "it was asked whether it is a board of ours"


def test_an_arduino_that_publishes_for_ros_is_asked_once_it_speaks() -> None:
    class Publishing:
        is_asked = False

        def __call__(self, heard: bytes, t_s: float) -> bytes:
            self.is_asked |= b"\xff\xfe\x00\x00\xff" in heard
            said = rosserial_bytes.make_topic() if self.is_asked else b""
            return said + rosserial_bytes.make_message()

    answer, _ = probe(Publishing(), 57_600, "Arduino Mega 2560")
    assert (answer.kind, answer.options) == ("rosserial imu", (("board", "rosserial"),))


def test_a_vesc_is_asked_by_its_usb_name_and_tells_who_is_behind_it() -> None:
    fake = FakeVesc(local=3, others=(12,))
    answer, _ = probe(lambda heard, t_s: fake.answer(heard), 115_200, "STM32 board, such as a VESC")
    assert (answer.kind, answer.is_good) == ("vesc", True)
    assert answer.write_uri("/dev/x") == "serial:/dev/x?board=vesc&ids=local,12"
    assert "firmware 6.05" in answer.detail and "60_MK6" in answer.detail
    assert fake.erpm == {3: 0, 12: 0}


def test_a_vesc_alone_drives_no_robot() -> None:
    fake = FakeVesc(local=3, others=())
    fake.faults[3] = 2
    answer, _ = probe(lambda heard, t_s: fake.answer(heard), 115_200, "STM32 board, such as a VESC")
    assert not answer.is_good
    assert "fault: under voltage" in answer.detail and "two or four" in answer.advice[0]


@pytest.mark.parametrize(("firmware", "options"), [((0, 5), ""), ((0, 6), "&errors=active_errors")])
def test_an_odrive_is_asked_which_names_its_firmware_has(
    firmware: tuple[int, int], options: str
) -> None:
    fake = FakeOdrive(firmware)
    fake.errors[1] = 0x40

    def answer_after_strays(heard: bytes, t_s: float) -> bytes:
        said = fake.answer(heard)
        return b"unknown command\r\n" + said if said else b""

    answer, _ = probe(answer_after_strays, 115_200, "ODrive")
    assert answer.write_uri("/dev/x") == f"serial:/dev/x?board=odrive{options}"
    assert "24.3 V" in answer.detail and "axis 1 has error 0x40" in answer.detail
    assert fake.lets_go == [] and fake.clears == 0


def test_on_pins_a_silent_controller_is_asked_only_where_a_person_says_so() -> None:
    pins = "serial pins of the board"
    fake = FakeOdrive()
    answer, line = probe(lambda heard, t_s: fake.answer(heard), 115_200, pins)
    assert (answer.kind, line.sent) == ("silent", b"")
    assert "--ask" in answer.advice[-1]
    answer, _ = probe(lambda heard, t_s: fake.answer(heard), 115_200, pins, is_allowed=True)
    assert answer.kind == "odrive"
    vesc = FakeVesc(local=3, others=(12,))
    answer, _ = probe(lambda heard, t_s: vesc.answer(heard), 115_200, pins, is_allowed=True)
    assert answer.kind == "vesc"


def test_a_line_that_never_stops_is_left_after_the_limit() -> None:
    line = TunedLine(lambda heard, t_s: b"\0" * 40, 9_600)
    answer = LineProbe(line, line.now_s, limit_s=5.0).find(order_bauds(CHIP))
    assert answer.kind == "unknown"
    assert line.t_s < 5.5
