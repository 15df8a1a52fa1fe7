"""Bytes of a receiver become the fix that it meant, and no other bytes become one."""

from __future__ import annotations

import datetime as dt
import itertools
import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agribot.core.messages import GnssFix, GnssQuality
from agribot.drivers.gnss import gpsd, nmea, nmea_fixes, nmea_places, ubx
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder
from tests.drivers import receiver_bytes as written

SECOND = dt.timedelta(seconds=1)
METRE_DEG = 1.0 / 111_320.0


def decode(data: bytes) -> list[tuple[float, GnssFix]]:
    refused: list[str] = []
    found = ReceiverDecoder(refused.append).feed(data)
    assert not refused
    return [(stamp_s, fix) for stamp_s, fix in found if isinstance(fix, GnssFix)]


def test_a_navigation_solution_in_ubx_is_read_to_the_centimetre() -> None:
    ((stamp_s, fix),) = decode(written.make_ubx_pvt(carrier=2, h_acc_m=0.014))
    assert stamp_s == pytest.approx(written.EPOCH.timestamp(), abs=1e-6)
    assert fix.lat_deg == pytest.approx(written.LAT_DEG, abs=1e-7)
    assert fix.lon_deg == pytest.approx(written.LON_DEG, abs=1e-7)
    assert fix.alt_m == pytest.approx(written.ALT_M + written.GEOID_M)
    assert fix.quality is GnssQuality.RTK_FIXED
    assert fix.pos_std_m == pytest.approx(0.014 / math.sqrt(2.0))
    assert fix.velocity_mps == pytest.approx((0.3, 0.4, 0.0), abs=1e-3)


@pytest.mark.parametrize(
    ("carrier", "quality"),
    [(0, GnssQuality.SINGLE), (1, GnssQuality.RTK_FLOAT), (2, GnssQuality.RTK_FIXED)],
)
def test_ubx_tells_the_state_of_the_carrier(carrier: int, quality: GnssQuality) -> None:
    ((_, fix),) = decode(written.make_ubx_pvt(carrier=carrier))
    assert fix.quality is quality


def test_a_receiver_without_a_valid_position_gives_no_fix() -> None:
    assert decode(written.make_ubx_pvt(is_ok=False)) == []
    assert decode(b"".join(written.make_nmea(quality=0)) * 2) == []


def test_a_place_of_zeros_is_no_fix_whatever_the_receiver_calls_it() -> None:
    pvt, sentences = written.make_ubx_pvt(lat_deg=0.0, lon_deg=0.0), b""
    for k in range(2):
        at = written.EPOCH + k * SECOND
        sentences += b"".join(written.make_nmea(at, lat_deg=0.0, lon_deg=0.0))
    precise = written.make_ubx_hpposllh(written.EPOCH, 0.0, 0.0)
    assert decode(pvt) == decode(precise + pvt) == decode(sentences) == []
    (frame,) = ubx.UbxDecoder().feed(pvt)
    assert ubx.lacks_fix(frame)
    assert any(nmea_places.lacks_fix(one) for one in nmea.SentenceDecoder().feed(sentences))
    equator = written.make_ubx_pvt(lat_deg=0.0, lon_deg=9.5)
    assert [fix.lat_deg for _, fix in decode(equator)] == [0.0]
    refused: list[str] = []
    report = {"class": "TPV", "mode": 3, "time": "2026-05-04T09:30:18Z", "lat": 0, "lon": 0}
    fixes = gpsd.GpsdFixes(refused.append)
    assert fixes.add(report) is None
    assert fixes.lacks_fix and not refused


def test_millimetres_of_a_second_message_refine_the_fix_of_their_epoch() -> None:
    lat_deg = written.LAT_DEG + 0.004 * METRE_DEG
    data = b""
    for k in range(4):
        at = written.EPOCH + k * SECOND
        data += written.make_ubx_pvt(at) + written.make_ubx_hpposllh(at, lat_deg, written.LON_DEG)
    fixes = decode(data)
    stamps = [stamp_s for stamp_s, _ in fixes]
    assert stamps == sorted(set(stamps)) and len(stamps) == 4
    assert all(fix.lat_deg == pytest.approx(lat_deg, abs=2e-9) for _, fix in fixes[1:])


