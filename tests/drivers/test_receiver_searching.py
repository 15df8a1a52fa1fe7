"""A receiver without a fix reports the satellites it sees, and that never counts as a fix."""

from __future__ import annotations

import datetime as dt
import itertools
import json
from collections.abc import Callable

import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.core.config import load
from agribot.core.facts import HeadingAwaited, HeadingUnknown, NoFixesYet
from agribot.core.messages import GnssFix, GnssStatus, ImuSample, SensorBatch, WheelSample
from agribot.description.loader import load_robot
from agribot.drivers.gnss.nmea import write_sentence
from agribot.drivers.gnss.receiver import GpsdDecoder, ReceiverLink
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder
from agribot.drivers.gnss.ubx import UbxDecoder, make_frame
from agribot.ui.receiver_view import ReceiverView
from tests.drivers import receiver_bytes as written

STEP_S = 0.1  # between two epochs
# A u-blox receiver with the settings of the factory, before it knows even the time.
COLD = (
    "GNRMC,,V,,,,,,,,,,N,V",
    "GNGGA,,,,,,0,00,99.99,,,,,,",
    "GNGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99,1",
    "GPGSV,1,1,02,05,71,210,44,12,03,359,,1",
    "GLGSV,1,1,01,78,40,120,30,1",
)
SEEN_SKY = {
    "class": "SKY", "device": "/dev/a",
    "satellites": [
        {"PRN": 5, "el": 71.0, "az": 210.0, "ss": 44.0, "used": False, "gnssid": 0, "svid": 5},
        {"PRN": 78, "el": 40.0, "az": 120.0, "ss": 30.0, "used": False, "gnssid": 6, "svid": 14},
    ],
}  # fmt: skip


def get_epoch(number: int) -> dt.datetime:
    return written.EPOCH + number * dt.timedelta(seconds=STEP_S)


def search_in_ubx(number: int) -> bytes:
    return written.make_ubx_searching(get_epoch(number))


def search_in_nmea(number: int) -> bytes:
    return b"".join(write_sentence(body) for body in COLD)


def search_in_nmea_with_time(number: int) -> bytes:
    time = get_epoch(number).strftime("%H%M%S.%f")[:9]
    told = (body.replace("RMC,,", f"RMC,{time},").replace("GGA,,", f"GGA,{time},") for body in COLD)
    return b"".join(write_sentence(body) for body in told)


def search_in_gpsd(number: int) -> bytes:
    nothing = {"class": "TPV", "device": "/dev/a", "mode": 1}
    return b"".join(json.dumps(report).encode() + b"\r\n" for report in (nothing, SEEN_SKY))


def fix_in_ubx(number: int) -> bytes:
    return written.make_ubx_sky(get_epoch(number)) + written.make_ubx_pvt(get_epoch(number))


def fix_in_nmea(number: int) -> bytes:
    return b"".join((*written.make_nmea(get_epoch(number)), *map(write_sentence, COLD[3:])))


def fix_in_gpsd(number: int) -> bytes:
    found = {
        "class": "TPV", "device": "/dev/a", "mode": 3, "lat": 52.0, "lon": 4.5, "eph": 1.0,
        "time": get_epoch(number).isoformat(timespec="milliseconds"),
    }  # fmt: skip
    return b"".join(json.dumps(report).encode() + b"\r\n" for report in (found, SEEN_SKY))


SPOKEN = {
    "UBX": (ReceiverDecoder, search_in_ubx, fix_in_ubx),
    "NMEA": (ReceiverDecoder, search_in_nmea, fix_in_nmea),
    "NMEA with time": (ReceiverDecoder, search_in_nmea_with_time, fix_in_nmea),
    "gpsd": (GpsdDecoder, search_in_gpsd, fix_in_gpsd),
}


class Receiver:
    """A receiver on a line, whose epochs come every tenth of a second of the robot's clock."""

    def __init__(self, spoken: str) -> None:
        make, self.search, self.fix = SPOKEN[spoken]
        self.number = 0
        self.link = ReceiverLink("receiver", make(pytest.fail), lambda: self.t_s)

    @property
    def t_s(self) -> float:
        return 5.0 + STEP_S * self.number

    def speak(self, epochs: int, *, is_fixed: bool = False) -> list[SensorBatch]:
        batches = []
        for _ in range(epochs):
            self.number += 1
            self.link.feed((self.fix if is_fixed else self.search)(self.number), self.t_s)
            batches.append(
                SensorBatch(
                    t_s=self.t_s,
                    gnss=self.link.take_fixes(self.t_s),
                    **self.link.take_more(self.t_s),
                )
            )
        return batches


def pick_states(batches: list[SensorBatch]) -> list[GnssStatus]:
    return [status for batch in batches for status in batch.gnss_status]


@pytest.mark.parametrize("spoken", SPOKEN)
def test_a_receiver_that_searches_tells_its_sky_about_once_a_second_by_the_robots_clock(
    spoken: str,
) -> None:
    batches = Receiver(spoken).speak(101)
    states = pick_states(batches)
    assert not any(batch.gnss for batch in batches)
    gaps_s = [b.t_s - a.t_s for a, b in itertools.pairwise(states)]
    assert min(gaps_s) >= 0.75 and max(gaps_s) <= 1.05
    assert 5.0 < states[0].t_s <= 5.5 and states[-1].t_s > 14.0
    for batch in batches:
        assert all(status.t_s == pytest.approx(batch.t_s) for status in batch.gnss_status)
    for status in states:
        assert {("GP", 5), ("GL", 78 if spoken != "UBX" else 14)} <= {
            (each.system, each.number) for each in status.satellites
        }
        assert not any(each.is_used for each in status.satellites)
        assert (status.pdop, status.hdop, status.correction_age_s) == (None, None, None)


