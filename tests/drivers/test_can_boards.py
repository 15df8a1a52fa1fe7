"""Motor controllers on a CAN bus are armed, driven and stopped as those on a serial line."""

from __future__ import annotations

import math
import random
import threading
from collections.abc import Iterator
from itertools import count

import pytest

from agribot.core import extras
from agribot.core.errors import ConfigError
from agribot.core.facts import AxisError, AxisStands, Both
from agribot.drivers.board import board_kinds, odrive_can, vesc_can
from agribot.drivers.board.board_kinds import MakeBoard
from agribot.drivers.board.can_frames import FRAME, CanDecoder, CanFrame, CanStream
from agribot.drivers.board.motor_board import BoardReport, MotorBoard
from agribot.drivers.hardware_platform import HardwarePlatform
from agribot.drivers.line import schemes
from agribot.drivers.line.uri_options import UriOptions
from tests.drivers.can_fakes import FakeOdriveBus, FakeVescBus
from tests.drivers.esc_fakes import CLOSED_LOOP, IDLE
from tests.drivers.lines import Opened
from tests.drivers.test_speed_controllers import (
    AHEAD,
    CLEAR,
    ROBOT,
    STAND,
    TICK_S,
    WHEEL_RADPS,
    Linked,
)
from tests.waiting import wait_for

IDS = (11, 12, 13, 14)


def make(name: str, options: str) -> MotorBoard:
    makers: dict[str, MakeBoard] = {
        "vesc": vesc_can.make_board, "odrive": odrive_can.make_board
    }  # fmt: skip
    given = UriOptions(schemes.read_uri("--source", f"can:can0?{options}"))
    board = makers[name](ROBOT, given)
    given.check_empty()
    return board


def link_vesc(fake: FakeVescBus, ids: tuple[int, ...] = IDS) -> Linked:
    options = f"ids={','.join(map(str, ids))}&pole_pairs=7&gear=10"
    return Linked(fake, board=make("vesc", options))


def link_odrive(fake: FakeOdriveBus, options: str = "") -> Linked:
    return Linked(fake, board=make("odrive", f"gear=10&errors=active_errors&{options}"))


@pytest.mark.parametrize(
    "frame",
    [
        CanFrame(0x7FF, b"12345678"), CanFrame(0x1FFF_FFFF, b"", is_extended=True),
        CanFrame(0x29, is_remote=True),
    ],
)  # fmt: skip
def test_a_frame_comes_back_as_it_was_however_its_bytes_are_cut(frame: CanFrame) -> None:
    decoder, found = CanDecoder(), list[CanFrame]()
    for byte in frame.pack() * 3:
        found += decoder.feed(bytes((byte,)))
    assert found == [frame] * 3


def test_vescs_on_a_bus_drive_each_its_wheel_and_let_go_after_a_silence() -> None:
    fake = FakeVescBus(IDS)
    linked = link_vesc(fake).run(1.0, AHEAD)
    assert linked.speeds[-1] == pytest.approx([WHEEL_RADPS] * 4, rel=0.01)
    assert {told.stop for told in linked.told} == {None}
    linked.run(0.5, None)
    assert set(fake.erpm.values()) == {0}
    linked.run(0.5, AHEAD)
    assert linked.speeds[-1] == pytest.approx([WHEEL_RADPS] * 4, rel=0.01)


def test_vescs_tell_places_voltage_and_current_of_right_and_left() -> None:
    fake, board = FakeVescBus((11, 12)), make("vesc", "ids=11,12&pole_pairs=7&gear=10")
    found = []
    for _ in range(100):
        fake.answer(board.drive((2.0, -1.0, 2.0, -1.0), STAND.implement))
        fake.advance(TICK_S)
        found += board.feed(fake.answer(b""))
    report = found[-1].report
    assert report.wheels is not None and report.battery is not None
    assert report.wheels.speed_radps == pytest.approx((2.0, -1.0, 2.0, -1.0), rel=0.01)
    assert report.wheels.angle_rad == pytest.approx((4.0, -2.0, 4.0, -2.0), rel=0.03)
    assert report.battery.voltage_v == pytest.approx(24.6)
    assert report.battery.current_a == pytest.approx(2.4)