def test_a_fix_whose_millimetres_fail_to_come_is_told_without_them() -> None:
    first, second = written.EPOCH, written.EPOCH + SECOND
    data = written.make_ubx_pvt(first)
    data += written.make_ubx_hpposllh(first, written.LAT_DEG, written.LON_DEG)
    data += written.make_ubx_pvt(second) + written.make_ubx_pvt(second + SECOND)
    assert len(decode(data)) == 3


def test_sentences_of_an_epoch_make_one_fix_with_its_accuracy_and_velocity() -> None:
    data = b"".join(
        b"".join(written.make_nmea(written.EPOCH + k * SECOND, quality=4)) for k in range(3)
    )
    fixes = decode(data)
    stamps = [stamp_s for stamp_s, _ in fixes]
    assert len(fixes) == 3 and stamps[2] - stamps[0] == pytest.approx(2.0)
    fix = fixes[1][1]
    assert fix.lat_deg == pytest.approx(written.LAT_DEG, abs=2e-7)
    assert fix.quality is GnssQuality.RTK_FIXED
    assert fix.pos_std_m == pytest.approx(0.8)
    assert fix.alt_m == pytest.approx(written.ALT_M + written.GEOID_M)
    assert fix.velocity_mps == pytest.approx((0.5, 0.0, math.nan), abs=2e-3, nan_ok=True)


def test_after_the_first_epoch_a_fix_waits_for_no_later_sentence() -> None:
    decoder = ReceiverDecoder(pytest.fail)
    for sentence in written.make_nmea():
        assert decoder.feed(sentence) == []
    counts = [
        sum(isinstance(sample, GnssFix) for _, sample in decoder.feed(sentence))
        for sentence in written.make_nmea(written.EPOCH + SECOND)
    ]
    assert counts == [1, 0, 1]  # the first epoch's, and the second's with its own last sentence


@pytest.mark.parametrize(("lat_deg", "lon_deg"), [(-33.86, 151.2), (21.16, 72.78), (-12.0, -77.0)])
def test_every_quarter_of_the_globe_keeps_its_signs(lat_deg: float, lon_deg: float) -> None:
    sentences = b"".join(written.make_nmea(lat_deg=lat_deg, lon_deg=lon_deg)) * 1
    sentences += b"".join(written.make_nmea(written.EPOCH + SECOND))
    for data in (sentences, written.make_ubx_pvt(lat_deg=lat_deg, lon_deg=lon_deg)):
        fix = decode(data)[0][1]
        assert fix.lat_deg == pytest.approx(lat_deg, abs=2e-7)
        assert fix.lon_deg == pytest.approx(lon_deg, abs=2e-7)


def test_midnight_does_not_take_time_back() -> None:
    late = written.EPOCH.replace(hour=23, minute=59, second=58)
    data = b"".join(b"".join(written.make_nmea(late + k * SECOND)) for k in range(5))
    stamps = [stamp_s for stamp_s, _ in decode(data)]
    assert [b - a for a, b in itertools.pairwise(stamps)] == pytest.approx([1.0] * 4)


def test_of_a_receiver_that_speaks_both_the_one_that_tells_accuracy_counts() -> None:
    data = b""
    for k in range(3):
        at = written.EPOCH + k * SECOND
        data += written.make_ubx_pvt(at, h_acc_m=0.02) + b"".join(written.make_nmea(at, std_m=None))
    assert [fix.pos_std_m for _, fix in decode(data)] == pytest.approx([0.02 / math.sqrt(2)] * 3)


