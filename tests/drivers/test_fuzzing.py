"""No bytes whatever break a codec, become nonsense, or fill the memory."""

from __future__ import annotations

import random
import time

import pytest

from agribot.core.errors import AgribotError
from agribot.drivers.gnss.nmea import SentenceDecoder
from agribot.drivers.gnss.rtcm import RtcmDecoder
from agribot.drivers.gnss.ubx import UbxDecoder
from tests.drivers import codecs, fuzzing

TRIES = 200
NIGHTLY_CPU_S = 600.0  # of all codecs together
LINES = 50  # that a codec has to read while one of them speaks without a pause


@pytest.mark.parametrize("codec", codecs.CODECS)
def test_what_was_ever_found_and_what_is_like_it_is_read_without_an_error(codec: str) -> None:
    for found in fuzzing.fuzz(codec, 1, lambda count: count >= TRIES):
        assert len(found) <= fuzzing.LONGEST


@pytest.mark.nightly
@pytest.mark.parametrize("codec", codecs.CODECS)
def test_ten_minutes_of_fuzzing_find_nothing(codec: str) -> None:
    end_s = time.process_time() + NIGHTLY_CPU_S / len(codecs.CODECS)
    seed = time.time_ns()  # another one every night; a failure shows the bytes
    for found in fuzzing.fuzz(codec, seed, lambda count: time.process_time() > end_s):
        assert len(found) <= fuzzing.LONGEST


@pytest.mark.parametrize("codec", codecs.CODECS)
def test_a_codec_reads_fifty_times_what_its_line_carries(codec: str) -> None:
    best = 0.0
    for _ in range(10):  # a busy machine is slow for a while, a slow codec always
        best = max(best, codecs.measure_ratio(codec, 0.05))
        if best >= LINES:
            return
    pytest.fail(f"{codec} reads {best:.0f} < {LINES} times what {codecs.BAUD[codec]} baud carry")


def test_the_fuzzer_finds_a_fault_behind_a_checksum(monkeypatch: pytest.MonkeyPatch) -> None:
    def stumble(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("agribot.drivers.gnss.sky._read_gsv_satellite", stumble)
    monkeypatch.setattr(fuzzing, "read_corpus", lambda codec: [b"$GPGSV,1,1,00*79\r\n"])
    with pytest.raises(AssertionError, match="nmea does not stand"):
        list(fuzzing.fuzz("nmea", 1, lambda count: count >= 20_000))


@pytest.mark.parametrize(
    "filler", [b"\xb5\x62\x01\x07\xff\x1f", b"\xd3\x03\xff", b"$GN", b"{", b"A"]
)
def test_a_device_that_says_nonsense_for_long_fills_no_memory(filler: bytes) -> None:
    rng = random.Random(1)
    decoders = UbxDecoder(), SentenceDecoder(), RtcmDecoder()
    feeds = [make() for make in codecs.CODECS.values()]
    for _ in range(12):
        data = filler * 500 + rng.randbytes(500)
        for feed in (*feeds, *(decoder.feed for decoder in decoders)):
            try:
                feed(data)
            except AgribotError:
                pytest.fail("a codec refuses bytes by an error")
    assert len(decoders[0]._waiting) < 10_000
    assert len(decoders[1]._line) <= 256
    assert len(decoders[2]._waiting) <= 1029
