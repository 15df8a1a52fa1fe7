"""Where a sensor comes from, in words: ros2:/fix, ros1:/imu/data, ros2://HOST:PORT/fix."""

from __future__ import annotations

from typing import Literal, NamedTuple
from urllib.parse import urlsplit

import msgspec

from agribot.core.config import SourceConfig
from agribot.core.errors import ConfigError

Network = Literal["ros2", "ros1"]
_NETWORKS: dict[str, Network] = {"ros2": "ros2", "ros1": "ros1"}


class Place(NamedTuple):
    """`at` is HOST:PORT of the router or master, empty for the usual one."""

    network: Network
    at: str
    topic: str


def places(sources: SourceConfig) -> dict[str, Place]:
    """Sensor -> topic, of those that come from elsewhere.

    Raises: ConfigError: a URI that means nothing.
    """
    wanted = msgspec.structs.asdict(sources)
    return {name: read_uri("--source", uri, f"{name}=") for name, uri in wanted.items() if uri}


def read_uri(option: str, uri: str, name: str = "") -> Place:
    """What `option` names, after `name` if it has one.

    Raises: ConfigError: a URI that means nothing.
    """
    try:
        parts = urlsplit(uri)
    except ValueError:  # half an IPv6 address
        parts = urlsplit("")
    if parts.scheme not in _NETWORKS or not parts.path.strip("/"):
        known = " or ".join(f"{name}{network}:/topic" for network in _NETWORKS)
        raise ConfigError(f"{option} {name}{uri}: write {known}, or leave it out")
    return Place(_NETWORKS[parts.scheme], parts.netloc, "/" + parts.path.strip("/"))
