"""A receiver that speaks and gives no position is named with what to switch on."""

from __future__ import annotations

import json

import pytest
from pyubx2 import GET, UBXMessage

from agribot.cli.tools.gnss import ReceiverSummary
from agribot.core.messages import GnssFix, GnssStatus
from agribot.drivers.gnss.nmea import write_sentence
from agribot.drivers.gnss.receiver import GpsdDecoder
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder
from agribot.drivers.probe.receiver_speaker import ReceiverSpeaker
from tests.drivers import maker_bytes as made
from tests.drivers import receiver_bytes as written
from tests.drivers.caster import STATION, make_observation

GGA = "GNGGA,0930{second:02d}.00,5209.0,N,00430.6,E,{quality},12,0.9,11.5,M,45.0,M,,"
RMC = "GNRMC,0930{second:02d}.00,V,5209.0,N,00430.6,E,1.0,90.0,040526,,,E,V"
CLOCK = UBXMessage("NAV", "NAV-CLOCK", GET, iTOW=1, clkB=1, clkD=1, tAcc=1, fAcc=1).serialize()
POSLLH = UBXMessage("NAV", "NAV-POSLLH", GET, iTOW=1, lon=4.5, lat=52.1, hAcc=1400).serialize()
MEAS_EPOCH = made.make_sbf(4027, bytes(20))
HELD = made.make_pvt_geodetic(3, time_ms=0) + made.make_pvt_geodetic(3, time_ms=100)
OBSERVATIONS = made.make_unicore_frame(12, bytes(20))


def listen(data: bytes, seconds: int = 6) -> list[GnssStatus]:
    """Hear the same once a second."""
    decoder, found = ReceiverDecoder(lambda text: None), []
    for second in range(seconds):
        found += decoder.feed(data, float(second))
    assert not any(isinstance(one, GnssFix) and not one.unmeasured for _, one in found)
    return [one for _, one in found if isinstance(one, GnssStatus)]


@pytest.mark.parametrize(
    ("data", "fact", "advice"),
    [
        (CLOCK, "NAV-CLOCK", "agribot gnss configure"),
        (POSLLH, "NAV-POSLLH", "switch on NAV-PVT"),
        (write_sentence("GPZDA,093015.00,04,05,2026,00,00"), "ZDA", "switch on GGA"),
        (MEAS_EPOCH, "MeasEpoch", "switch on PVTGeodetic"),
        (OBSERVATIONS, "Unicore 12", "BESTNAVA"),
        (STATION + make_observation(), "RTCM 1005", "what a base sends"),
        (written.make_ubx_pvt(is_ok=False), "gnssFixOK is 0", "open sky"),
        (HELD, "held", "switch that mode off"),
        (write_sentence(GGA.format(second=15, quality=8)), "simulated", "switch its simulator off"),
    ],
    ids=[
        "NAV-CLOCK",
        "NAV-POSLLH",
        "ZDA",
        "MeasEpoch",
        "OBSVM",
        "RTCM",
        "NAV-PVT",
        "PVTGeodetic",
        "GGA",
    ],
)
def test_what_it_says_and_what_to_do_are_told_after_some_seconds(
    data: bytes, fact: str, advice: str
) -> None:
    statuses = listen(data)
    assert fact in statuses[-1].trouble and advice in statuses[-1].trouble


def test_dead_reckoning_and_a_held_place_are_fixes_that_are_named() -> None:
    decoder, found = ReceiverDecoder(pytest.fail), []
    for second, quality in enumerate("4466666677777"):
        data = write_sentence(GGA.format(second=second, quality=quality))
        found += decoder.feed(data, float(second))
    fixes = [one for _, one in found if isinstance(one, GnssFix)]
    assert [fix.unmeasured for fix in fixes[::4]] == ["", "dead reckoning", "held", "held"]
    assert "held" in decoder.heard.explain()
    decoder.feed(write_sentence(GGA.format(second=30, quality=4)) * 2, 30.0)
    assert decoder.heard.explain() == ""


def test_dead_reckoning_is_named_where_another_sentence_only_says_void() -> None:

    decoder, found = ReceiverDecoder(pytest.fail), []
    for second in range(10):
        gga = write_sentence(GGA.format(second=second, quality=6))
        found += decoder.feed(gga + write_sentence(RMC.format(second=second)), float(second))
    statuses = [one for _, one in found if isinstance(one, GnssStatus)]
    assert statuses and all("dead reckoning" in status.trouble for status in statuses)


