"""The running robot that a command connects to."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from urllib.parse import urlsplit

from agribot.cli.ranges import port
from agribot.core.errors import ConfigError
from agribot.ui.address import DEFAULT_PORT, RobotDoor, read_door


def add_robot_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--url", metavar="WS", help="ws://HOST:PORT/ws/v1 of a robot elsewhere; wss:// with TLS"
    )
    parser.add_argument("--token", help="of the robot at --url (default: $AGRIBOT_TOKEN)")
    parser.add_argument("--cert", default="", metavar="FILE", help="its self-signed certificate")
    parser.add_argument(
        "--port", type=port, default=DEFAULT_PORT, help="of a robot on this machine"
    )


def find_robot(options: argparse.Namespace) -> RobotDoor:
    """Find the robot on this machine, or the one of the options.

    Raises: ConfigError: no robot with a page on this machine; of another one no address, token
        or certificate.
    """
    if options.url is None:
        return read_door(options.port)
    _check_url(options.url)
    if options.cert and not Path(options.cert).is_file():
        raise ConfigError(f"--cert {options.cert}: no such file; copy the robot's --tls-cert here")
    token = options.token or os.environ.get("AGRIBOT_TOKEN", "")
    if not token:
        raise ConfigError("--url needs the robot's token; give --token or set AGRIBOT_TOKEN")
    return RobotDoor(url=options.url, token=token, cert=options.cert)


def _check_url(url: str) -> None:
    try:
        parts = urlsplit(url)
        is_good = parts.scheme in {"ws", "wss"} and parts.hostname and parts.port != 0
    except ValueError:  # a port that is no number
        is_good = False
    if not is_good:
        raise ConfigError(
            f"--url {url}: not a robot's address; give ws://HOST:PORT/ws/v1, or wss:// with TLS"
        )
