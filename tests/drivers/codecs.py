"""Every codec of the drivers with bytes that it is there for, and how fast it reads them."""

from __future__ import annotations

import datetime as dt
import time
from collections.abc import Callable
from typing import Any

from agribot.drivers.board.board_codec import BoardDecoder, encode
from agribot.drivers.board.letter_imu import LetterImuDecoder, read_axes
from agribot.drivers.board.motor_board import MotorBoard
from agribot.drivers.board.odrive import OdriveBoard
from agribot.drivers.board.odrive_can import OdriveCanBoard
from agribot.drivers.board.rosserial import RosserialHost
from agribot.drivers.board.vesc import LOCAL, VescBoard
from agribot.drivers.board.vesc_can import VescCanBoard
from agribot.drivers.gnss import ntrip, rtcm
from agribot.drivers.gnss.nmea import write_sentence
from agribot.drivers.gnss.receiver import GpsdDecoder
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder
from agribot.drivers.gnss.ubx import UbxDecoder, make_frame
from agribot.drivers.gnss.ubx_setup import ACK, CFG_VALSET, NAK, ReceiverSetup, SetupPlan
from tests.drivers import board_bytes, maker_bytes, rosserial_bytes
from tests.drivers import receiver_bytes as written
from tests.drivers.can_fakes import FakeOdriveBus, FakeVescBus
from tests.drivers.caster import STATION, TABLE, YES, chunk, make_observation
from tests.drivers.esc_fakes import FakeOdrive, FakeVesc

Feed = Callable[[bytes], list[Any]]
BITS_PER_BYTE = 10  # of a serial line
PIECE = 256  # bytes that a read of a busy line gives
# The fastest line that each has in use; what gpsd and a caster say came over one of those.
BAUD = {
    "ubx": 115_200, "nmea": 115_200, "unicore": 460_800, "sbf": 115_200,
    "ubx_setup": 115_200, "gpsd": 115_200, "rtcm": 115_200,
    "ntrip": 115_200, "letter_imu": 57_600, "rosserial": 57_600, "board": 250_000,
    "vesc": 115_200, "odrive": 115_200,
    # 16 bytes for each frame of 150 bits with what is stuffed, at 500 kbit/s.
    "vesc_can": 533_000, "odrive_can": 533_000,
}  # fmt: skip


def ignore(text: str) -> None:
    """Take what a codec refuses."""


def open_receiver() -> Feed:
    return ReceiverDecoder(ignore).feed


def open_gpsd() -> Feed:
    return GpsdDecoder(ignore).feed


def open_imu() -> Feed:
    return LetterImuDecoder(read_axes("x,-y,-z"), ignore).feed


def open_rtcm() -> Feed:
    return rtcm.RtcmDecoder().feed


def open_ntrip() -> Feed:
    """An answer may be refused, and what stands behind a refusal is not read."""
    decoder = ntrip.AnswerDecoder(ntrip.Caster("caster", 2101, "FARM"), has_login=True)
    is_over = False

    def feed(data: bytes) -> list[Any]:
        nonlocal is_over
        try:
            return [] if is_over else list(decoder.feed(data))
        except ntrip.CasterRefusal:
            is_over = True
            return []

    return feed


def open_board() -> Feed:
    return BoardDecoder("board").feed


def open_rosserial() -> Feed:
    host = RosserialHost()
    return lambda data: list(host.feed(data, 1.0))


def open_vesc() -> Feed:
    return VescBoard((LOCAL, 12), 7, 10.0).feed


def open_odrive() -> Feed:
    """Questions are put whenever all were answered, however the answers are cut."""
    driver = OdriveBoard((0, 1), 10.0)
    driver.open()

    def feed(data: bytes) -> list[Any]:
        found = []
        for line in data.splitlines(keepends=True):
            if not driver.is_waiting:
                driver.poll()
            found += driver.feed(line)
        return found

    return feed


def open_vesc_can() -> Feed:
    return VescCanBoard((11, 12), 7, 10.0).feed


def open_odrive_can() -> Feed:
    return OdriveCanBoard((0, 1), 10.0).feed


