"""The IMU board speaks to each host as that one understands: lines, rosserial, frames."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from agribot.core.messages import ImuSample, MagSample, Vec3
from agribot.drivers.board.board_codec import BoardDecoder, encode
from agribot.drivers.board.board_protocol import (
    GRAVITY_MPS2,
    LAYOUT,
    MAG_LSB_T,
    TELEMETRY_HZ,
    AskVersion,
    BoardFlag,
    BoardImu,
    BoardKind,
    BoardVersion,
)
from agribot.drivers.board.letter_imu import LetterImuDecoder, read_axes
from agribot.drivers.board.rosserial import RosserialHost, TopicMessage, read_string
from agribot.drivers.imu import imu_devices
from agribot.drivers.imu.imu_devices import ImuDevice, Measured
from agribot.drivers.line.schemes import read_uri
from agribot.drivers.line.uri_options import UriOptions
from firmware.bench.avr_bench import MPU, AvrBench
from firmware.build import PREBUILT, build_imu_board
from tests import machine, nightly

REST = (0.0, 0.0, 0.0, 0.0)
STEP_S = 0.02
# The bench writes counts at 4 g and 500 degrees a second; lines are read at 2 g and 250.
ACCEL, GYRO = (0.5, -1.25, 9.6), (0.02, -0.5, 1.5)


@pytest.fixture
def make_imu(bench_library: ctypes.CDLL) -> Iterator[Callable[[Path], AvrBench]]:
    boards: list[AvrBench] = []

    def make(
        firmware: Path = PREBUILT / "imu_board.hex", bootloader: Path | None = None
    ) -> AvrBench:
        boards.append(AvrBench(bench_library, firmware, bootloader=bootloader))
        boards[-1].set_imu(ACCEL, GYRO)
        return boards[-1]

    yield make
    for board in boards:
        board.close()


@pytest.fixture
def imu(make_imu: Callable[..., AvrBench]) -> AvrBench:
    return make_imu()


def read_lines(data: bytes) -> list[ImuSample]:
    return LetterImuDecoder(read_axes("x,y,z"), pytest.fail, accel_g=4.0, gyro_dps=500.0).feed(data)


def ask_rosserial(imu: AvrBench, duration_s: float) -> tuple[RosserialHost, list[TopicMessage]]:
    host, found = RosserialHost(), list[TopicMessage]()
    for _ in range(round(duration_s / STEP_S)):
        imu.advance(STEP_S, REST)
        found += host.feed(imu.receive(), imu.t_s)
        imu.send(host.take_to_send())
    return host, found


def assert_measured(accel_mps2: Vec3 | None, gyro_radps: Vec3) -> None:
    assert accel_mps2 == pytest.approx(ACCEL, abs=4.0 * GRAVITY_MPS2 / 32768)
    assert gyro_radps == pytest.approx(GYRO, abs=math.radians(500.0) / 32768)


def test_alone_it_prints_ten_lines_of_the_original_a_second(imu: AvrBench) -> None:
    imu.advance(2.0, REST)
    data = imu.receive()
    samples = read_lines(data)
    assert len(samples) == pytest.approx(20, abs=1)
    assert_measured(samples[-1].accel_mps2, samples[-1].gyro_radps)
    assert data.endswith(b"G\r\n") and data.count(b"\n") == len(samples)


@pytest.mark.parametrize("counts", [(-32768, 32767, 0, -1, 1, -32768)])
def test_the_largest_numbers_fit_a_line(imu: AvrBench, counts: tuple[int, ...]) -> None:
    huge = tuple(math.copysign(1e3, count) if abs(count) > 1 else 0.0 for count in counts)
    imu.set_imu((huge[0], huge[1], huge[2]), (huge[3], huge[4], huge[5]))
    imu.advance(0.5, REST)
    assert imu.receive().endswith(b"A-32768B32767C0D0E0F-32768G\r\n")


def test_to_a_host_of_rosserial_it_publishes_the_same_text(imu: AvrBench) -> None:
    host, found = ask_rosserial(imu, 2.0)
    assert [topic.name for topic in host.topics.values()] == ["imu"]
    assert len(found) == pytest.approx(20, abs=2)
    (sample,) = read_lines(read_string(found[-1]).encode())
    assert_measured(sample.accel_mps2, sample.gyro_radps)
    assert host.bad == 0


@nightly.by_day(
    "test_to_a_host_of_rosserial_it_publishes_the_same_text",
    "tests/drivers/test_rosserial.py"
    "::test_messages_survive_any_cutting_and_the_text_that_is_printed_between_them",
)
def test_as_the_original_did_it_may_print_between_its_packets(
    make_imu: Callable[[Path], AvrBench], tmp_path: Path
) -> None:
    machine.require("avr-gcc")
    imu = make_imu(build_imu_board(tmp_path, ["-DPRINTS_ALWAYS"]))
    host, found = ask_rosserial(imu, 2.0)
    assert len(found) == pytest.approx(20, abs=2)
    assert host.bad == 0 and host.skipped > 20 * 30


def test_to_a_host_that_asks_for_its_version_it_sends_frames(imu: AvrBench) -> None:
    imu.advance(0.25, REST)
    imu.set_mag((21e-6, -4.5e-6, -40e-6))
    imu.receive()
    imu.send(encode(0, AskVersion()))
    imu.advance(0.05, REST)
    decoder = BoardDecoder()
    decoder.feed(imu.receive())
    imu.advance(1.0, REST)
    messages = [frame.message for frame in decoder.feed(imu.receive())]
    readings = [message for message in messages if isinstance(message, BoardImu)]
    assert len(readings) == pytest.approx(TELEMETRY_HZ, abs=1)
    assert (decoder.bad, decoder.lost) == (0, 0)
    assert_measured(readings[-1].accel_mps2, readings[-1].gyro_radps)
    assert readings[-1].mag_t == pytest.approx((21e-6, -4.5e-6, -40e-6), abs=1.01 * MAG_LSB_T)
    assert not readings[-1].flags
    imu.send(encode(1, AskVersion()))
    imu.advance(0.05, REST)
    (version,) = (
        frame.message
        for frame in decoder.feed(imu.receive())
        if isinstance(frame.message, BoardVersion)
    )
    assert version.board is BoardKind.IMU and version.layout == LAYOUT


def test_an_unplugged_chip_gives_silence_and_comes_back_with_the_right_ranges(
    imu: AvrBench,
) -> None:
    imu.advance(0.05, REST)
    imu.send(encode(0, AskVersion()))
    imu.advance(0.3, REST)
    imu.plug_imu(is_there=False)
    imu.advance(0.1, REST)
    decoder = BoardDecoder()
    imu.receive()
    imu.advance(0.5, REST)
    assert imu.receive() == b"" and imu.resets == 0
    imu.plug_imu(is_there=True)
    imu.set_imu(ACCEL, GYRO)
    imu.advance(0.8, REST)
    readings = [frame.message for frame in decoder.feed(imu.receive())]
    assert isinstance(readings[-1], BoardImu)
    assert_measured(readings[-1].accel_mps2, readings[-1].gyro_radps)
    assert not readings[-1].flags & BoardFlag.MAG_FAULT
    assert imu.get_register(MPU, 0x1C) == 0x08


def open_device(text: str) -> ImuDevice:
    return imu_devices.make_imu(
        UriOptions(read_uri("--source", f"serial:/dev/imu?{text}", "imu=")), pytest.fail
    )


def read_device(imu: AvrBench, device: ImuDevice, duration_s: float) -> Measured:
    """Let the board and the program speak with each other."""
    found: Measured = []
    for _ in range(round(duration_s / STEP_S)):
        imu.advance(STEP_S, REST)
        found += device.feed(imu.receive(), imu.t_s)
        imu.send(device.take_to_send())
    return found


LINES = [
    ("board=letters&accel_g=4&gyro_dps=500", 10.0),
    ("board=rosserial&accel_g=4&gyro_dps=500", 10.0),
]


@pytest.mark.parametrize(("options", "rate_hz"), [*LINES, ("board=agribot", TELEMETRY_HZ)])
def test_the_robot_reads_the_board_in_each_of_its_three_ways(
    imu: AvrBench, options: str, rate_hz: float
) -> None:
    found = [sample for _, sample in read_device(imu, open_device(options), 3.0)]
    samples = [sample for sample in found if isinstance(sample, ImuSample)]
    assert len(samples) >= 1.5 * rate_hz
    assert_measured(samples[-1].accel_mps2, samples[-1].gyro_radps)


def test_frames_bring_the_magnetometer_and_the_times_of_the_board(imu: AvrBench) -> None:
    found = read_device(imu, open_device("board=agribot&axes=x,-y,-z"), 2.0)
    stamps_s = [stamp_s for stamp_s, sample in found if isinstance(sample, ImuSample)]
    gaps_s = [after - before for before, after in pairwise(stamps_s)]
    assert gaps_s == pytest.approx([1.0 / TELEMETRY_HZ] * len(gaps_s), abs=1e-3)
    fields = [sample for _, sample in found if isinstance(sample, MagSample)]
    assert fields
    assert [sample for _, sample in found if isinstance(sample, ImuSample)][
        -1
    ].accel_mps2 == pytest.approx((ACCEL[0], -ACCEL[1], -ACCEL[2]), abs=0.01)


def test_a_board_that_was_reset_is_asked_for_frames_again(
    make_imu: Callable[..., AvrBench],
) -> None:
    device = open_device("board=agribot")
    assert read_device(make_imu(), device, 1.5)
    fresh = make_imu()
    later: Measured = []
    for step in range(150):
        fresh.advance(STEP_S, REST)
        later += device.feed(fresh.receive(), 10.0 + step * STEP_S)
        fresh.send(device.take_to_send())
    assert len([s for _, s in later if isinstance(s, ImuSample)]) > TELEMETRY_HZ


@pytest.mark.parametrize(
    ("options", "rate_hz"),
    [
        ("board=agribot", TELEMETRY_HZ),
        *(
            pytest.param(
                *way,
                marks=nightly.by_day("test_the_robot_reads_the_board_in_each_of_its_three_ways"),
            )
            for way in LINES
        ),
    ],
)
def test_behind_the_bootloader_of_a_mega_it_comes_up_in_each_way_and_again_when_it_is_reset(
    options: str, rate_hz: float, make_imu: Callable[..., AvrBench], bootloader: Path
) -> None:
    imu, device = make_imu(bootloader=bootloader), open_device(options)
    device.open(imu.t_s)  # and so the board begins
    for _ in range(2):
        found = [sample for _, sample in read_device(imu, device, 4.0)]
        samples = [sample for sample in found if isinstance(sample, ImuSample)]
        assert len(samples) >= 1.2 * rate_hz
        assert_measured(samples[-1].accel_mps2, samples[-1].gyro_radps)
        imu.reset()


@pytest.mark.parametrize(
    ("has_bootloader", "comes_up_s"),
    [
        (False, 1.5),
        pytest.param(
            True,
            3.0,
            marks=nightly.by_day(
                "tests/firmware/test_motor_board.py::test_behind_the_bootloader_of_a_mega_it_tells"
                "_a_reset_by_its_watchdog_from_one_by_its_button",
                "test_behind_the_bootloader_of_a_mega_it_comes_up_in_each_way_and_again"
                "_when_it_is_reset",
            ),
        ),
    ],
)
def test_an_imu_board_that_hung_says_so_and_one_whose_button_was_pressed_does_not(
    has_bootloader: bool, comes_up_s: float, make_imu: Callable[..., AvrBench], bootloader: Path
) -> None:
    imu = make_imu(bootloader=bootloader if has_bootloader else None)
    decoder = BoardDecoder()
    for harm, has_hung in ((imu.reset, False), (imu.hang, True), (imu.reset, False)):
        imu.advance(comes_up_s, REST)
        harm()
        imu.advance(comes_up_s, REST)
        imu.send(encode(0, AskVersion()))
        imu.advance(0.05, REST)  # it ends its line before
        imu.receive()
        imu.advance(0.1, REST)
        frames = [frame.message for frame in decoder.feed(imu.receive())]
        readings = [message for message in frames if isinstance(message, BoardImu)]
        assert readings and (BoardFlag.WATCHDOG_RESET in readings[-1].flags) is has_hung
