"""`agribot board`: what a board of ours is and how it is, and its program written into it."""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING

from agribot.cli.ranges import finite
from agribot.cli.standard_error import print_line
from agribot.core import extras
from agribot.core.errors import ConfigError

if TYPE_CHECKING:
    from agribot.drivers.board_probe import BoardProbe, FoundBoard
    from agribot.drivers.schemes import SourceUri

PERIOD_S = 1.0  # of a line
KINDS = ("motor", "imu")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    show = actions.add_parser(
        "show", help="which board is there, its firmware, what stops it, battery",
        description="Hear a line and ask the board of ours that speaks there. Opening the line "
        "resets the board.",
        epilog="example: agribot board show serial:/dev/agribot-base",
    )  # fmt: skip
    flash = actions.add_parser(
        "flash", help="write the program of a board into an Arduino Mega 2560",
        description="Write the program of the motor board or of the IMU board into a Mega, "
        "through its bootloader, and ask the board for its version. Needs avrdude.",
        epilog="example: agribot board flash motor serial:/dev/ttyACM0",
    )  # fmt: skip
    flash.add_argument("kind", choices=KINDS, help="motor or imu")
    show.add_argument(
        "--for", dest="seconds", type=finite, default=0.0, metavar="SECONDS",
        help="go on with a line a second",
    )  # fmt: skip
    for made in (show, flash):
        made.add_argument("uri", metavar="URI", help="serial:/dev/ttyACM0, or with ?baud=")
        made.add_argument("--json", action="store_true", help="the result as the last line")


def run(options: argparse.Namespace) -> int:
    """Show a board, or flash it.

    Raises: ConfigError: a line that cannot be opened, or no board of ours at it.
    """
    from agribot.drivers.board_protocol import BoardKind
    from agribot.drivers.schemes import read_uri

    uri = read_uri(f"agribot board {options.action}", options.uri, "")
    if uri.scheme == "serial":
        extras.require("hardware", f"agribot board {options.action} {options.uri}")
    wanted = None
    if options.action == "flash":
        from agribot.drivers.board_programs import flash

        if uri.scheme != "serial":
            raise ConfigError(f"{options.uri}: a board is flashed at its own line: serial:/dev/...")
        wanted = BoardKind[options.kind.upper()]
        flash(wanted, uri.path)
    found = _find(uri, wanted, getattr(options, "seconds", 0.0))
    if options.json:
        _print_json(found)
    return 0 if found.is_understood else 1


def _find(uri: SourceUri, wanted: object, seconds: float) -> FoundBoard:
    """Ask at the speed of each board, or at that of the URI, and print what is there."""
    from agribot.drivers.board_probe import BAUDS, BoardProbe
    from agribot.drivers.stream_sources import open_receiver_line

    bauds = [baud for kind, baud in BAUDS.items() if wanted in (None, kind)]
    is_told = uri.scheme != "serial" or bool(dict(uri.options).get("baud"))
    lines = [uri] if is_told else [uri._replace(options=(("baud", str(b)),)) for b in bauds]
    for line in lines:
        stream = open_receiver_line(line)
        try:
            probe = BoardProbe(stream, time.monotonic)
            found = probe.ask()
            if found is not None:
                return _print_on(probe, found, seconds)
        except OSError as error:
            raise ConfigError(f"{uri.name}: the line broke: {error.strerror or error}") from error
        finally:
            stream.close()
    raise ConfigError(
        f"{uri.name}: no board of ours speaks there; write its program into it (agribot board "
        "flash), and check its power and that the other program that may use the line has ended"
    )


def _print_on(probe: BoardProbe, found: FoundBoard, seconds: float) -> FoundBoard:
    """Print a board, and go on with a line a second; gives the last of it."""
    from agribot.drivers.board_probe import describe_board

    print_line(describe_board(found))
    until_s = time.monotonic() + seconds
    try:
        while time.monotonic() < until_s:
            found = probe.listen(PERIOD_S) or found
            print_line(describe_board(found))
    except KeyboardInterrupt:
        pass
    return found


def _print_json(found: FoundBoard) -> None:
    import msgspec

    sys.stdout.write(msgspec.json.encode(found).decode() + "\n")
