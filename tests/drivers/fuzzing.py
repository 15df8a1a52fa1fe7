"""Coverage-guided fuzzing of the codecs: bytes that reach new code are kept and changed further.

`python -m tests.drivers.fuzzing CODEC SECONDS` looks for more, adds what it finds to the corpus
in `tests/drivers/corpus/CODEC`, and names the bytes that break something.
Source of the method: Zalewski, "American fuzzy lop", technical details (edges, havoc, splicing).
"""

from __future__ import annotations

import datetime as dt
import hashlib
import math
import random
import sys
import time
from binascii import crc_hqx
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

from agribot.core.messages import GnssFix, GnssHeading, GnssStatus, ImuSample
from agribot.drivers import ntrip, rosserial, rtcm
from agribot.drivers.board_codec import FORMATS, BoardDecoder, encode, stuff, unstuff
from agribot.drivers.board_protocol import BoardMessage
from agribot.drivers.letter_imu import LetterImuDecoder, read_axes
from agribot.drivers.nmea import write_sentence
from agribot.drivers.receiver import GpsdDecoder, ReceiverDecoder
from agribot.drivers.rosserial import RosserialHost
from agribot.drivers.ubx import SYNC, compute_checksum
from tests.drivers import board_bytes, rosserial_bytes
from tests.drivers import receiver_bytes as written
from tests.drivers.caster import STATION, TABLE, YES, chunk, make_observation

CORPUS = Path(__file__).parent / "corpus"
LONGEST = 2000
Feed = Callable[[bytes], list[Any]]
Edge = tuple[int, int, int]


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


CODECS: dict[str, Callable[[], Feed]] = {
    "ubx": open_receiver,
    "nmea": open_receiver,
    "gpsd": open_gpsd,
    "letter_imu": open_imu,
    "rtcm": open_rtcm,
    "ntrip": open_ntrip,
    "board": open_board,
    "rosserial": open_rosserial,
}


