"""A simulated receiver's fixes as UBX: other people's libraries read them, and so does ours."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pyubx2 import UBXMessage, UBXReader

from agribot.core.facts import LineClean, LineNoisy
from agribot.core.messages import GnssFix, GnssHeading, GnssQuality
from agribot.drivers.gnss import ubx
from agribot.drivers.gnss.receiver import ReceiverLink
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder
from agribot.drivers.gnss.ubx_writer import RUN_BEGINS, write_fix, write_heading
from agribot.drivers.line.line_watch import MANY, WITHIN_S, LineWatch

M_PER_DEG = 111_320.0
LATENCY_S = 0.1
QUALITIES = [each for each in GnssQuality if each is not GnssQuality.NONE]


def make_fix(t_s: float = 0.1, quality: GnssQuality = GnssQuality.RTK_FIXED) -> GnssFix:
    return GnssFix(
        t_s=t_s, lat_deg=-21.161_289_034_7, lon_deg=72.787_003_311_8, alt_m=-0.289_7,
        pos_std_m=0.014, quality=quality, velocity_mps=(0.412, -0.031, 0.006),
        velocity_std_mps=0.03,
    )  # fmt: skip


def carry(fixes: list[GnssFix]) -> tuple[GnssFix, ...]:
    """Send fixes over a line that ends in the link of a run, each after its latency."""
    now_s = [0.0]
    link = ReceiverLink("receiver", ReceiverDecoder(pytest.fail), lambda: now_s[0], LATENCY_S)
    found: list[GnssFix] = []
    for fix in fixes:
        now_s[0] = fix.t_s + LATENCY_S
        link.feed(write_fix(fix), now_s[0])
        found += link.take_fixes(now_s[0])
    return tuple(found)


def find_distance_m(one: GnssFix, other: GnssFix) -> float:
    north_m = (one.lat_deg - other.lat_deg) * M_PER_DEG
    east_m = (one.lon_deg - other.lon_deg) * M_PER_DEG * math.cos(math.radians(one.lat_deg))
    return math.hypot(north_m, east_m)


def parse(data: bytes) -> UBXMessage:
    message = UBXReader.parse(data)
    assert isinstance(message, UBXMessage)
    return message


def test_a_library_of_others_reads_the_same_epoch_place_and_carrier() -> None:
    frames = ubx.UbxDecoder().feed(write_fix(make_fix(t_s=3.25)))
    pvt, precise = (parse(ubx.make_frame(*frame)) for frame in frames)
    assert (pvt.identity, precise.identity) == ("NAV-PVT", "NAV-HPPOSLLH")
    assert pvt.iTOW == precise.iTOW
    when = (pvt.year, pvt.month, pvt.day, pvt.hour, pvt.min, pvt.second)
    assert when == (*RUN_BEGINS.timetuple()[:5], 3)
    assert pvt.nano == 250_000_000
    assert (pvt.carrSoln, pvt.gnssFixOk, pvt.diffSoln) == (2, 1, 1)
    assert pvt.hAcc == pytest.approx(14 * math.sqrt(2.0), abs=0.51)
    assert (pvt.velN, pvt.velE, pvt.velD, pvt.sAcc) == (-31, 412, -6, 30)
    assert precise.lat == pytest.approx(make_fix().lat_deg, abs=1e-9)
    assert precise.lon == pytest.approx(make_fix().lon_deg, abs=1e-9)


@pytest.mark.parametrize("quality", QUALITIES)
def test_the_state_of_the_carrier_survives(quality: GnssQuality) -> None:
    assert carry([make_fix(quality=quality)])[0].quality is quality


def test_a_receiver_without_a_position_says_nothing() -> None:
    assert write_fix(make_fix(quality=GnssQuality.NONE)) == b""


def test_a_velocity_that_is_not_known_is_worth_nothing() -> None:
    fix = make_fix()
    unknown = GnssFix(
        t_s=fix.t_s, lat_deg=fix.lat_deg, lon_deg=fix.lon_deg, alt_m=fix.alt_m,
        pos_std_m=fix.pos_std_m, quality=fix.quality,
    )  # fmt: skip
    assert carry([unknown])[0].velocity_std_mps > 1e6


@given(
    st.floats(-89.9, 89.9), st.floats(-180.0, 180.0), st.floats(-400.0, 8000.0),
    st.floats(1e-3, 50.0), st.tuples(*[st.floats(-30.0, 30.0)] * 3),
)  # fmt: skip
def test_after_the_first_epoch_millimetres_survive_everywhere(
    lat_deg: float, lon_deg: float, alt_m: float, std_m: float,
    velocity_mps: tuple[float, float, float],
) -> None:  # fmt: skip
    assume(max(abs(lat_deg), abs(lon_deg)) > 1e-6)  # 0, 0 is no place
    fixes = [
        GnssFix(t_s=0.1 * k, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=alt_m, pos_std_m=std_m,
                quality=GnssQuality.RTK_FIXED, velocity_mps=velocity_mps, velocity_std_mps=std_m)
        for k in (1, 2)
    ]  # fmt: skip
    coarse, fine = carry(fixes)
    assert find_distance_m(coarse, fixes[0]) < 0.02  # the decoder does not know yet of the second
    assert find_distance_m(fine, fixes[1]) < 1e-4
    assert fine.alt_m == pytest.approx(alt_m, abs=1e-4)
    assert fine.pos_std_m == pytest.approx(std_m, abs=4e-4)
    assert fine.velocity_mps == pytest.approx(velocity_mps, abs=6e-4)
    assert fine.velocity_std_mps == pytest.approx(std_m, abs=6e-4)


def test_fixes_count_at_their_epochs_over_the_end_of_a_minute_and_an_hour() -> None:
    fixes = [make_fix(t_s) for t_s in (0.1, 0.2, 0.4, 1.0, 59.9, 60.0, 60.1, 1799.95, 1800.0)]
    told = carry(fixes)
    assert [fix.t_s for fix in told] == pytest.approx([fix.t_s for fix in fixes], abs=1e-6)


@given(st.floats(-math.pi, math.pi))
def test_a_heading_of_two_antennas_survives(yaw_rad: float) -> None:
    data = write_heading(GnssHeading(t_s=7.3, yaw_map_rad=yaw_rad, std_rad=0.007))
    ((_, heading),) = ReceiverDecoder(pytest.fail).feed(data)
    assert isinstance(heading, GnssHeading)
    assert math.remainder(heading.yaw_map_rad - yaw_rad, math.tau) == pytest.approx(0.0, abs=2e-7)
    assert heading.std_rad == pytest.approx(0.007, abs=2e-7)
    assert parse(data).relPosHeadingValid == 1


@given(st.integers(0, 8 * 144 - 1))
def test_one_false_bit_costs_one_epoch_its_millimetres_at_most_and_makes_no_other_place(
    bit: int,
) -> None:
    """Also one in the length of a frame, which then seems to reach over many epochs."""
    epochs = [write_fix(make_fix(0.1 * k)) for k in range(1, 8)]
    spoilt = bytearray(epochs[2])
    spoilt[bit // 8] ^= 1 << bit % 8
    epochs[2] = bytes(spoilt)
    decoder = ReceiverDecoder(lambda text: None)
    found = [fix for data in epochs for _, fix in decoder.feed(data) if isinstance(fix, GnssFix)]
    is_sync = bit // 8 in (0, 1, 100, 101)  # what begins with nothing known is not even a frame
    assert decoder.broken == (0 if is_sync else 1)
    assert len(found) >= 6
    assert all(find_distance_m(fix, make_fix()) < 0.02 for fix in found)


def test_a_broken_length_holds_back_no_later_epoch() -> None:
    first, *rest = (bytearray(write_fix(make_fix(0.1 * k))) for k in range(1, 5))
    first[5] |= 0x10  # 4 kB more
    decoder = ReceiverDecoder(lambda text: None)
    counts = [len(decoder.feed(bytes(data))) for data in (first, *rest)]
    assert counts == [0, 1, 1, 1]


def test_many_broken_messages_are_told_once_and_that_they_are_over_once() -> None:
    watch = LineWatch("receiver", "receiver")
    notes = [(t_s, note) for t_s in range(40) for note in watch.update(t_s, min(t_s, 6))]
    (begun_s, begin), (ended_s, end) = notes
    assert begun_s == MANY
    assert begin.fact == LineNoisy("receiver", "receiver", MANY, MANY - 1.0)
    assert ended_s == pytest.approx(6 + WITHIN_S, abs=1.1)
    assert end.fact == LineClean("receiver", "receiver", WITHIN_S)


def test_a_broken_message_now_and_then_and_a_line_that_is_opened_again_are_not_told() -> None:
    watch = LineWatch("receiver", "receiver")
    rare = [note for k in range(20) for note in watch.update(k * WITHIN_S, k)]
    opened_again = watch.update(20 * WITHIN_S, 0)
    assert not rare and not opened_again
