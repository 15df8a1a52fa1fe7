"""URIs of sensor topics: ros2:/fix, ros1:/imu/data, ros2://HOST:PORT/fix."""

from __future__ import annotations

from typing import Literal, NamedTuple
from urllib.parse import urlsplit

import msgspec

from agribot.core.config import SourceConfig
from agribot.core.errors import ConfigError

Network = Literal["ros2", "ros1"]
_NETWORKS: dict[str, Network] = {"ros2": "ros2", "ros1": "ros1"}


class TopicAddress(NamedTuple):
    """A topic of a network; `at` is HOST:PORT of its router or master, empty for the default."""

    network: Network
    at: str
    topic: str


def parse_sources(sources: SourceConfig) -> dict[str, TopicAddress]:
    """Parse the topics of the sensors that come from a network, by sensor.

    Raises: ConfigError: a URI that names no topic.
    """
    wanted = msgspec.structs.asdict(sources)
    return {name: parse_uri("--source", uri, f"{name}=") for name, uri in wanted.items() if uri}


def parse_uri(option: str, uri: str, name: str = "") -> TopicAddress:
    """Parse the URI of an option, `name` being the part before it.

    Raises: ConfigError: a URI that names no topic.
    """
    try:
        parts = urlsplit(uri)
    except ValueError:  # half an IPv6 address
        parts = urlsplit("")
    if parts.scheme not in _NETWORKS or not parts.path.strip("/"):
        known = " or ".join(f"{name}{network}:/topic" for network in _NETWORKS)
        raise ConfigError(f"{option} {name}{uri}: write {known}, or leave it out")
    return TopicAddress(_NETWORKS[parts.scheme], parts.netloc, "/" + parts.path.strip("/"))
