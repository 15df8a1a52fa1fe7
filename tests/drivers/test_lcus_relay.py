"""The USB relay that holds the contactor: its bytes, and a line that is pulled out and put in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from agribot.core.errors import ConfigError
from agribot.core.facts import RelayLost
from agribot.core.messages import RobotCommand
from agribot.core.platform import SensorSource, SourceThatActs
from agribot.drivers.line import schemes
from agribot.drivers.power.lcus_relay import LcusContactor, make_switch
from tests.drivers.lines import Line, Opened
from tests.waiting import wait_for

ON, OFF = bytes.fromhex("A00101A2"), bytes.fromhex("A00100A1")
GO, CUT = RobotCommand(t_s=0.0), RobotCommand(t_s=0.0, is_power_cut=True)


def test_a_channel_is_switched_by_four_bytes_whose_last_is_the_sum_of_the_others() -> None:
    assert (make_switch(1, is_on=True), make_switch(1, is_on=False)) == (ON, OFF)
    for channel in range(1, 9):
        for is_on in (True, False):
            head, number, state, checksum = make_switch(channel, is_on=is_on)
            assert (head, number, state) == (0xA0, channel, is_on)
            assert checksum == (head + number + state) % 256


def open_source(name: str, uri: str) -> SensorSource:
    return Opened().open(name, uri)


class Relay:
    """The far end: the last command it got."""

    def __init__(self, line: Line) -> None:
        self._line, self._heard = line, b""

    def is_on(self) -> bool | None:
        self._heard += self._line.hear()
        *_, last = [None, *(self._heard[k : k + 4] for k in range(0, len(self._heard) - 3, 4))]
        assert last in (ON, OFF, None), self._heard.hex()
        return None if last is None else last == ON

    def restart(self) -> None:
        self._heard = b""


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Line]:
    pytest.importorskip("serial", reason="pyserial is missing (pip install -e '.[hardware]')")
    line = Line(tmp_path)
    yield line
    line.unplug()


@pytest.fixture
def contactor(line: Line) -> Iterator[LcusContactor]:
    source = open_source("contactor", f"lcus:{line.path}")
    assert isinstance(source, LcusContactor) and isinstance(source, SourceThatActs)
    yield source
    source.close()


def test_it_is_off_when_it_is_opened_follows_the_commands_and_is_off_at_the_end(
    line: Line, contactor: LcusContactor
) -> None:
    relay = Relay(line)
    wait_for(lambda: relay.is_on() is False, "the relay to be switched off")
    assert not contactor.take(0.0)[0].is_closed
    contactor.write(GO)
    wait_for(relay.is_on, "the relay to hold")
    wait_for(lambda: contactor.take(1.0)[0].is_closed, "the contactor to be reported closed")
    assert contactor.take(1.0)[0].t_s == 1.0
    contactor.write(CUT)
    wait_for(lambda: relay.is_on() is False, "the relay to fall off")
    wait_for(lambda: not contactor.take(2.0)[0].is_closed, "the contactor to be reported open")
    contactor.write(GO)
    wait_for(relay.is_on, "the relay to hold again")
    contactor.close()
    assert relay.is_on() is False


def test_a_relay_that_is_pulled_out_is_told_and_is_off_when_it_is_back(
    line: Line, contactor: LcusContactor
) -> None:
    contactor.write(GO)
    wait_for(lambda: contactor.take(0.0)[0].is_closed, "the contactor to be reported closed")
    line.unplug()

    def is_lost() -> bool:
        contactor.write(GO)
        (told,) = contactor.take(0.0)
        return not told.is_closed and told.fault == RelayLost(str(line.path))

    wait_for(is_lost, "the loss to be reported")
    line.plug_in()
    relay = Relay(line)
    wait_for(lambda: relay.is_on() is not None, "the line to be opened again")
    contactor.write(CUT)

    def is_back_and_off() -> bool:
        contactor.write(CUT)
        (told,) = contactor.take(0.0)
        return relay.is_on() is False and not told.is_closed and told.fault is None

    wait_for(is_back_and_off, "the relay to answer")


def test_another_channel_of_a_larger_relay_is_switched(line: Line) -> None:
    source = open_source("contactor", f"lcus:{line.path}?channel=4")
    try:
        heard = bytearray()

        def is_told() -> bool:
            heard.extend(line.hear())
            return bytes(heard) == make_switch(4, is_on=False)

        wait_for(is_told, "channel 4 to be switched off")
    finally:
        source.close()


def test_two_contactors_are_switched_by_two_channels_at_once(line: Line) -> None:
    source = open_source("contactor", f"lcus:{line.path}?channel=1&second=2")
    assert isinstance(source, LcusContactor)
    heard = bytearray()

    def has_heard(*, is_on: bool) -> bool:
        heard.extend(line.hear())
        return bytes(heard).endswith(make_switch(1, is_on=is_on) + make_switch(2, is_on=is_on))

    try:
        wait_for(lambda: has_heard(is_on=False), "both to be switched off")
        source.write(GO)
        wait_for(lambda: has_heard(is_on=True), "both to hold")
        wait_for(lambda: source.take(0.0)[0].is_closed, "the contactors to be reported closed")
        source.write(CUT)
        wait_for(lambda: has_heard(is_on=False), "both to fall off")
    finally:
        source.close()


@pytest.mark.parametrize(
    ("sensor", "uri", "words"),
    [
        ("contactor", "lcus:{path}?channel=2&second=2", "is the first contactor's channel, too"),
        ("imu", "lcus:{path}", "imu from lcus:"),
        ("contactor", "lcus:{path}?channel=9", "channel=9: out of range; give 1 to 8"),
        ("contactor", "lcus:{path}?chanel=1", "unknown option 'chanel'; did you mean 'channel'?"),
        ("contactor", "lcus:/dev/ttyNONE", "check that it is plugged in"),
        ("contactor", "serial:{path}", "not read from a line; give gnss or imu"),
        ("contactor", "ros2:/relay", "it is switched, not heard"),
    ],
)
def test_what_no_relay_can_be_is_refused(sensor: str, uri: str, words: str, line: Line) -> None:
    if uri.startswith("ros2"):
        from agribot.description.loader import load_robot
        from agribot.ros.messages.sensor_readers import make_readers

        with pytest.raises(ConfigError, match=words):
            make_readers("contactor", load_robot("agribot"))
        return
    with pytest.raises(ConfigError) as refused:
        open_source(sensor, uri.format(path=line.path))
    assert words in str(refused.value)


def test_the_setting_of_a_contactor_is_read_like_that_of_a_sensor() -> None:
    from agribot.core.config import SourceConfig

    wanted = schemes.read_sources(SourceConfig(contactor="lcus:/dev/ttyUSB3"))
    assert wanted["contactor"].path == "/dev/ttyUSB3"
