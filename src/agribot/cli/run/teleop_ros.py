"""`agribot teleop --ros1|--ros2|--dds`: keys, mouse or gamepad as twists on a topic of ROS."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from agribot.cli.run.bridging import read_domain
from agribot.cli.stopping import stop_on_signal
from agribot.core import extras, topics
from agribot.core.errors import ConfigError
from agribot.ros.ros1.master import MASTER, check_master
from agribot.ui.hand.inputs import Twist, Wish

if TYPE_CHECKING:
    from agribot.ros.twist_publisher import TwistSink

MIN_RATE_HZ = 10.0  # robots stop by themselves between 0.2 and 1 s after the last twist
PAGE_OPTIONS = ("url", "token", "take_over")

Read = Callable[[float], Wish]


def add_ros_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group(
        "any robot of ROS, in place of one with a page (its own timeout must stop it when the "
        "network is lost)"
    )
    where = group.add_mutually_exclusive_group()
    where.add_argument(
        "--ros1", nargs="?", const="", metavar="MASTER",
        help="publish at this ROS 1 master (default: ROS_MASTER_URI or http://127.0.0.1:11311)",
    )  # fmt: skip
    where.add_argument(
        "--ros2", nargs="?", const="", metavar="ROUTER",
        help="publish at this zenoh router (default: tcp/127.0.0.1:7447)",
    )  # fmt: skip
    where.add_argument("--dds", action="store_true", help="publish on Fast DDS and Cyclone DDS")
    group.add_argument(
        "--topic", metavar="NAME", help=f"of the twists (default: {topics.CMD_VEL.name})"
    )
    group.add_argument(
        "--stamped", action="store_true", help="publish TwistStamped in place of Twist"
    )
    group.add_argument("--ros-domain", type=int, metavar="N", help="default: ROS_DOMAIN_ID or 0")


def is_wanted(options: argparse.Namespace) -> bool:
    """Return whether twists go to a topic; refuse options that belong to the other way.

    Raises: ConfigError: an option does not belong to what drives.
    """
    is_ros = options.ros1 is not None or options.ros2 is not None or options.dds
    if is_ros:
        stray = [name for name in PAGE_OPTIONS if getattr(options, name)]
        if stray:
            name = stray[0].replace("_", "-")
            raise ConfigError(
                f"--{name} is for a robot with a page, not for a topic of ROS; leave it out"
            )
        if options.rate_hz < MIN_RATE_HZ:
            raise ConfigError(
                f"--rate {options.rate_hz:g}: robots stop between two twists of a topic of ROS; "
                f"give at least {MIN_RATE_HZ:g} Hz"
            )
    elif options.topic or options.stamped or options.ros_domain is not None:
        raise ConfigError(
            "--topic, --stamped and --ros-domain are for ROS; add --ros1, --ros2 or --dds"
        )
    return bool(is_ros)


def run(
    options: argparse.Namespace, open_hand: Callable[[], AbstractContextManager[Read]], help: str
) -> int:
    """Publish what the hand asks for until it quits, then stop the robot."""
    from agribot.ros.twist_publisher import TwistPublisher, make_twist_topic

    topic = make_twist_topic(options.topic or topics.CMD_VEL.name, is_stamped=options.stamped)
    with (
        open_hand() as read,
        stop_on_signal() as stop,
        TwistPublisher(_open_sink(options, topic), is_stamped=options.stamped) as robot,
    ):
        sys.stderr.write(f"{help}\r\npublishing {topic.ros_type} at {options.rate_hz:g} Hz: ")
        sys.stderr.write(f"{robot.describe()}\r\n")
        _drive(robot.drive, read, options.rate_hz, stop, robot.describe)
    sys.stderr.write("\nstopped the robot\n")
    return 0


def _drive(
    drive: Callable[[float, float], None],
    read: Read,
    rate_hz: float,
    stop: list[int],
    describe: Callable[[], str],
) -> None:
    """Publish a twist at every period, also at rest, as key_teleop did."""
    while not stop:
        twist, requests = read(1.0 / rate_hz)
        for request in requests:
            if request.name != "stop":  # the twist itself says stop
                _show(f"{request.name} needs a robot with a page", end="\r\n")
        if twist is None:
            return
        drive(*twist)
        if sys.stderr.isatty():
            _show(f"{_format(twist)}  {describe()}")


def _open_sink(options: argparse.Namespace, topic: topics.Topic) -> TwistSink:
    from agribot.ros import twist_publisher as sinks
    from agribot.ros.ros2.node import ROUTER

    if options.ros1 is not None:
        master = options.ros1 or os.environ.get("ROS_MASTER_URI") or MASTER
        return sinks.open_ros1_sink(topic, check_master(master))
    domain = read_domain(options)
    if options.dds:
        extras.require("dds", "--dds")
        return sinks.open_dds_sink(topic, domain)
    extras.require("ros", "--ros2")
    return sinks.open_ros2_sink(topic, domain, options.ros2 or ROUTER)


def _format(twist: Twist) -> str:
    return f"{twist[0]:+.2f} m/s {twist[1]:+.2f} rad/s"


def _show(text: str, end: str = "") -> None:
    sys.stderr.write(f"\r{text}\x1b[K{end}")
    sys.stderr.flush()
