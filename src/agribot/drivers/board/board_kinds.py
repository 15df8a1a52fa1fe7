"""The kinds of motor boards by name, and the line on which one is: `serial:/dev/x?board=vesc`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from agribot.core import extras
from agribot.core.errors import ConfigError
from agribot.core.named_functions import find_function
from agribot.core.plugins import BOARDS, bind_settings, find_plugin, list_names
from agribot.core.robot import RobotSpec
from agribot.core.suggestions import suggest_name
from agribot.drivers.board.can_frames import CanStream
from agribot.drivers.board.motor_board import MotorBoard
from agribot.drivers.line.byte_streams import OpenStream, SerialStream, TcpStream
from agribot.drivers.line.schemes import BASE, CAN, SourceUri, read_uri
from agribot.drivers.line.uri_options import UriOptions
from agribot.drivers.stream_sources import read_address

# Maker of a board from `RobotSpec` and `UriOptions`, and `settings`.
MakeBoard = Callable[..., MotorBoard]


class BoardLine(NamedTuple):
    """A board, how its line is opened, and the name of that line."""

    board: MotorBoard
    open_stream: OpenStream
    name: str


class _Kind(NamedTuple):
    maker: MakeBoard | str
    baud: int


_KINDS: dict[str, _Kind] = {
    "agribot": _Kind("agribot.drivers.board.agribot_board:make_board", 250_000),
    "vesc": _Kind("agribot.drivers.board.vesc:make_board", 115_200),
    "odrive": _Kind("agribot.drivers.board.odrive:make_board", 115_200),
}
_CAN_KINDS: dict[str, MakeBoard | str] = {
    "vesc": "agribot.drivers.board.vesc_can:make_board",
    "odrive": "agribot.drivers.board.odrive_can:make_board",
}
EXAMPLE = "--source base=serial:/dev/ttyACM0?board=agribot"


def register_board(name: str, maker: MakeBoard | str, baud: int = 115_200) -> None:
    """Let `board=NAME` of `--source base=` choose a board of your own.

    Raises: ConfigError: the name is taken.
    """
    if name in _KINDS:
        raise ConfigError(f"the board {name!r} is registered already; choose another name")
    _KINDS[name] = _Kind(maker, baud)


def open_board(
    uri_text: str,
    robot: RobotSpec,
    settings: Mapping[str, float] | None = None,
    plugins: Mapping[str, Any] | None = None,
) -> BoardLine:
    """Make the board that a URI names, without opening its line.

    `settings` are options that count where the URI does not state them, `plugins` those of
    `RunConfig.plugins`.

    Raises: ConfigError: none is named, or the URI means nothing.
    """
    if not uri_text:
        raise ConfigError(
            f"platform = 'hardware' needs its motor board; add {EXAMPLE} "
            f"(boards: {', '.join(_KINDS)})"
        )
    uri = read_uri("--source", uri_text, f"{BASE}=")
    options = UriOptions(uri, settings)
    name = options.pop_text("board", "agribot")
    kind = _KINDS.get(name) or _find_installed(name)
    if kind is None:
        known = [*_KINDS, *list_names(BOARDS)]
        raise ConfigError(
            f"--source {BASE}={uri_text}: board={name}{suggest_name(name, known)}; known: "
            f"{', '.join(known)}"
        )
    if uri.scheme == CAN and name not in _CAN_KINDS:
        raise ConfigError(
            f"--source {BASE}={uri_text}: board={name} is on no CAN bus; boards there: "
            f"{', '.join(f'board={one}' for one in _CAN_KINDS)}"
        )
    open_stream = _find_line(uri, options, kind.baud)
    found = _CAN_KINDS[name] if uri.scheme == CAN else kind.maker
    maker: MakeBoard = find_function(found, f"board={name}")
    board = maker(robot, options, **bind_settings(maker, plugins or {}, name))
    options.check_empty()
    return BoardLine(board, open_stream, uri.name)


def _find_installed(name: str) -> _Kind | None:
    """Find a board of an installed package; its `baud` is an attribute, 115,200 by default."""
    maker = find_plugin(BOARDS, name)
    return None if maker is None else _Kind(maker, getattr(maker, "baud", 115_200))


def _find_line(uri: SourceUri, options: UriOptions, default_baud: int) -> OpenStream:
    if uri.scheme == "tcp":
        host, port = read_address(uri, None)
        return lambda: TcpStream(host, port)
    if uri.scheme == CAN:
        extras.require("can", f"--source {BASE}={CAN}:{uri.path.strip('/')}")
        interface = options.pop_text("interface", "socketcan")
        bitrate = int(options.pop_number("bitrate", 0.0, 0.0, 1e6))
        return lambda: CanStream(uri.path.strip("/"), interface, bitrate)
    if uri.scheme != "serial":
        raise ConfigError(
            f"--source {BASE}={uri.scheme}:{uri.name}: not the line of a motor board; give "
            f"{EXAMPLE}, tcp://HOST:PORT or can:can0?board=vesc"
        )
    extras.require("hardware", f"--source {BASE}=serial:{uri.path}")
    baud = int(options.pop_number("baud", default_baud, 300, 4_000_000))
    return lambda: SerialStream(uri.path, baud)