def open_setup() -> Feed:
    """What is sent to the receiver is one frame."""
    frames, setup = UbxDecoder(), ReceiverSetup(SetupPlan())

    def feed(data: bytes) -> list[Any]:
        sent = [setup.add(frame) for frame in frames.feed(data)]
        for each in filter(None, sent):
            assert len(UbxDecoder().feed(each)) == 1
        return sent

    return feed


CODECS: dict[str, Callable[[], Feed]] = {
    "ubx": open_receiver,
    "nmea": open_receiver,
    "unicore": open_receiver,
    "sbf": open_receiver,
    "gpsd": open_gpsd,
    "letter_imu": open_imu,
    "rtcm": open_rtcm,
    "ntrip": open_ntrip,
    "board": open_board,
    "rosserial": open_rosserial,
    "vesc": open_vesc,
    "odrive": open_odrive,
    "vesc_can": open_vesc_can,
    "odrive_can": open_odrive_can,
    "ubx_setup": open_setup,
}


def write_vesc() -> bytes:
    """Write the answers of two controllers; one has a fault."""
    fake, driver = FakeVesc(local=3, others=(12,)), VescBoard((LOCAL, 12), 7, 10.0)
    said = fake.answer(driver.open())
    fake.faults[12] = 9
    fake.erpm[3] = -4000
    fake.advance(0.02)
    return said + fake.answer(driver.poll())


def write_odrive() -> bytes:
    """Write what an ODrive answers with checksums, and an older firmware without them."""
    fake, driver = FakeOdrive(), OdriveBoard((0, 1), 10.0)
    questions = driver.open() + driver.poll()
    said = fake.answer(questions)
    driver.feed(said)
    fake.errors[1] = 64
    said += b"unknown command\r\n" + fake.answer(driver.poll())
    return said + b"".join(line.partition(b"*")[0] + b"\r\n" for line in said.splitlines())


def write_bus(fake: FakeVescBus | FakeOdriveBus, driver: MotorBoard) -> bytes:
    """Write what two nodes say within a fifth of a second."""
    said = b""
    for _ in range(10):
        fake.advance(0.02)
        said += fake.answer(driver.poll())
    return said


def write_seeds(codec: str) -> list[bytes]:
    """Write what a codec is there for."""
    if codec in OF_BOARDS:
        return [OF_BOARDS[codec]]
    if codec == "ubx_setup":
        refused = make_frame(NAK, bytes(CFG_VALSET))
        return [
            written.make_ubx_version("ZED-F9P") + make_frame(ACK, bytes(CFG_VALSET)) * 6 + refused,
            written.make_ubx_version("NEO-M8N")
            + b"".join(make_frame(ACK, bytes((0x06, kind))) for kind in (0x08, 0x24, 1, 1, 1)),
        ]
    return write_of_receivers(codec)


OF_BOARDS = {
    "board": b"".join(encode(k, one) for k, one in enumerate(board_bytes.make_all())),
    "letter_imu": b"A-7576B2476C-14524D-749E-4615F-459G\r\nA0B0C16384D0E0F131G\r\n",
    "rosserial": rosserial_bytes.make_topic() + b"text\r\n" + rosserial_bytes.make_message(),
    "vesc": write_vesc(),
    "vesc_can": write_bus(FakeVescBus((11, 12)), VescCanBoard((11, 12), 7, 10.0)),
    "odrive_can": write_bus(FakeOdriveBus(), OdriveCanBoard((0, 1), 10.0)),
    "odrive": write_odrive(),
}


MAKERS = {
    "unicore": [
        maker_bytes.make_unicore_line("BESTNAV", maker_bytes.make_bestnav_text())
        + maker_bytes.make_unicore_line("UNIHEADING", maker_bytes.make_uniheading_text()),
        maker_bytes.make_unicore_frame(2118, maker_bytes.make_bestnav_body())
        + maker_bytes.make_unicore_frame(972, maker_bytes.make_uniheading_body()),
    ],
    "sbf": [
        maker_bytes.make_pvt_geodetic(time_ms=ms)
        + maker_bytes.make_pos_cov(0.01, time_ms=ms)
        + maker_bytes.make_vel_cov(0.02, time_ms=ms)
        + maker_bytes.make_att_euler(143.2, time_ms=ms)
        + maker_bytes.make_att_cov(0.3, time_ms=ms)
        for ms in (0, 100, 200)
    ],
}


