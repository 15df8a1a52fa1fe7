"""Where a sensor comes from, as a URI: `ros2:/fix`, `ros1://HOST:PORT/imu/data`, `SCHEME:...`.

One line of the table opens one kind of source. A driver of your own is one file with a function
`open_source(sensor, uri, context)`, and one call of `register_scheme`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any, NamedTuple, TypeVar
from urllib.parse import parse_qsl, unquote, urlsplit

import msgspec

from agribot.core import extras
from agribot.core.config import SourceConfig
from agribot.core.errors import ConfigError
from agribot.core.named_functions import find_function
from agribot.core.platform import Sensor, SensorSource
from agribot.core.plugins import SOURCES, bind_settings, find_plugin, list_names
from agribot.core.robot import RobotSpec
from agribot.drivers.line.caster_login import check_no_login

Opened = TypeVar("Opened")
BASE = "base"  # the motor board, which `platform = "hardware"` opens itself
CAN = "can"  # scheme of motor boards alone
_SENSOR_OF: dict[str, Sensor] = {"camera": "frames", "scan": "scans"}  # settings name it for people


class SourceUri(NamedTuple):
    """`at` is what stands behind two slashes, such as HOST:PORT; `path` what comes after it.

    `options` are what stands behind a question mark, such as `baud=38400&latency_s=0.06`.
    """

    scheme: str
    at: str
    path: str
    options: tuple[tuple[str, str], ...] = ()

    @property
    def name(self) -> str:
        """Name of the source, for people."""
        return self.path if not self.at else self.at + self.path.rstrip("/")


class RosNetwork(NamedTuple):
    """Addresses of ROS 2 and ROS 1, if a URI does not say; asked when a source needs it.

    Each raises a ConfigError if its setting is invalid.
    """

    domain: Callable[[], int]
    router: Callable[[], str]
    master: Callable[[], str]


class SourceContext:
    """Shared objects of sources; it closes all of them.

    `refuse` gets what a source does not take, and why; `plugins` are `RunConfig.plugins`. Use it
    as a context.
    """

    def __init__(
        self,
        robot: RobotSpec,
        ros: RosNetwork,
        refuse: Callable[[str], None],
        plugins: Mapping[str, Any] | None = None,
    ) -> None:
        self.robot, self.ros, self.refuse = robot, ros, refuse
        self.plugins = plugins or {}
        self._shared: dict[object, Any] = {}
        self._opened = ExitStack()

    def share(self, key: object, open_it: Callable[[], Opened]) -> Opened:
        """Open a connection once for all sources that name it by the same key."""
        if key not in self._shared:
            connection: Any = open_it()
            self._opened.callback(connection.close)
            self._shared[key] = connection
        shared: Opened = self._shared[key]
        return shared

    def __enter__(self) -> SourceContext:
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.close()


OpenSource = Callable[[Sensor, SourceUri, SourceContext], SensorSource]


class SourceKind(NamedTuple):
    """Opener of a scheme's sources; a text is "module:function", imported when wanted."""

    opener: OpenSource | str
    extra: str = ""  # extra of the installation that it needs
    example: str = ""  # an example of its URIs
    needs_path: bool = True  # else what stands behind two slashes is enough, or nothing
    is_verbatim: bool = False  # `path` is all that stands behind the colon, as it is written


_CAMERA = "agribot.drivers.camera.cameras:open_camera"
_STREAMS = "agribot.drivers.stream_sources:"
_KINDS: dict[str, SourceKind] = {
    "ros2": SourceKind("agribot.drivers.ros_topics:open_ros2_topic", "ros", "ros2:/topic"),
    "ros1": SourceKind("agribot.drivers.ros_topics:open_ros1_topic", "", "ros1:/topic"),
    "serial": SourceKind(f"{_STREAMS}open_serial_source", "hardware", "serial:/dev/ttyACM0"),
    "tcp": SourceKind(f"{_STREAMS}open_tcp_source", "", "tcp://HOST:PORT", needs_path=False),
    "gpsd": SourceKind(f"{_STREAMS}open_gpsd_source", "", "gpsd:", needs_path=False),
    "lcus": SourceKind(
        "agribot.drivers.power.lcus_relay:open_relay", "hardware", "lcus:/dev/serial/by-path/..."
    ),
    CAN: SourceKind(f"{_STREAMS}refuse_can", "", "can:can0 (base)"),
    "v4l2": SourceKind(_CAMERA, "", "v4l2:/dev/video0"),
    "video": SourceKind(_CAMERA, "", "video:FILE"),
    "rtsp": SourceKind(_CAMERA, "", "rtsp://HOST/PATH", is_verbatim=True),
    "pipe": SourceKind(_CAMERA, "", "pipe:COMMAND", is_verbatim=True),
}


