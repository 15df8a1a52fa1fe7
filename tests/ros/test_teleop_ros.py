"""Keys of a terminal as twists on a topic: a simulated world is driven over ROS 1 and ROS 2."""

from __future__ import annotations

import math
import os
import pty
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.requests import read_twist_cdr
from agribot.ros.ros1.connection import Ros1Connection
from agribot.ros.ros2.connection import Ros2Connection
from agribot.ros.twist_publisher import (
    STAMPED,
    STOPS,
    TwistPublisher,
    TwistSink,
    find_own_host,
    make_twist_topic,
)
from tests import machine
from tests.ros.live import free_port
from tests.ros.ros1_system import Ros1
from tests.waiting import PATIENCE_S, wait_for

UP = b"\x1b[A"


class Wire:
    def __init__(self) -> None:
        self.sent, self.closed = list[bytes](), False

    def close(self) -> None:
        self.closed = True

    def open(self, *, is_stamped: bool = False) -> TwistPublisher:
        sink = TwistSink(self.sent.append, self.close, lambda: "nowhere")
        return TwistPublisher(sink, is_stamped=is_stamped, sleep=lambda _s: None)


def test_whatever_ends_it_the_last_twists_are_zero() -> None:
    wire = Wire()
    with pytest.raises(ZeroDivisionError), wire.open() as robot:
        robot.drive(0.5, -0.2)
        raise ZeroDivisionError
    assert wire.closed
    twists = [read_twist_cdr(data) for data in wire.sent]
    assert twists[0] == (0.5, 0.0, 0.0, 0.0, 0.0, -0.2)
    assert twists[1:] == [(0.0,) * 6] * STOPS


def test_a_network_that_is_lost_is_closed_and_said() -> None:
    wire = Wire()

    def fail(_data: bytes) -> None:
        raise BridgeError("the router is gone")

    sink = TwistSink(fail, wire.close, lambda: "nowhere")
    with pytest.raises(BridgeError), TwistPublisher(sink, is_stamped=False) as robot:
        robot.drive(0.5, 0.0)
    assert wire.closed


