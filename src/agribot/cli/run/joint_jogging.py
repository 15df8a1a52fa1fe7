"""`agribot teleop joystick --joints`: buttons that move joints of a robot by steps, over ROS."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from contextlib import ExitStack
from typing import TYPE_CHECKING

from agribot.cli.standard_error import print_line
from agribot.core import extras
from agribot.core.errors import ConfigError
from agribot.ros.joint_step import JointStep
from agribot.ui.hand.stick_table import TableHand

if TYPE_CHECKING:
    from agribot.description.jog_joints import JogJoint
    from agribot.ros.joint_jog import JogConnection

NODE = "agribot_jog"
# Topics of controllers of joint trajectories: ros_control of ROS 1, ros2_control.
COMMANDS = {"ros1": "command", "ros2": "joint_trajectory"}
ROUTES = "ros1:, ros1://HOST:PORT, ros2: or ros2://HOST:PORT"


def add_joint_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("joints, with buttons of a table that move them by steps")
    group.add_argument("--joints", metavar="NETWORK", help=f"of their controllers: {ROUTES}")
    group.add_argument(
        "--description",
        default="agribot",
        metavar="NAME|FILE",
        help="URDF or xacro with the joints and their limits (default: %(default)s)",
    )


def open_jogger(options: argparse.Namespace, hand: TableHand) -> ExitStack:
    """Let the steps of a table move joints; closing the result lets go of the network.

    Raises: ConfigError: a joint that cannot be moved by steps, or no network named.
        BridgeError: the network cannot be reached.
    """
    opened = ExitStack()
    if not hand.steps:
        if options.joints is not None:
            raise ConfigError(
                f"--joints {options.joints}: no button of the table moves a joint; leave it out, "
                "or give such a button to the table"
            )
        return opened
    from agribot.description.jog_joints import read_jog_joints
    from agribot.ros.joint_jog import JointJogger

    limits = read_jog_joints(options.description)
    for step in hand.steps:
        _check_step(step, limits, options.description)
    if options.joints is None:
        raise ConfigError(
            f"{hand.steps[0].name} moves joints; name their network with --joints ({ROUTES})"
        )
    scheme, connection = _connect(options.joints)
    opened.callback(connection.close)
    jogger = JointJogger(connection, COMMANDS[scheme], hand.steps, limits, _print_result)
    hand.on_step = jogger.jog
    return opened


def _check_step(step: JointStep, limits: Mapping[str, JogJoint], robot: str) -> None:
    """Refuse a joint that has no ends. Raises: ConfigError: it is not in `limits`."""
    for name in step.joints:
        if name in limits:
            continue
        known = ", ".join(sorted(limits)) or "none; its wheels are driven, all else is fixed"
        raise ConfigError(
            f"{step.name}: robot {robot} has no joint '{name}' that moves by steps (revolute or "
            f"prismatic, with limits); it has: {known}; name the robot with --description"
        )


def _connect(route: str) -> tuple[str, JogConnection]:
    scheme, _, rest = route.partition(":")
    at = rest.removeprefix("//").strip("/")
    if scheme not in COMMANDS or (rest and not rest.startswith("//")):
        raise ConfigError(f"--joints {route}: not a network; give {ROUTES}")
    options = argparse.Namespace(ros_domain=None, ros_router=None, ros_master=None)
    from agribot.cli.run.bridging import read_domain, read_master, read_router

    if scheme == "ros1":
        from agribot.ros.ros1.connection import Ros1Connection
        from agribot.ros.ros1.master import check_master

        master = check_master(f"http://{at}") if at else read_master(options)
        return scheme, Ros1Connection(NODE, print_line, master)
    extras.require("ros", f"--joints {route}")
    from agribot.ros.ros2.connection import Ros2Connection

    router = f"tcp/{at}" if at else read_router(options)
    domain = read_domain(options)
    return scheme, Ros2Connection(NODE, domain=domain, router=router, listen=not at)


def _print_result(text: str) -> None:
    print_line(f"\r{text}\x1b[K\r")