def write_seeds(codec: str) -> list[bytes]:
    """Write what a codec is there for."""
    of_boards = {
        "board": b"".join(encode(k, one) for k, one in enumerate(board_bytes.make_all())),
        "letter_imu": b"A-7576B2476C-14524D-749E-4615F-459G\r\nA0B0C16384D0E0F131G\r\n",
        "rosserial": rosserial_bytes.make_topic() + b"text\r\n" + rosserial_bytes.make_message(),
    }
    if codec in of_boards:
        return [of_boards[codec]]
    at, second = written.EPOCH, dt.timedelta(seconds=1)
    if codec == "ubx":
        epochs = [
            written.make_ubx_sky(at + k * second)
            + written.make_ubx_pvt(at + k * second, carrier=k)
            + written.make_ubx_hpposllh(at + k * second, 52.15, 4.51)
            + written.make_ubx_relposned(at + k * second, 90.0)
            for k in range(3)
        ]
        return [*epochs, b"".join(epochs)]
    if codec == "nmea":
        sky = [
            "GPGSV,1,1,03,05,71,210,44,07,15,033,38,12,03,359,,1",
            "GNGSA,A,3,05,07,,,,,,,,,,,1.8,0.9,1.5,1",
            "GNHDT,123.4,T",
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


def read_corpus(codec: str) -> list[bytes]:
    return write_seeds(codec) + [path.read_bytes() for path in sorted((CORPUS / codec).iterdir())]


def check(codec: str, data: bytes) -> None:
    """Hold a codec to what is true of any bytes: no error, no nonsense, however they are cut."""
    whole = CODECS[codec]()(data)
    for sample in whole:
        check_sample(sample[1] if isinstance(sample, tuple) and len(sample) == 2 else sample)
    size = 1 + len(data) % 37
    feed = CODECS[codec]()
    cut = [each for k in range(0, len(data), size) for each in feed(data[k : k + size])]
    # A refusal comes as early as it can be known; of two dialects, one tells first.
    if codec != "ntrip" and not (b"$" in data and SYNC in data):
        assert cut == whole


def check_sample(sample: Any) -> None:
    if isinstance(sample, GnssFix):
        assert abs(sample.lat_deg) <= 90.0 and abs(sample.lon_deg) <= 180.0
        assert math.isfinite(sample.alt_m) and 0.0 < sample.pos_std_m < math.inf
        assert all(map(math.isfinite, sample.velocity_mps or ()))
    elif isinstance(sample, GnssHeading):
        assert abs(sample.yaw_map_rad) <= math.pi and 0.0 < sample.std_rad < math.inf
    elif isinstance(sample, GnssStatus):
        assert len(sample.satellites) <= 200
        assert all(0.0 <= each.snr_db <= 255.0 for each in sample.satellites)
    elif isinstance(sample, BoardMessage):
        assert encode(0, sample), "what was read can be written again"
    elif isinstance(sample, ImuSample):
        assert all(map(math.isfinite, (*sample.accel_mps2, *sample.gyro_radps)))


class Tracer:
    """Collects the edges between lines of the drivers that ran."""

    def __init__(self) -> None:
        self.edges: set[Edge] = set()
        self._last = 0

    def __enter__(self) -> Tracer:
        self.edges = set()
        sys.settrace(self._enter_frame)
        return self

    def __exit__(self, *_: object) -> None:
        sys.settrace(None)

    def _enter_frame(self, frame: FrameType, event: str, arg: object) -> Any:
        code = frame.f_code
        if "drivers" not in code.co_filename or "tests" in code.co_filename:
            return None
        name = hash(code)

        def trace(inner: FrameType, event: str, arg: object) -> Any:
            if event == "line":
                self.edges.add((name, self._last, inner.f_lineno))
                self._last = inner.f_lineno
            return trace

        return trace


def mutate(rng: random.Random, corpus: list[bytes]) -> bytes:
    """Change one of the corpus at a few places, or splice two."""
    data = bytearray(rng.choice(corpus))
    for _ in range(1 << rng.randrange(4)):
        at = rng.randrange(len(data) + 1)
        kind = rng.randrange(7)
        if kind == 0 and data:
            data[at % len(data)] ^= 1 << rng.randrange(8)
        elif kind == 1 and data:
            data[at % len(data)] = rng.choice(
                b'\x00\x01\x7f\x80\xff\xb5\x62\xd3$*,-0189\r\n{}"[]:AG.'
            )
        elif kind == 2:
            del data[at : at + rng.randrange(1, 9)]
        elif kind == 3:
            data[at:at] = rng.randbytes(rng.randrange(1, 9))
        elif kind == 4:
            data[at:at] = data[at : at + rng.randrange(1, 40)]
        elif kind == 5:
            other = rng.choice(corpus)
            data[at:] = other[rng.randrange(len(other) + 1) :]
        else:
            data[at:at] = rng.choice(WORDS)
    return mend(rng, bytes(data[:LONGEST]))


WORDS = [
    b"nan", b"inf", b"-1", b"1e999", b"null", b"true", b"{}", b"[]", b"99999", b",,", b"$GNGGA,",
    b"$GPGSV,1,1,01,", b"\xb5\x62\x01\x07\x5c\x00", b"\xb5\x62\x01\x35\x08\x00", b"\xd3\x00",
    b"\r\n", b"HTTP/1.1 200", b"ICY 200", b"0\r\n\r\n", b'"class":"SKY",', b'"lat":',
]  # fmt: skip


def mend(rng: random.Random, data: bytes) -> bytes:
    """Make the checksums right that a change has broken, most of the time: behind them is code."""
    if rng.random() < 0.2:
        return data
    lines = data.split(b"\r\n")
    for k, line in enumerate(lines):
        if line.startswith(b"$") and b"*" in line:
            body = line[1 : line.rindex(b"*")]
            value = 0
            for byte in body:
                value ^= byte
            lines[k] = b"$" + body + b"*%02X" % value
    return mend_rosserial(mend_board(mend_ubx(b"\r\n".join(lines))))


def mend_board(data: bytes) -> bytes:
    pieces = data.split(b"\0")
    for k, piece in enumerate(pieces):
        body = unstuff(piece)
        if body is not None and len(body) > 3 and body[0] in FORMATS:
            crc = crc_hqx(body[:-2], 0).to_bytes(2, "little")
            pieces[k] = stuff(body[:-2] + crc)
    return b"\0".join(pieces)


def mend_rosserial(data: bytes) -> bytes:
    mended, at = bytearray(data), data.find(rosserial.SYNC)
    while at >= 0 and at + 8 <= len(mended):
        mended[at + 4] = 255 - sum(mended[at + 2 : at + 4]) % 256
        end = at + 7 + int.from_bytes(mended[at + 2 : at + 4], "little")
        if end < len(mended):
            mended[end] = 255 - sum(mended[at + 5 : end]) % 256
        at = mended.find(rosserial.SYNC, at + 2)
    return bytes(mended)


def mend_ubx(data: bytes) -> bytes:
    mended, at = bytearray(data), data.find(SYNC)
    while at >= 0 and at + 6 <= len(mended):
        end = at + 6 + int.from_bytes(mended[at + 4 : at + 6], "little")
        if end + 2 <= len(mended):
            mended[end : end + 2] = compute_checksum(bytes(mended[at + 2 : end]))
        at = mended.find(SYNC, at + 2)
    return bytes(mended)


def fuzz(codec: str, seed: int, is_over: Callable[[int], bool]) -> Iterator[bytes]:
    """Fuzz until `is_over` says so of the count of tries; gives every input with new edges."""
    rng, corpus = random.Random(seed), read_corpus(codec)
    tracer, known = Tracer(), set[Edge]()
    for data in corpus:
        with tracer:
            check(codec, data)
        known |= tracer.edges
    count = 0
    while not is_over(count):
        count += 1
        data = mutate(rng, corpus)
        try:
            with tracer:
                check(codec, data)
        except Exception as error:
            raise AssertionError(f"{codec} does not stand {data!r}") from error
        if tracer.edges - known:
            known |= tracer.edges
            corpus.append(data)
            yield data


def main() -> None:
    codec, seconds = sys.argv[1], float(sys.argv[2])
    end_s = time.process_time() + seconds
    for data in fuzz(codec, time.time_ns(), lambda count: time.process_time() > end_s):
        name = hashlib.sha1(data, usedforsecurity=False).hexdigest()[:12]
        (CORPUS / codec / name).write_bytes(data)
        sys.stderr.write(f"{codec}: {name}, {len(data)} bytes\n")


if __name__ == "__main__":
    main()