def write_of_receivers(codec: str) -> list[bytes]:
    at, second = written.EPOCH, dt.timedelta(seconds=1)
    if codec == "ubx":
        epochs = [
            written.make_ubx_sky(at + k * second)
            + written.make_ubx_pvt(at + k * second, carrier=k)
            + written.make_ubx_hpposllh(at + k * second, 52.15, 4.51)
            + written.make_ubx_relposned(at + k * second, 90.0)
            + written.make_ubx_rtcm(use=k)
            + written.make_ubx_cor(use=k)
            for k in range(3)
        ]
        return [*epochs, b"".join(epochs)]
    if codec in ("unicore", "sbf"):
        return MAKERS[codec]
    if codec == "nmea":
        sky = [
            "GPGSV,1,1,03,05,71,210,44,07,15,033,38,12,03,359,,1",
            "GNGSA,A,3,05,07,,,,,,,,,,,1.8,0.9,1.5,1",
            "GNHDT,123.4,T",
            "GNTHS,123.4,A",
            "GNHPR,093015.50,143.2,-0.5,0.0,4,38,1.0,0001",
            "PTNL,AVR,093015.50,+143.2,Yaw,-0.5,Tilt,,,1.002,3,1.2,17",
            "GNVTG,90.0,T,,M,0.8,N,1.4,K,A",
            "GNGNS,093015.00,5209.0,N,00430.6,E,RRNN,13,0.9,11.5,45.0,,",
            "GNGLL,5209.0,N,00430.6,E,093015.00,A,R",
            "PQTMEPE,2,0.012,0.016,0.030,0.020,0.036",
        ]
        said = b"".join(write_sentence(body) for body in sky)
        epochs = [b"".join(written.make_nmea(at + k * second)) + said for k in range(2)]
        return [*epochs, b"".join(epochs)]
    if codec == "gpsd":
        return [
            b'{"class":"VERSION","release":"3.22"}\r\n{"class":"SKY","device":"/dev/a","hdop":0.9,'
            b'"satellites":[{"PRN":5,"el":71.0,"az":210.0,"ss":44.0,"used":true,"gnssid":0}]}\n',
            b'{"class":"TPV","device":"/dev/a","status":4,"mode":3,"time":"2026-05-04T09:30:15.000'
            b'Z","lat":52.15,"lon":4.51,"altHAE":56.5,"eph":1.2,"track":90.0,"speed":0.5}\n',
            b'{"class":"GST","device":"/dev/a","time":"2026-05-04T09:30:15.000Z","lat":0.1,'
            b'"lon":0.2}\n{"class":"TPV","mode":2,"time":"2026-05-04T09:30:16.000Z","lat":-52.0,'
            b'"lon":4.5,"velN":0.1,"velE":0.2,"eps":0.1}\n',
        ]
    if codec == "rtcm":
        return [STATION + make_observation(1077, 30), b"\xd3\x00\x02\xd3" + STATION]
    body = STATION + make_observation(1077, 20)
    return [
        b"ICY 200 OK\r\n\r\n" + body,
        YES + b"Transfer-Encoding: chunked\r\n\r\n" + chunk(body[:20]) + chunk(body[20:]),
        b"SOURCETABLE 200 OK\r\n\r\n" + TABLE,
        b"HTTP/1.1 401 Unauthorized\r\n\r\n",
        b"ERROR - Bad Password\r\n",
    ]


def measure_ratio(codec: str, seconds: float) -> float:
    """Measure bytes per CPU second of what the codec is there for, over those of its line."""
    seeds = write_seeds(codec)
    data = max(seeds, key=len) if codec in ("ubx", "nmea") else b"".join(seeds)
    head = b""
    if codec == "ntrip":  # the head is read once, the corrections for hours
        head, data = YES + b"Transfer-Encoding: chunked\r\n\r\n", chunk(make_observation())
    pieces = [data[k : k + PIECE] for k in range(0, len(data), PIECE)]
    count, started_s = 0, time.process_time()
    while time.process_time() - started_s < seconds:
        feed = CODECS[codec]()
        feed(head)
        for _ in range(20):
            for piece in pieces:
                feed(piece)
                count += len(piece)
    return count / (time.process_time() - started_s) / (BAUD[codec] / BITS_PER_BYTE)