def test_a_receiver_that_lost_its_settings_and_goes_on_in_sentences_is_read_on() -> None:
    decoder = ReceiverDecoder(lambda text: None)
    decoder.feed(written.make_ubx_pvt(), 0.0)
    found = []
    for k in range(1, 6):
        sentences = b"".join(written.make_nmea(written.EPOCH + k * SECOND))
        found += [k for _, one in decoder.feed(sentences, float(k)) if isinstance(one, GnssFix)]
    assert found == [3, 4, 5]


@given(st.integers(1, 400), st.integers(0, 2**32 - 1))
def test_any_way_of_cutting_the_stream_gives_the_same_fixes(size: int, seed: int) -> None:
    rng = random.Random(seed)
    noise = rng.randbytes(30)
    data = noise + written.make_ubx_pvt() + b"".join(written.make_nmea()) + noise
    data += written.make_ubx_pvt(written.EPOCH + SECOND)
    decoder = ReceiverDecoder(lambda text: None)
    found = [fix for k in range(0, len(data), size) for fix in decoder.feed(data[k : k + size])]
    assert found == ReceiverDecoder(lambda text: None).feed(data)


@given(st.binary(max_size=600), st.integers(0, 10_000), st.integers(0, 255))
def test_no_bytes_break_the_decoders_and_a_changed_byte_makes_no_other_fix(
    junk: bytes, at: int, value: int
) -> None:
    decoder = ReceiverDecoder(lambda text: None)
    decoder.feed(junk)
    frame = bytearray(written.make_ubx_pvt())
    place = at % len(frame)
    is_changed = frame[place] != value
    frame[place] = value
    found = ReceiverDecoder(lambda text: None).feed(bytes(frame))
    assert len(found) == (0 if is_changed else 1)


def test_a_frame_is_found_after_a_false_start_of_another() -> None:
    decoder = ubx.UbxDecoder()
    frames = decoder.feed(ubx.SYNC + b"\x01\x07\x5c\x00" + written.make_ubx_pvt() * 3)
    assert len(frames) >= 2 and decoder.bad == 1
    assert ubx.make_frame(frames[0].kind, frames[0].payload) == written.make_ubx_pvt()


@pytest.mark.parametrize(
    "line", ["GNGGA,,,,,,0,,,,,,,,", "GNGGA,093015.00,5260.0,N,00430.6,E,1,12,0.9,11,M,45,M,,",
             "GNGGA,093015.00,nan,N,00430.6,E,1,12,0.9,11,M,45,M,,", "GNGGA,093015.00",
             "GNGGA,993015.00,5209.0,N,00430.6,E,1,12,0.9,11,M,45,M,,"],
)  # fmt: skip
def test_a_sentence_that_says_nothing_or_nonsense_gives_no_fix(line: str) -> None:
    checksum = 0
    for byte in line.encode():
        checksum ^= byte
    refused: list[str] = []
    decoder = nmea.SentenceDecoder()
    fixes = nmea_fixes.NmeaFixes(refused.append)
    for text in (f"${line}*{checksum:02X}\r\n".encode(), *written.make_nmea()):
        found = [fix for sentence in decoder.feed(text) for fix in fixes.add(sentence)]
        assert not any(fix.fix.lat_deg != pytest.approx(written.LAT_DEG) for fix in found)


@pytest.mark.parametrize(("status", "unmeasured"), [(1, ""), (5, "dead reckoning"), (7, "held")])
def test_gpsd_names_a_place_without_satellites(status: int, unmeasured: str) -> None:
    report = {"class": "TPV", "mode": 3, "status": status, "time": "2026-05-04T09:30:18Z",
              "lat": 52.15, "lon": 4.51, "altHAE": 56.5}  # fmt: skip
    found = gpsd.GpsdFixes(pytest.fail).add(report)
    assert found is not None and found.fix.unmeasured == unmeasured
    assert found.fix.quality is (GnssQuality.NONE if unmeasured else GnssQuality.SINGLE)
