"""Sensors of a run that come from elsewhere than its platform: `--source gnss=ros2:/fix`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import msgspec

from agribot.cli.run.bridging import read_domain, read_master, read_router
from agribot.cli.standard_error import print_line
from agribot.core.config import SourceConfig
from agribot.core.errors import ConfigError
from agribot.core.robot import RobotSpec
from agribot.drivers.line.schemes import RosNetwork, SourceContext, open_source, read_sources
from agribot.ros.requests import Requests

if TYPE_CHECKING:
    from agribot.app.run import Run


def add_arguments(parser: argparse.ArgumentParser) -> None:
    names = ", ".join(SourceConfig.__struct_fields__)
    parser.add_argument(
        "--source",
        action="append",
        default=[],
        metavar="SENSOR=URI",
        help=f"take a sensor ({names}) from elsewhere: gnss=serial:/dev/ttyACM0?baud=38400, "
        "gnss=gpsd:, gnss=tcp://HOST:PORT, gnss=ros2:/fix, imu=ros1:/imu/data, "
        "camera=v4l2:/dev/video0, camera=pipe:COMMAND, contactor=lcus:/dev/ttyUSB3, "
        "base=serial:/dev/ttyACM1?board=agribot; "
        "ros2://HOST:PORT/fix and ros1://HOST:PORT/fix name router or master",
    )


def read_source_settings(options: argparse.Namespace) -> list[str]:
    """Read the options as settings of the run.

    Raises: ConfigError: not SENSOR=URI, or two URIs of one sensor.
    """
    uris: dict[str, str] = {}
    for text in options.source:
        sensor, is_given, uri = text.partition("=")
        sensor = sensor.strip()
        if not is_given:
            raise ConfigError(f"--source {text}: no URI; write SENSOR=URI, as in gnss=ros2:/fix")
        if sensor in uris:
            raise ConfigError(
                f"--source {sensor}={uris[sensor]} and --source {sensor}={uri}: a sensor comes "
                "from one place; leave one of them out"
            )
        uris[sensor] = uri
    return [f"sources.{sensor}={msgspec.json.encode(uri).decode()}" for sensor, uri in uris.items()]


@contextmanager
def open_sensor_sources(options: argparse.Namespace, session: Run) -> Iterator[None]:
    """Connect the run to what its settings take from elsewhere.

    Raises: AgribotError: a URI that means nothing, or a source that cannot be opened.
    """
    wanted = read_sources(session.config.sources)
    refuse = Requests(session.inbox, report=print_line).refuse
    plugins = session.config.plugins
    with source_context(session.robot, options, refuse, plugins) as context:
        sources = [open_source(name, uri, context) for name, uri in wanted.items()]
        if sources:
            session.take_sensors(sources)
        yield


def source_context(
    robot: RobotSpec,
    options: argparse.Namespace,
    refuse: Callable[[str], None],
    plugins: Mapping[str, Any] | None = None,
) -> SourceContext:
    """Make a context for sources, with the networks that the options name.

    `plugins` are `RunConfig.plugins`.
    """
    network = RosNetwork(
        domain=lambda: read_domain(options),
        router=lambda: read_router(options),
        master=lambda: read_master(options),
    )
    return SourceContext(robot, network, refuse, plugins)