def register_scheme(
    scheme: str, opener: OpenSource | str, extra: str = "", example: str = ""
) -> None:
    """Let `--source SENSOR=SCHEME:...` open sources of your own.

    Raises: ConfigError: the scheme is taken.
    """
    if scheme in _KINDS:
        raise ConfigError(f"the scheme {scheme!r} is registered already; choose another name")
    _KINDS[scheme] = SourceKind(opener, extra, example or f"{scheme}:...")


def find_scheme(scheme: str) -> SourceKind | None:
    """Find what opens the sources of a scheme, here or in an installed package.

    Raises: ConfigError: the package cannot be imported.
    """
    if scheme in _KINDS:
        return _KINDS[scheme]
    installed = find_plugin(SOURCES, scheme) if scheme else None
    if installed is None or isinstance(installed, SourceKind):
        return installed
    return SourceKind(installed, "", f"{scheme}:...", needs_path=False)


def _get_scheme(uri: SourceUri) -> SourceKind:
    """Find the scheme of a URI that was read."""
    kind = find_scheme(uri.scheme)
    if kind is None:
        raise ConfigError(f"{uri.scheme}:{uri.name}: no such scheme is known; check its spelling")
    return kind


def read_uri(option: str, uri: str, name: str = "") -> SourceUri:
    """Read what `option` names, after `name` if it has one.

    Raises: ConfigError: a URI of no known scheme, or one that names nothing.
    """
    if "ntrip" in uri:
        check_no_login(unquote(uri))  # before the settings are written anywhere
    try:
        parts = urlsplit(uri)
    except ValueError:  # half an IPv6 address
        parts = urlsplit("")
    kind = find_scheme(parts.scheme)
    rest = uri.partition(":")[2]
    if kind is not None and kind.is_verbatim and rest.strip():
        return SourceUri(parts.scheme, "", rest)
    if kind is None or (kind.needs_path and not parts.path.strip("/")):
        kinds = [*_KINDS.values(), *(find_scheme(found) for found in list_names(SOURCES))]
        known = " or ".join(f"{name}{kind.example}" for kind in kinds if kind is not None)
        raise ConfigError(f"{option} {name}{uri}: unknown; write {known}, or leave it out")
    options = tuple(parse_qsl(parts.query, keep_blank_values=True))
    return SourceUri(parts.scheme, parts.netloc, "/" + parts.path.strip("/"), options)


def read_sources(sources: SourceConfig) -> dict[str, SourceUri]:
    """Sensor -> URI, of those that come from elsewhere; `base` is no sensor.

    Raises: ConfigError: a URI that means nothing.
    """
    wanted = msgspec.structs.asdict(sources)
    del wanted[BASE]
    return {name: read_uri("--source", uri, f"{name}=") for name, uri in wanted.items() if uri}


def require_extras(sources: Mapping[str, SourceUri]) -> None:
    """Refuse sources that need packages which are not installed.

    Raises: MissingExtraError: one does.
    """
    for name, uri in sources.items():
        extra = _get_scheme(uri).extra
        if extra:
            extras.require(extra, f"--source {name}={uri.scheme}:{uri.path}")


def open_source(name: str, uri: SourceUri, context: SourceContext) -> SensorSource:
    """Open the source of a sensor, which `name` calls as the settings do.

    Raises: AgribotError: it cannot be opened.
    """
    sensor = _SENSOR_OF.get(name) or msgspec.convert(name, Sensor)
    opener = find_function(_get_scheme(uri).opener, f"--source {name}={uri.scheme}:{uri.path}")
    settings = bind_settings(opener, context.plugins, uri.scheme)
    source: SensorSource = opener(sensor, uri, context, **settings)
    return source