def test_a_stamped_twist_has_the_time_of_the_wall_and_the_frame_of_the_robot() -> None:
    wire = Wire()
    with wire.open(is_stamped=True) as robot:
        robot.drive(0.3, 0.1)
    message = load_types().deserialize_cdr(wire.sent[0], STAMPED)
    assert message.header.frame_id == "base_link"  # type: ignore[attr-defined]
    assert message.header.stamp.sec > 1_700_000_000  # type: ignore[attr-defined]
    assert message.twist.linear.x == 0.3  # type: ignore[attr-defined]
    assert message.twist.angular.z == 0.1  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--ros1", "--topic", "cmd vel"), "not a name; write one such as"),
        (("--ros1", "--rate", "8"), "at least 10 Hz"),
        (("--ros1", "nowhere"), "http://HOST:PORT"),
        (("--ros1", "--take-over"), "--take-over is for a robot with a page"),
        (("--stamped",), "add --ros1, --ros2 or --dds"),
    ],
    ids=["name", "rate", "master", "seat", "stray"],
)
def test_options_that_cannot_be_are_refused_in_words(
    options: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with _a_terminal():
        assert main(("teleop", "keyboard", *options)) == 2
    assert said in capsys.readouterr().err


@contextmanager
def _a_terminal() -> Iterator[None]:
    """A terminal on the standard input of this process."""
    ours, theirs = pty.openpty()
    before = sys.stdin
    try:
        with os.fdopen(theirs, "r", closefd=False) as terminal:
            sys.stdin = terminal
            yield
    finally:
        sys.stdin = before
        os.close(ours)
        os.close(theirs)


def test_the_own_address_is_that_of_the_way_to_the_master(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ROS_IP", "ROS_HOSTNAME"):
        monkeypatch.delenv(name, raising=False)
    assert find_own_host("http://127.0.0.1:11311") == "127.0.0.1"
    monkeypatch.setenv("ROS_IP", "10.0.0.7")
    assert find_own_host("http://127.0.0.1:11311") == "10.0.0.7"


def test_the_topic_may_have_any_name_of_ros() -> None:
    assert make_twist_topic("/husky_1/Cmd", is_stamped=True).ros_type == STAMPED


class Watch:
    """What arrives of the twists and of the driven robot's odometry."""

    def __init__(self, link: Ros1Connection | Ros2Connection) -> None:
        self.twists, self.speeds = list[tuple[float, ...]](), list[float]()
        link.subscribe(topics.CMD_VEL, lambda data: self.twists.append(read_twist_cdr(data)))
        link.subscribe(topics.ODOM, self._on_odometry)

    def _on_odometry(self, data: bytes) -> None:
        message = load_types().deserialize_cdr(data, topics.ODOM.ros_type)
        self.speeds.append(message.twist.twist.linear.x)  # type: ignore[attr-defined]


class Hand:
    """A terminal with a key that repeats while it is held."""

    def __init__(self, *words: str) -> None:
        self._ours, self._theirs = pty.openpty()
        self._held = threading.Event()
        self._over = threading.Event()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "agribot.cli", "teleop", "keyboard", *words],
            stdin=self._theirs, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        threading.Thread(target=self._repeat, daemon=True).start()

    def _repeat(self) -> None:
        while not self._over.wait(0.03):
            if self._held.is_set():
                os.write(self._ours, UP)

    def hold(self) -> None:
        self._held.set()

    def release(self) -> None:
        self._held.clear()

    def close(self) -> None:
        self._over.set()
        self.process.kill()
        self.process.communicate()
        os.close(self._theirs)


@contextmanager
def _world(folder: Path, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    command = (
        sys.executable, "-m", "agribot.cli", "sim", "--world", "empty",
        "--set", "record.enabled=false", *words,
    )  # fmt: skip
    with subprocess.Popen(command, stderr=subprocess.DEVNULL, cwd=folder) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)


def _drive_and_let_go(hand: Hand, watch: Watch) -> None:
    wait_for(lambda: watch.speeds, "the world's odometry")
    hand.hold()
    wait_for(lambda: watch.speeds[-1] > 0.3, "the world to be driven")
    hand.release()
    wait_for(lambda: abs(watch.speeds[-1]) < 0.01, "the world to stand after the key")
    assert watch.twists[-1] == (0.0,) * 6
    hand.hold()
    wait_for(lambda: watch.speeds[-1] > 0.3, "the world to be driven again")
    hand.process.send_signal(signal.SIGTERM)
    assert hand.process.wait(PATIENCE_S) == 0
    wait_for(lambda: abs(watch.speeds[-1]) < 0.01, "the world to stand after the end")
    assert watch.twists[-STOPS:] == [(0.0,) * 6] * STOPS
    assert max(twist[0] for twist in watch.twists) == 0.8
    assert not any(math.isnan(n) for twist in watch.twists for n in twist)


def _prove(world: tuple[str, ...], hand: tuple[str, ...], folder: Path,
           connect: Callable[[], Ros1Connection | Ros2Connection]) -> None:  # fmt: skip
    # Two that try for the router at one time may both fail: the others join this one.
    with closing(connect()) as link, _world(folder, *world), closing(Hand(*hand)) as driver:
        _drive_and_let_go(driver, Watch(link))


def test_keys_drive_a_world_over_ros2_and_let_it_stand(tmp_path: Path) -> None:
    router = f"tcp/127.0.0.1:{free_port()}"
    _prove(
        ("--ros2", "--ros-router", router), ("--ros2", router), tmp_path,
        lambda: Ros2Connection("watch", router=router, listen=True),
    )  # fmt: skip


@machine.needs("roscore")
def test_keys_drive_a_world_over_a_real_ros1_master(tmp_path: Path) -> None:
    ros1 = Ros1(tmp_path)
    try:
        _prove(
            ("--ros1", "--ros-master", ros1.uri), ("--ros1", ros1.uri), tmp_path,
            lambda: Ros1Connection("watch", print, ros1.uri),
        )  # fmt: skip
    finally:
        ros1.close()
