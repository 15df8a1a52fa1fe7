"""A receiver reports its heading, its satellites, and the age of its corrections."""

from __future__ import annotations

import datetime as dt
import itertools
import math
from collections.abc import Sequence

import pytest

from agribot.core.geo import yaw_from_compass_deg
from agribot.core.messages import GnssHeading, GnssStatus, Inbox, RobotCommand, SensorBatch
from agribot.core.platform import MixedPlatform, Sensor
from agribot.drivers.gnss.nmea import write_sentence
from agribot.drivers.gnss.receiver import GpsdDecoder
from agribot.drivers.gnss.receiver_decoder import HeadingMount, ReceiverDecoder
from tests.drivers import receiver_bytes as written

SECOND = dt.timedelta(seconds=1)
# A receiver with NMEA 4.11 says each satellite for each signal, and which system GSA is of.
SKY = (
    "GPGSV,1,1,03,05,71,210,44,07,15,033,38,12,03,359,,1",
    "GPGSV,1,1,01,05,71,210,47,6",
    "GLGSV,1,1,01,78,40,120,30,1",
    "GNGSA,A,3,05,07,,,,,,,,,,,1.8,0.9,1.5,1",
    "GNGSA,A,3,78,,,,,,,,,,,,1.8,0.9,1.5,2",
)


def feed(data: bytes, mount: HeadingMount | None = None) -> list[tuple[float, object]]:
    return list(ReceiverDecoder(pytest.fail, mount).feed(data))


def pick(found: Sequence[tuple[float, object]], kind: type) -> list[object]:
    return [sample for _, sample in found if isinstance(sample, kind)]


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 271.5])
@pytest.mark.parametrize("offset_deg", [0.0, 90.0, -45.0])
def test_two_antennas_of_ubx_tell_where_the_robot_looks(
    heading_deg: float, offset_deg: float
) -> None:
    data = written.make_ubx_relposned(written.EPOCH, heading_deg, accuracy_deg=0.3)
    (heading,) = pick(feed(data, HeadingMount(offset_deg)), GnssHeading)
    assert isinstance(heading, GnssHeading)
    turned_rad = heading.yaw_map_rad - yaw_from_compass_deg(heading_deg - offset_deg)
    assert math.remainder(turned_rad, math.tau) == pytest.approx(0.0, abs=1e-6)
    assert heading.std_rad == pytest.approx(math.radians(0.3), rel=1e-3)


@pytest.mark.parametrize(
    "wrong", [{"carrier": 1}, {"is_valid": False}, {"accuracy_deg": 0.0}, {"is_moving": False}]
)
def test_a_float_baseline_or_one_to_a_base_in_the_field_is_no_heading(
    wrong: dict[str, float],
) -> None:
    data = written.make_ubx_relposned(written.EPOCH, 90.0, **wrong)  # type: ignore[arg-type]
    assert feed(data) == []


def test_hdt_is_a_heading_of_its_epoch() -> None:
    data = b""
    for k in range(3):
        at = written.EPOCH + k * SECOND
        data += b"".join(written.make_nmea(at)) + write_sentence("GNHDT,123.456,T")
    found = feed(data, HeadingMount(offset_deg=90.0, std_deg=0.5))
    stamps = [stamp_s for stamp_s, sample in found if isinstance(sample, GnssHeading)]
    assert [b - a for a, b in itertools.pairwise(stamps)] == pytest.approx([1.0, 1.0])
    heading = pick(found, GnssHeading)[0]
    assert isinstance(heading, GnssHeading)
    assert heading.yaw_map_rad == pytest.approx(yaw_from_compass_deg(33.456))
    assert heading.std_rad == pytest.approx(math.radians(0.5))


@pytest.mark.parametrize("body", ["GNHDT,,T", "GNHDT,nan,T", "GNHDT,400,T", "GNHDT,12,M", "GNHDT"])
def test_a_heading_that_is_none_is_left_out(body: str) -> None:
    decoder = ReceiverDecoder(lambda text: None)
    assert decoder.feed(write_sentence(body)) == []


def test_ubx_tells_satellites_and_dilutions() -> None:
    data = written.make_ubx_sky(written.EPOCH) + written.make_ubx_pvt(carrier=2)
    (status,) = pick(feed(data), GnssStatus)
    assert isinstance(status, GnssStatus)
    assert (status.gdop, status.hdop, status.tdop) == pytest.approx((2.1, 0.9, 1.1))
    names = [(each.system, each.number, each.is_used) for each in status.satellites]
    assert names == [("GA", 31, False), ("GL", 14, True), ("GP", 5, True)]
    assert status.satellites[0].elevation_deg == -3.0
    assert status.satellites[2].snr_db == 44.0


def test_nmea_tells_each_satellite_once_and_which_are_used() -> None:
    sky = b"".join(written.make_sentence(body) for body in SKY)
    data = b"".join(b"".join(written.make_nmea(written.EPOCH + k * SECOND)) + sky for k in range(3))
    status = pick(feed(data), GnssStatus)[-1]
    assert isinstance(status, GnssStatus)
    names = [(s.system, s.number, s.is_used, s.snr_db) for s in status.satellites]
    assert names == [
        ("GL", 78, True, 30.0), ("GP", 5, True, 47.0), ("GP", 7, True, 38.0),
        ("GP", 12, False, 0.0),
    ]  # fmt: skip
    assert (status.pdop, status.hdop, status.vdop) == pytest.approx((1.8, 0.9, 1.5))


def test_a_status_comes_once_a_second_however_often_the_fixes() -> None:
    data = b"".join(
        written.make_ubx_sky(written.EPOCH + k * SECOND / 10)
        + written.make_ubx_pvt(written.EPOCH + k * SECOND / 10)
        for k in range(31)
    )
    assert len(pick(feed(data), GnssStatus)) == 4


