"""Whatever sentences a receiver sends, its place is read with what it states, and nothing more."""

from __future__ import annotations

import math
from typing import Any

import pytest

from agribot.core.messages import GnssFix, GnssQuality
from agribot.drivers.gnss.nmea import BARE_SENTENCES, write_sentence
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder

PLACE = "5209.00000,N,00430.60000,E"
LAT_DEG, LON_DEG = 52.15, 4.51
GGA = f"GNGGA,{{time}},{PLACE},{{quality}},12,0.9,11.5,M,45.0,M,,"
RMC = f"GNRMC,{{time}},A,{PLACE},1.0,90.0,040526,,,A"


def decode(*bodies: str, pauses_s: tuple[float, ...] = ()) -> list[GnssFix]:
    """Decode sentences; `pauses_s` go before each, else none do."""
    decoder, t_s, found = ReceiverDecoder(pytest.fail), 0.0, []
    for k, body in enumerate(bodies):
        t_s += pauses_s[k] if pauses_s else 0.0
        found += decoder.feed(write_sentence(body), t_s)
    found += decoder.feed(b"", t_s + 1.0)
    return [fix for _, fix in found if isinstance(fix, GnssFix)]


@pytest.mark.parametrize(
    ("body", "quality"),
    [
        (f"GPRMC,093015.00,A,{PLACE},1.0,90.0,040526,,", GnssQuality.SINGLE),
        (f"GPRMC,093015.00,A,{PLACE},1.0,90.0,040526,,,R,V", GnssQuality.RTK_FIXED),
        (f"GPGLL,{PLACE},093015.00,A", GnssQuality.SINGLE),
        (f"GPGLL,{PLACE},093015.00,A,F", GnssQuality.RTK_FLOAT),
        (f"GNGNS,093015.00,{PLACE},AANN,13,0.93,11.5,45.0,,", GnssQuality.SINGLE),
        (f"GNGNS,093015.00,{PLACE},RRNN,13,0.93,11.5,45.0,,", GnssQuality.RTK_FIXED),
        (f"GNGGA,093015.00,{PLACE},9,12,0.9,11.5,M,45.0,M,,", GnssQuality.DGNSS),
    ],
)
def test_a_receiver_with_one_kind_of_sentence_has_a_place(body: str, quality: GnssQuality) -> None:
    (fix,) = decode(body)
    assert (fix.lat_deg, fix.lon_deg) == pytest.approx((LAT_DEG, LON_DEG), abs=1e-9)
    assert fix.quality is quality and not fix.unmeasured


@pytest.mark.parametrize(
    "body",
    [
        f"GPRMC,093015.00,V,{PLACE},1.0,90.0,040526,,",
        f"GPRMC,093015.00,A,{PLACE},1.0,90.0,040526,,,N",
        f"GPGLL,{PLACE},093015.00,V,N",
        f"GNGNS,093015.00,{PLACE},NNNN,00,99.9,11.5,45.0,,",
        f"GNGGA,093015.00,{PLACE},0,03,,11.5,M,45.0,M,,",
        f"GNGGA,093015.00,{PLACE},1,00,3.3,11.5,M,45.0,M,,",
        f"GNGGA,093015.00,{PLACE},,03,2.5,11.5,M,45.0,M,,",
        f"GNGGA,093015.00,{PLACE},8,12,0.9,11.5,M,45.0,M,,",
    ],
)
def test_a_place_that_the_receiver_does_not_vouch_for_is_none(body: str) -> None:
    assert decode(body) == []


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (f"GNGGA,093015.00,{PLACE},6,00,9.9,11.5,M,45.0,M,,", "dead reckoning"),
        (f"GNRMC,093015.00,A,{PLACE},1.0,90.0,040526,,,E", "dead reckoning"),
        (f"GNGGA,093015.00,{PLACE},7,00,9.9,11.5,M,45.0,M,,", "held"),
    ],
)
def test_a_place_without_satellites_is_named_so_and_has_no_quality(body: str, why: str) -> None:
    (fix,) = decode(body)
    assert fix.unmeasured == why and fix.quality is GnssQuality.NONE


def test_where_gga_counts_no_satellite_another_sentence_may_know_better() -> None:
    gns = f"GNGNS,093015.00,{PLACE},NDD,11,1.3,11.5,45.0,,"
    (fix,) = decode(gns, f"GNGGA,093015.00,{PLACE},2,00,1.3,11.5,M,45.0,M,,")
    assert fix.quality is GnssQuality.DGNSS


def test_sentences_of_other_times_are_other_epochs() -> None:
    gll = f"INGLL,{PLACE},093016,A"
    fixes = decode(RMC.format(time="093015"), gll, GGA.format(time="093017", quality=2))
    assert [fix.quality for fix in fixes] == [1, 1, 2]
    assert [math.isnan(fix.alt_m) for fix in fixes] == [True, True, False]


def test_a_place_without_altitude_or_geoid_separation_has_none() -> None:
    empty = f"GNGGA,093015.00,{PLACE},4,12,0.8,,M,,M,1.0,0000"
    over_sea = f"GNGGA,093016.00,{PLACE},4,12,0.8,101.2,M,,M,1.0,0000"
    whole = GGA.format(time="093017.00", quality=4)
    first, second, third = (fix.alt_m for fix in decode(empty, over_sea, whole))
    assert math.isnan(first) and math.isnan(second)
    assert third == pytest.approx(56.5)


