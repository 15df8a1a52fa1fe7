"""Coverage-guided fuzzing of the codecs: bytes that reach new code are kept and changed further.

`python -m tests.drivers.fuzzing CODEC SECONDS` looks for more, adds what it finds to the corpus
in `tests/drivers/corpus/CODEC`, and names the bytes that break something.
Source of the method: Zalewski, "American fuzzy lop", technical details (edges, havoc, splicing).
"""

from __future__ import annotations

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
from agribot.drivers.board import rosserial, vesc_packets
from agribot.drivers.board.board_codec import FORMATS, encode, stuff, unstuff
from agribot.drivers.board.board_protocol import BoardMessage
from agribot.drivers.board.motor_board import BoardReport, StampedReport
from agribot.drivers.gnss.ubx import SYNC, compute_checksum
from tests.drivers.codecs import CODECS, write_seeds
from tests.drivers.maker_bytes import compute_crc32

CORPUS = Path(__file__).parent / "corpus"
DIALECTS = (b"$", SYNC, b"#", b"\xaa\x44\xb5", b"$@")  # what their messages begin with
LONGEST = 2000
Edge = tuple[int, int, int]


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
    # A refusal comes as early as possible; of two dialects, one shows it first.
    if codec != "ntrip" and sum(mark in data for mark in DIALECTS) < 2:
        assert cut == whole


def check_sample(sample: Any) -> None:
    if isinstance(sample, GnssFix):
        assert abs(sample.lat_deg) <= 90.0 and abs(sample.lon_deg) <= 180.0
        assert not math.isinf(sample.alt_m) and 0.0 < sample.pos_std_m < math.inf
        assert all(map(math.isfinite, (sample.velocity_mps or ())[:2]))
    elif isinstance(sample, GnssHeading):
        assert abs(sample.yaw_map_rad) <= math.pi and 0.0 < sample.std_rad < math.inf
    elif isinstance(sample, GnssStatus):
        assert len(sample.satellites) <= 200
        assert all(0.0 <= each.snr_db <= 255.0 for each in sample.satellites)
    elif isinstance(sample, BoardMessage):
        assert encode(0, sample), "what was read can be written again"
    elif isinstance(sample, StampedReport):
        check_report(sample.report)
    elif isinstance(sample, ImuSample):
        assert all(map(math.isfinite, (*(sample.accel_mps2 or ()), *sample.gyro_radps)))


def check_report(report: BoardReport) -> None:
    wheels, battery = report.wheels, report.battery
    assert wheels is not None and report.board is not None
    assert all(map(math.isfinite, (*wheels.angle_rad, *wheels.speed_radps)))
    assert battery is None or math.isfinite(battery.voltage_v)
    assert bool(wheels.faults) == (report.board.fault is not None)


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
                b'\x00\x01\x02\x03\x7f\x80\xff\xb5\x62\xd3$*,-0189\r\n{}"[]:AG.'
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
    b"\xb5\x62\x05\x01\x02\x00\x06\x8a", b"\x02\x15\x32", b"0.5 1\r\n", b"8\r\n",
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
    mended = mend_makers(b"\r\n".join(lines))
    return mend_vesc(mend_rosserial(mend_board(mend_ubx(mended))))


def mend_makers(data: bytes) -> bytes:
    """Repair the text behind a # and after the sync words of Unicore and Septentrio."""
    lines = data.split(b"\r\n")
    for k, line in enumerate(lines):
        if line.startswith(b"#") and b"*" in line:
            body = line[1 : line.rindex(b"*")]
            lines[k] = b"#%b*%08x" % (body, compute_crc32(body))
    mended = bytearray(b"\r\n".join(lines))
    at = mended.find(b"\xaa\x44\xb5")
    while at >= 0 and at + 24 <= len(mended):
        end = at + 24 + int.from_bytes(mended[at + 6 : at + 8], "little")
        if end + 4 <= len(mended):
            checksum = compute_crc32(bytes(mended[at:end]))
            mended[end : end + 4] = checksum.to_bytes(4, "little")
        at = mended.find(b"\xaa\x44\xb5", at + 3)
    at = mended.find(b"$@")
    while at >= 0 and at + 8 <= len(mended):
        end = at + int.from_bytes(mended[at + 6 : at + 8], "little")
        if end <= len(mended) and end > at + 4:
            mended[at + 2 : at + 4] = crc_hqx(bytes(mended[at + 4 : end]), 0).to_bytes(2, "little")
        at = mended.find(b"$@", at + 2)
    return bytes(mended)


def mend_vesc(data: bytes) -> bytes:
    mended, at = bytearray(data), data.find(bytes((vesc_packets.SHORT,)))
    while at >= 0 and at + 2 < len(mended):
        end = at + 2 + mended[at + 1]
        if mended[end + 2 : end + 3] == bytes((vesc_packets.END,)):
            mended[end : end + 2] = crc_hqx(bytes(mended[at + 2 : end]), 0).to_bytes(2, "big")
        at = mended.find(bytes((vesc_packets.SHORT,)), at + 1)
    return bytes(mended)


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