def test_one_vesc_that_is_silent_makes_the_board_silent() -> None:
    fake = FakeVescBus(IDS)
    linked = link_vesc(fake).run(0.5, AHEAD)
    fake.silent = {13}
    linked.run(0.1, AHEAD).told.clear()
    assert linked.run(1.0, AHEAD).told == []


def test_a_current_that_one_vesc_does_not_tell_any_more_is_not_known() -> None:
    fake, now_s = FakeVescBus((11, 12)), 0.0
    board = vesc_can.VescCanBoard((11, 12), 7, 10.0, lambda: now_s)

    def run(seconds: float, left_out: int) -> float:
        nonlocal now_s
        for _ in range(round(seconds / TICK_S)):
            now_s += TICK_S
            fake.advance(TICK_S)
            frames = CanDecoder().feed(fake.answer(b""))
            kept = [frame for frame in frames if frame.identifier != left_out]
            found = board.feed(b"".join(frame.pack() for frame in kept))
        battery = found[-1].report.battery
        assert battery is not None
        return battery.current_a

    assert run(1.0, left_out=0) == pytest.approx(2.4)
    assert math.isnan(run(1.0, left_out=vesc_can.STATUS_4 << 8 | 12))


def test_states_of_an_odrive_whose_heartbeats_stay_away_are_not_reported() -> None:
    fake, now_s = FakeOdriveBus(), 0.0
    fake.watchdogs.clear()
    board = odrive_can.OdriveCanBoard((0, 1), 10.0, "active_errors", lambda: now_s)

    def run(seconds: float) -> BoardReport:
        nonlocal now_s
        for _ in range(round(seconds / TICK_S)):
            now_s += TICK_S
            fake.advance(TICK_S)
            found = board.feed(fake.answer(board.poll()))
        assert found[-1].report.wheels is not None
        return found[-1].report

    told = run(1.0).board
    assert told is not None and told.inputs == ("battery", "motors")
    fake._beat_s = math.inf
    assert run(0.4).board == told
    assert run(0.2).board is None


def test_an_odrive_on_a_bus_stands_until_a_person_clears_its_stop_and_drives_then() -> None:
    fake = FakeOdriveBus()
    linked = link_odrive(fake).run(1.0, AHEAD)
    idle = [AxisStands("node", node, "idle", IDLE) for node in "01"]
    assert linked.last.stop == Both(*idle)
    assert (fake.states, fake.speed(0)) == ([IDLE, IDLE], 0.0)
    linked.run(1.0, AHEAD, CLEAR)
    assert linked.is_well()
    assert fake.states == [CLOSED_LOOP, CLOSED_LOOP]
    assert linked.speeds[-1] == pytest.approx([WHEEL_RADPS] * 4, rel=0.01)
    assert "battery" in linked.last.inputs


def test_a_watchdog_that_expired_is_told_and_a_person_goes_on() -> None:
    fake = FakeOdriveBus()
    linked = link_odrive(fake).run(1.0, AHEAD, CLEAR)
    fake.advance(0.31)
    assert fake.states == [IDLE, IDLE]
    linked.run(0.3, STAND)
    assert isinstance(linked.last.stop, Both) and isinstance(linked.last.fault, Both)
    assert linked.last.stop.kind == Both(*(AxisStands("node", n, "error", 0) for n in "01")).kind
    assert isinstance(linked.last.fault.first, AxisError) and linked.last.fault.first.is_expired
    linked.run(1.0, AHEAD, CLEAR)
    assert linked.is_well()
    assert fake.speed(1) > 0.0


def test_a_node_in_closed_loop_is_not_put_there_again_and_the_sides_can_be_swapped() -> None:
    fake = FakeOdriveBus()
    linked = link_odrive(fake, "nodes=1,0").run(1.0, AHEAD, CLEAR)
    fake.errors[0] = 0x40
    linked.run(0.3, AHEAD)
    assert linked.last.fault == AxisError("node", "0", 0x40, is_expired=False)
    fake.lets_go.clear()
    linked.run(1.0, AHEAD, CLEAR)
    assert linked.last.stop is None and fake.lets_go == [0]