@pytest.mark.parametrize("spoken", SPOKEN)
def test_a_receiver_that_speaks_once_a_second_is_heard_each_time_though_its_words_come_unevenly(
    spoken: str,
) -> None:
    make, search, _ = SPOKEN[spoken]
    decoder = make(pytest.fail)
    found = [decoder.feed(search(10 * k), 5.0 + k + 0.02 * (k % 2)) for k in range(12)]
    assert [len(epoch) for epoch in found[1:]] == [1] * 11


@pytest.mark.parametrize("spoken", SPOKEN)
def test_fixes_that_come_end_and_come_again_leave_no_gap_in_what_is_told_of_the_sky(
    spoken: str,
) -> None:
    receiver = Receiver(spoken)
    batches = [
        batch
        for is_fixed in (False, True, False, True)
        for batch in receiver.speak(35, is_fixed=is_fixed)
    ]
    assert sum(len(batch.gnss) for batch in batches) in (69, 70)
    times_s = [status.t_s for status in pick_states(batches)]
    gaps_s = [b - a for a, b in itertools.pairwise(times_s)]
    assert min(gaps_s) > 0.0 and max(gaps_s) <= 2.0
    assert 13 <= len(times_s) <= 18


@pytest.mark.parametrize("spoken", SPOKEN)
def test_the_page_shows_the_satellites_of_a_receiver_that_searches_and_no_fix(spoken: str) -> None:
    view = ReceiverView(load("farm"))
    for batch in Receiver(spoken).speak(30):
        view(batch)
    shown = view.show()
    assert (shown.fix_age_s, shown.quality, shown.rate_hz) == (None, 0, None)
    assert shown.in_view_count >= 2 and shown.used_count == 0
    assert shown.status_age_s is not None and shown.status_age_s <= 1


@pytest.mark.parametrize("spoken", SPOKEN)
def test_what_a_receiver_sees_is_no_position_to_the_estimate(spoken: str) -> None:
    config = load("farm")
    localizer = Localizer(config.estimate, config.field, load_robot())
    for batch in Receiver(spoken).speak(60):
        t_s = batch.t_s
        still = SensorBatch(
            t_s=t_s,
            wheels=(WheelSample(t_s=t_s, angle_rad=(0.0,) * 4, speed_radps=(0.0,) * 4),),
            imu=(ImuSample(t_s=t_s, gyro_radps=(0.0,) * 3, accel_mps2=(0.0, 0.0, 9.81)),),
            gnss=batch.gnss,
            gnss_status=batch.gnss_status,
        )
        estimate = localizer.update(still)
        assert not estimate.ok
    assert isinstance(estimate.fact, HeadingAwaited | HeadingUnknown | NoFixesYet)
    assert "position" not in localizer.pose.known


@pytest.mark.parametrize(("fix_type", "is_known"), [(1, False), (5, False), (3, True)])
def test_a_place_without_satellites_is_no_position_to_the_estimate(
    fix_type: int, is_known: bool
) -> None:
    config, decoder = load("farm"), ReceiverDecoder(pytest.fail)
    localizer = Localizer(config.estimate, config.field, load_robot())
    (frame,) = UbxDecoder().feed(written.make_ubx_pvt())
    payload = bytearray(frame.payload)
    payload[20] = fix_type
    found = decoder.feed(make_frame(frame.kind, bytes(payload)))
    (fix,) = [one for _, one in found if isinstance(one, GnssFix)]
    assert localizer._gnss.is_usable(fix) == is_known


def test_a_satellite_list_of_another_receiver_of_gpsd_is_not_ours() -> None:
    decoder = GpsdDecoder(lambda text: None, "/dev/b")
    assert decoder.feed(search_in_gpsd(1), 5.0) == []


def test_a_second_report_of_an_epoch_with_a_fix_is_no_epoch_without_one() -> None:
    decoder = GpsdDecoder(pytest.fail)
    found = [pair for k in range(3) for pair in decoder.feed(fix_in_gpsd(1), 5.0 + 2.0 * k)]
    assert [type(sample) for _, sample in found] == [GnssFix]


@pytest.mark.parametrize("make", [written.make_ubx_pvt, lambda at: b"".join(written.make_nmea(at))])
def test_no_fix_is_lost_when_a_receiver_restarts_with_an_older_date(
    make: Callable[[dt.datetime], bytes],
) -> None:
    now_s, taken_s = 0.0, []
    link = ReceiverLink("line", ReceiverDecoder(pytest.fail), lambda: now_s)
    for k in range(40):
        now_s = 0.25 * k
        began = written.EPOCH - (k >= 20) * dt.timedelta(hours=5)
        link.feed(make(began + k * dt.timedelta(seconds=0.25)), now_s)
        taken_s += [fix.t_s for fix in link.take_fixes(now_s)]
    assert taken_s[-39:] == pytest.approx([0.25 * k for k in range(1, 40)], abs=0.01)