def test_the_receiver_tells_how_old_its_corrections_are() -> None:
    body = "GNGGA,093015.00,5209.0,N,00430.6,E,4,12,0.9,11.0,M,45.0,M,3.5,0001"
    later = body.replace("093015", "093016")
    found = feed(write_sentence(body) + write_sentence(later) * 2)
    ages_s = {s.correction_age_s for s in pick(found, GnssStatus) if isinstance(s, GnssStatus)}
    assert ages_s == {3.5}


def test_of_two_receivers_of_a_gpsd_one_is_taken_and_the_other_told_once() -> None:
    told: list[str] = []
    decoder = GpsdDecoder(told.append)
    line = (
        '{{"class":"TPV","device":"/dev/tty{}","mode":3,"time":"2026-05-04T09:30:1{}.000Z",'
        '"lat":{},"lon":4.5,"eph":1.0}}\n'
    )
    data = "".join(line.format("AB"[k % 2], k // 2, 52.0 + k % 2) for k in range(8))
    fixes = [sample for _, sample in decoder.feed(data.encode())]
    assert {fix.lat_deg for fix in fixes} == {52.0} and len(fixes) == 4  # type: ignore[union-attr]
    assert told == ["gpsd reports /dev/ttyB too; taken is /dev/ttyA"]


def test_a_receiver_of_a_gpsd_whose_clock_steps_back_goes_on_and_an_epoch_counts_once() -> None:
    decoder = GpsdDecoder(lambda text: None)
    line = '{{"class":"TPV","device":"/dev/ttyA","mode":3,"time":"{}Z","lat":{},"lon":4.5}}\n'
    at = ("2026-05-04T09:30:18", "2045-12-19T09:30:19", "2026-05-04T09:30:01")
    data = "".join(line.format(time, 52.0 + k) * 2 for k, time in enumerate(at))
    fixes = [sample for _, sample in decoder.feed(data.encode())]
    assert [fix.lat_deg for fix in fixes] == [52.0, 53.0, 54.0]  # type: ignore[union-attr]


class Simulated:
    """A platform with a heading of its own."""

    inbox = Inbox()

    def read(self) -> SensorBatch:
        own = GnssHeading(t_s=0.0, yaw_map_rad=0.0, std_rad=0.1)
        return SensorBatch(t_s=1.0, headings=(own,))

    def write(self, command: RobotCommand) -> None: ...
    def close(self) -> None: ...


class Receiver:
    """A source that gives a heading beside its fixes."""

    sensor: Sensor = "gnss"
    name = "roof"

    def take(self, t_s: float) -> tuple[()]:
        return ()

    def take_more(self, t_s: float) -> dict[str, tuple[GnssHeading, ...]]:
        return {"headings": (GnssHeading(t_s=t_s, yaw_map_rad=1.0, std_rad=0.1),)}

    def close(self) -> None: ...


def test_the_heading_of_a_receiver_from_elsewhere_takes_the_place_of_the_platforms() -> None:
    batch = MixedPlatform(Simulated(), [Receiver()]).read()
    assert [heading.yaw_map_rad for heading in batch.headings] == [1.0]


def use_of(*frames: bytes) -> tuple[int | None, int | None]:
    """What a receiver says of its corrections in the status of the second epoch."""
    data = written.make_ubx_pvt() + b"".join(frames) + written.make_ubx_pvt(written.EPOCH + SECOND)
    *_, status = pick(feed(data + written.make_ubx_sky(written.EPOCH)), GnssStatus)
    assert isinstance(status, GnssStatus)
    return status.corrections_used, status.corrections_unused


def test_a_receiver_says_which_corrections_it_used() -> None:
    used, unused, unknown = (written.make_ubx_rtcm(use) for use in (2, 1, 0))
    broken = written.make_ubx_rtcm(use=2, is_broken=True)
    sky = written.make_ubx_sky(written.EPOCH)
    assert use_of(sky) == (None, None)
    assert use_of(sky, unknown) == (None, None)
    assert use_of(sky, used, used, unused, unknown, broken) == (2, 2)


def test_corrections_that_a_receiver_tells_of_in_two_messages_count_once() -> None:
    sky = written.make_ubx_sky(written.EPOCH)
    pair = written.make_ubx_rtcm(use=2) + written.make_ubx_cor(use=2)
    assert use_of(sky, *[pair] * 5, written.make_ubx_cor(use=1)) == (5, 1)
    assert use_of(sky, written.make_ubx_cor(use=2, protocol=2)) == (None, None)


@pytest.mark.parametrize(
    "satellite", ['"PRN":1e9990', '"PRN":1e300', '"PRN":-5', '"PRN":5,"gnssid":1e9990']
)
def test_a_satellite_with_a_number_that_none_has_is_refused_and_gpsd_read_on(
    satellite: str,
) -> None:
    refused: list[str] = []
    decoder = GpsdDecoder(refused.append)
    sky = f'{{"class":"SKY","device":"/dev/a","hdop":0.9,"satellites":[{{{satellite}}}]}}\n'
    decoder.feed(sky.encode())
    assert len(refused) == 1 and "SKY" in refused[0]
    (sample,) = decoder.feed(sky.replace(satellite, '"PRN":5').encode(), 2.0)
    assert isinstance(sample[1], GnssStatus) and sample[1].satellites[0].number == 5


def test_a_satellite_of_nmea_has_no_more_than_three_digits() -> None:
    refused: list[str] = []
    decoder = ReceiverDecoder(refused.append)
    decoder.feed(write_sentence("GPGSV,1,1,01,99999999999999999999,71,210,44,1"))
    assert len(refused) == 1 and "GSV" in refused[0]
