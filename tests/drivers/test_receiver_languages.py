"""Unicore's messages, SBF and UBX of before NAV-PVT become the fix that they mean."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyubx2 import GET, UBXMessage

from agribot.core.messages import GnssFix, GnssHeading, GnssQuality
from agribot.drivers.gnss.nmea import write_sentence
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder
from tests.drivers import maker_bytes as made
from tests.drivers import receiver_bytes as written

# The example of the manual, which has its checksum.
MANUAL = (
    b"#UNIHEADINGA,97,GPS,FINE,2190,365174000,0,0,18,12;INSUFFICIENT_OBS,NONE,0.0000,0.0000,0.0000,"
    b'0.0000,0.0000,0.0000,"",0,0,0,0,0,00,0,0*ee072604\r\n'
)
ECEF_CM = (-238607106, -392219051, 441436073)  # 44.0688096 N, 121.3143092 W, 1110.675 m
UTC_S = 1540500946.0  # 2018-10-25 20:55:46, GPS week 2024


def decode(*data: bytes) -> list[tuple[float, GnssFix]]:
    decoder = ReceiverDecoder(pytest.fail)
    found = [one for each in data for one in decoder.feed(each)]
    return [(stamp_s, fix) for stamp_s, fix in found if isinstance(fix, GnssFix)]


def make_ubx(name: str, second: int = 0, **fields: Any) -> bytes:
    data: bytes = UBXMessage("NAV", name, GET, iTOW=420964000 + 1000 * second, **fields).serialize()
    return data


def make_sol(
    second: int = 0, fix: int = 3, flags: tuple[int, int] = (1, 0), speed: int = 0
) -> bytes:
    is_ok, is_differential = flags
    return make_ubx(
        "NAV-SOL", second, fTOW=4363, week=2024, gpsFix=fix, gpsfixOK=is_ok,
        diffSoln=is_differential, wknSet=1, towSet=1, ecefX=ECEF_CM[0], ecefY=ECEF_CM[1],
        ecefZ=ECEF_CM[2], pAcc=165, ecefVX=speed, ecefVY=0, ecefVZ=0, sAcc=2, pDOP=1.73, numSV=9,
    )  # fmt: skip


def make_time(second: int = 0) -> bytes:
    return make_ubx("NAV-TIMEGPS", second, fTOW=4363, week=2024, leapS=18, towValid=1, weekValid=1,
                    leapSValid=1, tAcc=3)  # fmt: skip


@pytest.mark.parametrize(
    "data",
    [
        made.make_unicore_line("BESTNAV", made.make_bestnav_text()),
        made.make_unicore_frame(2118, made.make_bestnav_body()),
    ],
)
def test_bestnav_is_read_in_both_forms(data: bytes) -> None:
    ((stamp_s, fix),) = decode(data)
    assert (fix.lat_deg, fix.lon_deg) == pytest.approx((made.LAT_DEG, made.LON_DEG), abs=1e-10)
    assert fix.alt_m == pytest.approx(made.ALT_M + made.GEOID_M)
    assert fix.quality is GnssQuality.RTK_FIXED
    assert fix.pos_std_m == pytest.approx(0.00707, rel=1e-3)
    assert fix.velocity_mps == pytest.approx((0.5, 0.0, 0.01), abs=1e-6)
    assert fix.velocity_std_mps == pytest.approx(0.03)
    assert stamp_s == made.WEEK * 604_800.0 + made.TIME_MS * 1e-3


@pytest.mark.parametrize(
    ("kind", "number", "quality", "unmeasured"),
    [
        ("SINGLE", 16, GnssQuality.SINGLE, ""), ("PSRDIFF", 17, GnssQuality.DGNSS, ""),
        ("NARROW_FLOAT", 34, GnssQuality.RTK_FLOAT, ""),
        ("INS_RTKFIXED", 56, GnssQuality.RTK_FIXED, ""),
        ("INS", 52, GnssQuality.NONE, "dead reckoning"), ("FIXEDPOS", 1, GnssQuality.NONE, "held"),
    ],
)  # fmt: skip
def test_a_type_of_position_of_unicore_is_the_quality_of_the_fix(
    kind: str, number: int, quality: GnssQuality, unmeasured: str
) -> None:
    text = made.make_unicore_line("BESTNAV", made.make_bestnav_text(kind))
    binary = made.make_unicore_frame(2118, made.make_bestnav_body(number))
    for _, fix in decode(text) + decode(binary):
        assert fix.quality is quality and fix.unmeasured == unmeasured


def test_the_example_of_unicores_manual_has_the_right_checksum_and_no_heading() -> None:
    decoder = ReceiverDecoder(pytest.fail)
    assert not any(isinstance(one, GnssHeading) for _, one in decoder.feed(MANUAL))
    assert decoder.heard.read == {"UNIHEADING": 1} and decoder.broken == 0
    decoder.feed(MANUAL.replace(b"365174000", b"365174001"))
    assert decoder.broken == 1


def test_a_bestnav_without_a_solution_gives_no_fix() -> None:
    body = made.make_bestnav_text("NONE", "INSUFFICIENT_OBS")
    assert decode(made.make_unicore_line("BESTNAV", body)) == []
    assert decode(made.make_unicore_frame(2118, made.make_bestnav_body(0, status=1))) == []


def test_sbf_is_read_with_its_covariances() -> None:
    epochs = [
        made.make_pvt_geodetic(time_ms=k * 100)
        + made.make_pos_cov(0.01, time_ms=k * 100)
        + made.make_vel_cov(0.02, time_ms=k * 100)
        for k in range(3)
    ]
    fixes = decode(*epochs)
    stamp_s, fix = fixes[1]
    assert len(fixes) == 3
    assert (fix.lat_deg, fix.lon_deg) == pytest.approx((made.LAT_DEG, made.LON_DEG), abs=1e-10)
    assert fix.alt_m == pytest.approx(made.ALT_M + made.GEOID_M)
    assert fix.quality is GnssQuality.RTK_FIXED
    assert fix.pos_std_m == pytest.approx(0.01, rel=1e-5)
    assert fix.velocity_mps == pytest.approx((0.5, 0.0, 0.01), abs=1e-6)
    assert fix.velocity_std_mps == pytest.approx(0.02, rel=1e-5)
    assert stamp_s - fixes[0][0] == pytest.approx(0.1)


def test_without_covariances_sbf_states_twice_the_root_mean_square() -> None:
    fixes = decode(*(made.make_pvt_geodetic(time_ms=k * 100, accuracy_m=0.04) for k in range(3)))
    assert fixes[0][1].pos_std_m == pytest.approx(0.04 / 2.0 / math.sqrt(2.0))


@pytest.mark.parametrize(
    ("mode", "quality", "unmeasured"),
    [(1, 1, ""), (2, 2, ""), (5, 5, ""), (6, 2, ""), (3, 0, "held")],
)
def test_a_mode_of_sbf_is_the_quality_of_the_fix(mode: int, quality: int, unmeasured: str) -> None:
    fixes = decode(*(made.make_pvt_geodetic(mode, time_ms=k * 100) for k in range(2)))
    assert (fixes[0][1].quality, fixes[0][1].unmeasured) == (quality, unmeasured)


def test_sbf_with_an_error_or_without_a_position_gives_no_fix() -> None:
    for bad in ({"mode": 0}, {"error": 1}):
        assert decode(*(made.make_pvt_geodetic(time_ms=k * 100, **bad) for k in range(3))) == []


def test_a_receiver_of_before_nav_pvt_is_read_by_nav_sol_alone() -> None:
    fixes = decode(*(make_sol(k, speed=100) + make_time(k) for k in range(3)))
    stamps_s = [stamp_s for stamp_s, _ in fixes]
    fix = fixes[-1][1]
    assert (fix.lat_deg, fix.lon_deg) == pytest.approx((44.068809596, -121.314309171), abs=1e-8)
    assert fix.alt_m == pytest.approx(1110.675, abs=0.01)
    assert fix.pos_std_m == pytest.approx(1.65 / math.sqrt(2.0))
    assert fix.velocity_mps == pytest.approx((0.8543, 0.3615, -0.3737), abs=1e-3)
    assert fix.velocity_std_mps == pytest.approx(0.02)
    assert stamps_s[-1] == pytest.approx(UTC_S + 2.0, abs=0.01)


def test_its_other_messages_state_place_and_velocity_more_finely() -> None:
    epochs = [
        make_ubx("NAV-POSLLH", k, lon=4.51, lat=52.15, height=56500, hMSL=11500, hAcc=1400, vAcc=1)
        + make_ubx("NAV-STATUS", k, gpsFix=3, gpsFixOk=1, diffSoln=1)
        + make_ubx("NAV-VELNED", k, velN=30, velE=40, velD=0, speed=50, gSpeed=50, sAcc=8)
        for k in range(3)
    ]
    fixes = decode(*epochs)
    fix = fixes[1][1]
    assert len(fixes) == 3 and fix.quality is GnssQuality.DGNSS
    assert (fix.lat_deg, fix.lon_deg, fix.alt_m) == pytest.approx((52.15, 4.51, 56.5))
    assert fix.pos_std_m == pytest.approx(1.4 / math.sqrt(2.0))
    assert fix.velocity_mps == pytest.approx((0.4, 0.3, 0.0))


@pytest.mark.parametrize(
    ("fix", "flags", "quality", "unmeasured"),
    [(2, (1, 0), 1, ""), (3, (1, 1), 2, ""), (4, (1, 0), 1, ""),
     (1, (1, 0), 0, "dead reckoning"), (5, (1, 0), 0, "held")],
)  # fmt: skip
def test_a_fix_of_nav_sol_has_its_kind(
    fix: int, flags: tuple[int, int], quality: int, unmeasured: str
) -> None:
    found = decode(*(make_sol(k, fix, flags) for k in range(2)))[0][1]
    assert (found.quality, found.unmeasured) == (quality, unmeasured)


@pytest.mark.parametrize(("fix", "flags"), [(0, (0, 0)), (3, (0, 0))])
def test_a_nav_sol_that_is_not_good_gives_no_fix(fix: int, flags: tuple[int, int]) -> None:
    assert decode(*(make_sol(k, fix, flags) for k in range(3))) == []


def test_a_place_without_a_word_on_whether_it_is_one_gives_no_fix() -> None:
    place = {"lon": 4.51, "lat": 52.15, "height": 56500, "hMSL": 11500, "hAcc": 1400, "vAcc": 1}
    assert decode(*(make_ubx("NAV-POSLLH", k, **place) for k in range(3))) == []


def test_sentences_beside_such_a_place_count() -> None:
    place = {"lon": 4.51, "lat": 52.15, "height": 56500, "hMSL": 11500, "hAcc": 1400, "vAcc": 1}
    gga = "GNGGA,09301{second}.00,5209.0,N,00430.6,E,4,12,0.9,11.5,M,45.0,M,,"
    data = [
        make_ubx("NAV-POSLLH", k, **place) + write_sentence(gga.format(second=k)) for k in range(4)
    ]
    assert {fix.quality for _, fix in decode(*data)} == {GnssQuality.RTK_FIXED}


def test_where_nav_pvt_comes_too_it_alone_counts() -> None:
    data = b"".join(written.make_ubx_pvt() + make_sol(k) for k in range(3))
    assert {round(fix.lat_deg, 6) for _, fix in decode(data)} == {round(written.LAT_DEG, 6)}


def test_sentences_beside_a_language_that_states_more_give_no_second_fix() -> None:
    gga = write_sentence("GNGGA,093015.00,5209.0,N,00430.6,E,4,12,0.9,11.5,M,45.0,M,,")
    bestnav = made.make_unicore_line("BESTNAV", made.make_bestnav_text())
    assert [fix.lat_deg for _, fix in decode(bestnav, gga * 2)] == [made.LAT_DEG]


@settings(deadline=None)
@given(st.integers(1, 300), st.integers(0, 2**32 - 1))
def test_any_way_of_cutting_the_stream_gives_the_same_fixes(size: int, seed: int) -> None:
    noise = random.Random(seed).randbytes(30).replace(b"\xb5", b"")  # a UBX frame would wait
    streams = (
        made.make_unicore_line("BESTNAV", made.make_bestnav_text()) * 2,
        made.make_unicore_frame(2118, made.make_bestnav_body()) * 2,
        made.make_pvt_geodetic() + made.make_pos_cov(0.01) + made.make_pvt_geodetic(time_ms=100),
        make_sol(0) + make_sol(1) + make_sol(2),
    )
    for stream in streams:
        data = noise + stream + noise + stream
        cut = [data[k : k + size] for k in range(0, len(data), size)]
        assert decode(*cut) == decode(data) != []