@pytest.mark.parametrize("name", ["vesc", "odrive"])
def test_no_frames_break_a_board_or_become_nonsense(name: str) -> None:
    rng = random.Random(3)
    board = make(name, "gear=10&" + ("ids=11,12&pole_pairs=7" if name == "vesc" else "nodes=0,1"))
    for _ in range(3000):
        node, kind = (
            rng.choice((0, 1, 11, 12)),
            rng.choice((1, 3, 9, 16, 23, 27, rng.getrandbits(5))),
        )
        is_extended = name == "vesc"
        number = kind << 8 | node if is_extended else node << 5 | kind
        size = rng.randrange(9)
        frame = CanFrame(number, rng.randbytes(size), is_extended).pack()
        broken = bytearray(frame)
        broken[rng.randrange(FRAME.size)] ^= rng.randrange(2) << rng.randrange(8)
        for stamped in board.feed(bytes(broken)):
            wheels = stamped.report.wheels
            assert wheels is not None
            assert all(map(math.isfinite, (*wheels.angle_rad, *wheels.speed_radps)))


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("can:can0?board=agribot", "board=vesc"),
        ("can:can0", "board=vesc"),
        ("can:can0?board=vesc", "ids=11,12"),
        ("can:can0?board=vesc&ids=local,12", "on CAN each has an id"),
        ("can:can0?board=odrive&nodes=1,1", "nodes=0,1"),
        ("can:can0?board=odrive&nodes=1,64", "nodes=0,1"),
        ("can:can0?board=odrive&gear=10&nods=1,0", "nodes"),
    ],
)
def test_a_wrong_uri_of_a_bus_is_refused_with_what_to_write(uri: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        board_kinds.open_board(uri, ROBOT)


def test_without_its_package_a_bus_is_refused_with_the_extra(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wanted = extras.Requirement("python-can", "4.4", "can")
    monkeypatch.setattr(extras, "_list_requirements", lambda: [wanted])
    monkeypatch.setattr(extras, "_is_installed", lambda module: module != "can")
    with pytest.raises(ConfigError, match=r"python-can.*\[can\]"):
        board_kinds.open_board("can:can0?board=vesc&ids=11,12", ROBOT)


def test_a_sensor_on_a_bus_is_refused() -> None:
    with pytest.raises(ConfigError, match="base=can:can0"):
        Opened().open("gnss", "can:can0")


class LivingBus:
    """Nodes at the other end of a virtual bus, whose time passes with what they hear."""

    def __init__(self, fake: FakeVescBus | FakeOdriveBus, channel: str) -> None:
        self._fake, self._stream = fake, CanStream(channel, "virtual")
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.is_set():
            self._fake.advance(TICK_S / 10)
            self._stream.write(self._fake.answer(self._stream.read()))

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._stream.close()


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> Iterator[str]:
    pytest.importorskip("can", reason="python-can is missing (pip install -e '.[can]')")
    yield f"bus of {request.node.name}"


def test_a_robot_on_a_bus_is_armed_driven_and_stopped_as_its_program_ends(channel: str) -> None:
    fake = FakeOdriveBus()
    fake.watchdogs.clear()  # a busy machine must not matter
    bus = LivingBus(fake, channel)
    board = make("odrive", "gear=10&errors=active_errors")
    platform = HardwarePlatform(ROBOT, 50.0, board, lambda: CanStream(channel, "virtual"), "bus")
    try:
        for tick in count():
            told = platform.read().board
            platform.write(AHEAD if tick > 50 else STAND)
            if tick % 100 == 30:
                platform.inbox.post(CLEAR.request)
            if told and not told[-1].stop and fake.speed(0) > 0.0:
                break
            assert tick < 5000, (fake.states, fake.errors)
        platform.close()
        wait_for(lambda: fake.speed(0) == 0.0, "the wheels to rest")
    finally:
        platform.close()
        bus.close()


def test_a_bus_that_is_not_there_is_refused_in_words(channel: str) -> None:
    with pytest.raises(OSError, match=r"."):
        CanStream("no such channel", "no such interface")
