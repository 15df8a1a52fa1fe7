"""Sensors of a run that come from somebody else's topics: `--source gnss=ros2:/fix`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Protocol

import msgspec

from agribot.cli.bridging import checked_master, domain_from, master_from, router_from, say
from agribot.core.config import SourceConfig
from agribot.core.errors import ConfigError
from agribot.core.platform import Sensor
from agribot.ros.requests import Requests
from agribot.ros.source_uri import Network, Place, places

if TYPE_CHECKING:
    from agribot.app.run import Run
    from agribot.ros.topic_source import Ear

    class SourceLink(Ear, Protocol):
        def close(self) -> None: ...


_SENSOR_OF: dict[str, Sensor] = {"camera": "frames"}
_NODE = "agribot_sensors"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    names = ", ".join(SourceConfig.__struct_fields__)
    parser.add_argument(
        "--source",
        action="append",
        default=[],
        metavar="SENSOR=URI",
        help=f"take a sensor ({names}) from a topic: gnss=ros2:/fix, imu=ros1:/imu/data; "
        "ros2://HOST:PORT/fix and ros1://HOST:PORT/fix name router or master",
    )


def settings_of(options: argparse.Namespace) -> list[str]:
    """The options as settings of the run.

    Raises: ConfigError: not SENSOR=URI.
    """
    for text in options.source:
        if "=" not in text:
            raise ConfigError(f"--source {text}: write it as SENSOR=URI, like gnss=ros2:/fix")
    return [
        f"sources.{sensor}={msgspec.json.encode(uri).decode()}"
        for sensor, _, uri in (text.partition("=") for text in options.source)
    ]


@contextmanager
def sensor_sources(options: argparse.Namespace, session: Run) -> Iterator[None]:
    """Let the session sense what its settings take from topics.

    Raises: AgribotError: a URI that means nothing, or a network that cannot be reached.
    """
    from agribot.ros.messages.sensor_readers import readers
    from agribot.ros.topic_source import TopicSource

    wanted = places(session.config.sources)
    refuse = Requests(session.inbox, say=say).refuse
    links: dict[tuple[str, str], SourceLink] = {}
    with ExitStack() as opened:
        sources = []
        for name, place in wanted.items():
            if place[:2] not in links:
                link = opened_link(place, options, refuse)
                opened.callback(link.close)
                links[place[:2]] = link
            sensor = _SENSOR_OF.get(name) or msgspec.convert(name, Sensor)
            known = readers(sensor, session.robot)
            source = TopicSource(sensor, place.topic, links[place[:2]], known, refuse)
            sources.append(source)
        if sources:
            session.take_sensors(sources)
        yield


def opened_link(
    place: Place, options: argparse.Namespace, refuse: Callable[[str], None]
) -> SourceLink:
    """Raises: BridgeError: the network cannot be reached."""
    return _OPENERS[place.network](place.at, options, refuse)


def _ros2(at: str, options: argparse.Namespace, _refuse: Callable[[str], None]) -> SourceLink:
    from agribot.ros.ros2.link import Ros2Link

    router = f"tcp/{at}" if at else router_from(options)
    return Ros2Link(_NODE, domain=domain_from(options), router=router, listen=not at)


def _ros1(at: str, options: argparse.Namespace, refuse: Callable[[str], None]) -> SourceLink:
    from agribot.ros.ros1.link import Ros1Link

    return Ros1Link(_NODE, refuse, checked_master(f"http://{at}") if at else master_from(options))


_OPENERS: dict[Network, Callable[[str, argparse.Namespace, Callable[[str], None]], SourceLink]] = {
    "ros2": _ros2,
    "ros1": _ros1,
}