@pytest.mark.parametrize(
    ("rmc", "vtg", "velocity_mps"),
    [
        ("0.778,", "", None),
        ("0.778,90.0", "", (0.4002, 0.0, math.nan)),
        ("0.000,", "", (0.0, 0.0, math.nan)),
        ("0.778,", "90.0,T,,M,0.778,N,1.44,K,A", (0.4002, 0.0, math.nan)),
        ("0.778,", ",T,,M,0.778,N,1.44,K,A", None),
        (",", "90.0,T,,M,0.778,N,1.44,K,N", None),
    ],
)
def test_a_velocity_needs_both_speed_and_course_unless_the_receiver_stands(
    rmc: str, vtg: str, velocity_mps: tuple[float, ...] | None
) -> None:
    bodies = [GGA.format(time="093015.00", quality=4)]
    bodies += [f"GNRMC,093015.00,A,{PLACE},{rmc},040526,,,R"]
    (fix,) = decode(*bodies, *([f"GNVTG,{vtg}"] if vtg else []))
    expected = None if velocity_mps is None else pytest.approx(velocity_mps, abs=1e-3, nan_ok=True)
    assert fix.velocity_mps == expected


@pytest.mark.parametrize("begins", [True, False])
def test_a_course_without_a_time_belongs_to_the_epoch_that_it_is_nearer_to(begins: bool) -> None:
    bodies, pauses_s = [], []
    for second in range(4):
        gga = GGA.format(time=f"09301{second}.00", quality=1)
        vtg = f"GNVTG,0.0,T,,M,{second}.0,N,,K,A"
        bodies += [vtg, gga] if begins else [gga, vtg]
        pauses_s += [0.9, 0.1]
    speeds_mps = [
        fix.velocity_mps and fix.velocity_mps[1] for fix in decode(*bodies, pauses_s=(*pauses_s,))
    ]
    expected_mps = [second * 1852.0 / 3600.0 for second in range(4)]
    assert speeds_mps[1:] == pytest.approx(expected_mps[1:])


@pytest.mark.parametrize(("digits", "least_m"), [("09.00", 5.35), ("09.0000", 0.0535)])
def test_a_place_is_not_surer_than_its_last_digit(digits: str, least_m: float) -> None:
    (fix,) = decode(f"GNGGA,093015.00,52{digits},N,00430.60,E,4,12,0.9,11.5,M,45.0,M,,")
    assert fix.pos_std_m == pytest.approx(least_m, rel=1e-2)


def test_a_stream_without_any_checksum_is_read_after_some_sentences() -> None:
    decoder = ReceiverDecoder(pytest.fail)
    found: list[Any] = []
    for second in range(10, 20):
        assert bool(found) == (second - 10 >= BARE_SENTENCES)
        body = GGA.format(time=f"0930{second}.00", quality=1)
        found += decoder.feed(f"${body}\r\n".encode())
    fixes = [fix for _, fix in found if isinstance(fix, GnssFix)]
    assert len(fixes) == 10 and decoder.broken == 0


def test_a_sentence_without_a_checksum_is_broken_where_others_have_one() -> None:
    decoder = ReceiverDecoder(pytest.fail)
    decoder.feed(write_sentence(GGA.format(time="093015.00", quality=1)))
    for second in range(16, 30):
        body = GGA.format(time=f"0930{second}.00", quality=1)
        assert decoder.feed(f"${body}\r\n".encode()) == []
    assert decoder.broken == 14


def test_an_epoch_whose_last_sentence_is_lost_is_given_at_the_next_pause() -> None:
    decoder = ReceiverDecoder(pytest.fail)
    for second in (10, 11):
        for body in (GGA.format(time=f"0930{second}.00", quality=1),
                     RMC.format(time=f"0930{second}.00")):  # fmt: skip
            decoder.feed(write_sentence(body), float(second))
    assert decoder.feed(write_sentence(GGA.format(time="093012.00", quality=1)), 12.0) == []
    found = [fix for _, fix in decoder.feed(b"", 12.6) if isinstance(fix, GnssFix)]
    assert len(found) == 1 and found[0].velocity_mps is None


def test_a_quectel_receiver_states_accuracy_and_velocity_in_sentences_of_its_own() -> None:
    fixes = decode(
        GGA.format(time="093015.000", quality=4),
        "PQTMVEL,1,093015.000,0.300,0.400,-0.100,0.500,0.510,53.13,0.1,0.1,1.0",
        "PQTMEPE,2,0.012,0.016,0.030,0.020,0.036",
    )
    assert fixes[0].pos_std_m == pytest.approx(0.01414, rel=1e-3)
    assert fixes[0].velocity_mps == pytest.approx((0.4, 0.3, 0.1))


def test_a_quectel_receiver_that_sends_its_pvt_alone_has_a_place() -> None:
    pvt = "PQTMPVT,1,31075000,20260504,093015.000,,3,09,18,52.15000000,4.51000000,11.5,45.0"
    (fix,) = decode(f"{pvt},0.30,0.40,-0.10,0.5,53.1,0.9,1.8")
    assert (fix.lat_deg, fix.lon_deg, fix.alt_m) == pytest.approx((LAT_DEG, LON_DEG, 56.5))
    assert fix.velocity_mps == pytest.approx((0.4, 0.3, 0.1))
    assert fix.quality is GnssQuality.SINGLE