def test_a_receiver_that_searches_is_in_no_trouble() -> None:
    statuses = listen(written.make_ubx_searching())
    assert statuses and not any(status.trouble for status in statuses)


def test_kinds_that_are_not_read_are_named_beside_fixes() -> None:
    decoder, found = ReceiverDecoder(pytest.fail), []
    for second in range(4):
        for body in (GGA.format(second=second, quality=4), "PASHR,ATT,10.5,0.3,-0.7",
                     "GPZDA,093015.00,04,05,2026,00,00", "PTNL,GGK,093015.00,050426"):  # fmt: skip
            found += decoder.feed(write_sentence(body), float(second))
    statuses = [one for _, one in found if isinstance(one, GnssStatus)]
    assert decoder.heard.name_unread() == ("PASHR,ATT", "ZDA", "PTNL,GGK")
    assert not any(status.trouble for status in statuses)


def test_kinds_that_are_not_read_are_named_where_nothing_else_is_known_beside_fixes() -> None:
    decoder, found = ReceiverDecoder(pytest.fail), []
    gpsd, reported = GpsdDecoder(pytest.fail), []
    for second in range(4):
        for body in (
            "GNGGA,0930{:02d}.00,5209.0,N,00430.6,E,1,,,11.5,M,45.0,M,,",
            "PHTRO,0.5,P,1.2,B",
        ):
            found += decoder.feed(write_sentence(body.format(second)), float(second))
        time = f"2026-05-04T09:30:{second:02d}.000Z"
        place = {"class": "TPV", "mode": 2, "time": time, "lat": 52.15, "lon": 4.51}
        for report in ({"class": "ATT", "time": time, "heading": 143.2}, place):
            reported += gpsd.feed(json.dumps(report).encode() + b"\n", float(second))
    for each, kinds in ((found, ("PHTRO",)), (reported, ("ATT",))):
        statuses = [one for _, one in each if isinstance(one, GnssStatus)]
        assert statuses[-1].unread == kinds and not statuses[-1].trouble


def test_noise_makes_no_endless_list_of_kinds() -> None:
    decoder = ReceiverDecoder(lambda text: None)
    for k in range(400):
        decoder.feed(write_sentence(f"XX{k:03d},1"), 0.0)
    assert len(decoder.heard.unread) <= 50 and len(decoder.heard.name_unread()) <= 12


def test_gnss_show_names_the_reason_and_what_is_not_read() -> None:
    summary = ReceiverSummary()
    statuses = listen(write_sentence("GPZDA,093015.00,04,05,2026,00,00"))
    summary.add(6.0, (), {"gnss_status": tuple(statuses)})
    assert "no positions among what it says (ZDA); switch on GGA" in summary.describe()
    assert "not read: ZDA" in summary.describe()
    assert not summary.has_position


def test_gnss_show_names_a_place_without_satellites_or_altitude() -> None:
    body = GGA.format(second=0, quality=6).replace("11.5,M,45.0", ",M,")
    decoder = ReceiverDecoder(pytest.fail)
    decoder.feed(write_sentence(body))
    summary = ReceiverSummary()
    summary.add(0.1, tuple(fix for _, fix in decoder.feed(b"", 1.0)), {})
    assert "52.15000000, 4.51000000, no altitude, dead reckoning" in summary.describe()
    assert not summary.has_position


@pytest.mark.parametrize(
    ("data", "language", "fact"),
    [
        (CLOCK, "UBX", "no positions among what it says (NAV-CLOCK)"),
        (made.make_unicore_line("BESTNAV", made.make_bestnav_text()), "Unicore", "RTK fixed"),
        (HELD, "SBF", "its place is held"),
        (OBSERVATIONS, "Unicore", "no positions among what it says (Unicore 12)"),
    ],
)
def test_the_probe_of_a_line_names_language_and_reason(
    data: bytes, language: str, fact: str
) -> None:
    speaker = ReceiverSpeaker()
    for second in range(5):
        speaker.feed(data, float(second))
    answer = speaker.answer(115_200)
    assert answer.numbers["language"] == language and fact in answer.detail
    assert answer.advice
