"""The uncertainty of a device's times is reported once, and again when it changes."""

from __future__ import annotations

import datetime as dt
import math
import random
from collections.abc import Callable

import pytest

from agribot.core.facts import TimesKnown, TimesUnsure
from agribot.core.messages import DeviceNote
from agribot.drivers.gnss.receiver import ReceiverLink
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder
from agribot.drivers.line.clock_watch import ClockWatch
from tests.drivers import receiver_bytes as written
from tests.drivers.lines import Line, Opened
from tests.waiting import wait_for

LATE_S = 0.06


def listen(told_s: Callable[[float], float], seconds: float = 20.0) -> list[DeviceNote]:
    """What is noted of an uncertainty that is so at a time, ten times a second."""
    now_s = [0.0]
    watch = ClockWatch("camera", lambda: told_s(now_s[0]))
    notes: list[DeviceNote] = []
    for tick in range(round(seconds * 10)):
        now_s[0] = tick * 0.1
        notes += watch.update(now_s[0])
    return notes


def test_it_is_told_once_when_it_is_known_and_not_before() -> None:
    (note,) = listen(lambda t_s: math.inf if t_s < 5.0 else 0.0013)
    assert note.fact == TimesKnown("camera", 0.0013)
    assert note.t_s >= 7.0
    assert listen(lambda t_s: math.inf) == []


def test_it_is_a_fault_where_it_is_too_much_and_over_when_it_is_less() -> None:
    notes = listen(lambda t_s: 0.031 if 8.0 <= t_s < 12.0 else 0.002)
    assert [note.fact for note in notes] == [
        TimesKnown("camera", 0.002), TimesUnsure("camera", 0.031, 0.02),
        TimesKnown("camera", 0.002),
    ]  # fmt: skip


@pytest.mark.parametrize(("jitter_s", "most_ms"), [(0.002, 1.0), (0.05, 10.0)])
def test_a_receivers_times_are_told_with_what_its_arrivals_leave_open(
    jitter_s: float, most_ms: float
) -> None:
    rng, now_s = random.Random(1), [0.0]
    link = ReceiverLink("receiver", ReceiverDecoder(pytest.fail), lambda: now_s[0])
    notes: list[DeviceNote] = []
    for k in range(1, 60):
        now_s[0] = 0.1 * k
        at = written.EPOCH + k * dt.timedelta(seconds=0.1)
        late_s = LATE_S + rng.expovariate(1.0 / jitter_s)
        link.feed(written.make_ubx_pvt(at), now_s[0] - 0.2 + late_s)
        link.take_fixes(now_s[0])
        notes += link.take_more(now_s[0])["notes"]
    (note,) = notes
    assert isinstance(note.fact, TimesKnown)
    assert 0.2 <= 1e3 * note.fact.off_s < most_ms


def test_an_imu_that_tells_no_time_is_known_as_well_as_its_lines_come(
    line: Line, opened: Opened
) -> None:
    pytest.importorskip("serial", reason="pyserial is missing (pip install -e '.[hardware]')")
    source = opened.open("imu", f"serial:{line.path}")

    def find() -> list[DeviceNote]:
        line.say(b"A164B-328C16384D131E-262F3932G\r\n")
        return list(opened.take(source, "notes"))

    (note,) = wait_for(find, "a note")
    assert isinstance(note.fact, TimesKnown)
    assert note.fact.device == f"IMU on {line.path}"
