"""`agribot board`: what a board of ours is and how it is, and its program written into it."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from agribot.cli.ranges import number
from agribot.cli.standard_error import print_line
from agribot.core import extras
from agribot.core.errors import ConfigError

if TYPE_CHECKING:
    from agribot.drivers.line.schemes import SourceUri
    from agribot.drivers.probe.board_probe import BoardProbe, FoundBoard

PERIOD_S = 1.0  # period of a line
KINDS = ("motor", "imu")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    show = actions.add_parser(
        "show", help="which board is there, its firmware, what stops it, battery",
        description="Hear a line and ask the board of ours that speaks there; without a URI, every "
        "serial line that is free, until one answers. Opening a line resets its board.",
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
        "--for", dest="seconds", type=number(0.0), default=0.0, metavar="SECONDS",
        help="go on with a line a second",
    )  # fmt: skip
    for made, count in ((show, "?"), (flash, None)):
        made.add_argument(
            "uri", nargs=count, metavar="URI", help="serial:/dev/ttyACM0, or with ?baud="
        )
        made.add_argument("--json", action="store_true", help="the result as the last line")


def run(options: argparse.Namespace) -> int:
    """Show a board, or flash it.

    Raises: ConfigError: a line that cannot be opened, or no board of ours at it.
    """
    from agribot.drivers.board.board_protocol import BoardKind
    from agribot.drivers.line.schemes import read_uri

    if options.uri is None:
        return _show_first(options)
    uri = read_uri(f"agribot board {options.action}", options.uri, "")
    if uri.scheme == "serial":
        extras.require("hardware", f"agribot board {options.action} {options.uri}")
    wanted = None
    if options.action == "flash":
        from agribot.drivers.board.board_programs import flash

        if uri.scheme != "serial":
            raise ConfigError(
                f"{options.uri}: not a serial line; give that of the board, serial:/dev/..."
            )
        wanted = BoardKind[options.kind.upper()]
        flash(wanted, uri.path)
    found, is_heard = _find(uri, wanted, getattr(options, "seconds", 0.0))
    if options.json:
        _print_json(found)
    return 0 if found.is_understood and is_heard else 1


def _show_first(options: argparse.Namespace) -> int:
    """Show the first board of ours at a serial line that no program has open.

    Raises: ConfigError: no line is free, or no board of ours is at one.
    """
    from agribot.drivers.line.line_holders import find_holders
    from agribot.drivers.probe.found_devices import find_serial_lines

    lines = [each for each in find_serial_lines(Path("/")) if not each.is_receiver]
    free = [each for each in lines if each.is_usable and not find_holders(each.node)]
    reasons: list[str] = []
    for line in free:
        options.uri = f"serial:{line.path}"
        try:
            return run(options)
        except ConfigError as error:
            reasons.append(str(error))
    if reasons:
        raise ConfigError("; ".join(reasons))
    raise ConfigError(
        f"none of {len(lines)} serial lines is free; connect the board's USB "
        "cable, end the program that has its line, or name the line: serial:/dev/ttyACM0"
    )


def _find(uri: SourceUri, wanted: object, seconds: float) -> tuple[FoundBoard, bool]:
    """Ask at the speed of each board, or at that of the URI, and print what is there.

    Gives the board, and whether it was still heard at the end.

    Raises: ConfigError: the line breaks, or no board of ours is at it.
    """
    from agribot.drivers.probe.board_probe import BAUDS, BoardProbe
    from agribot.drivers.stream_sources import open_receiver_line

    bauds = [baud for kind, baud in BAUDS.items() if wanted in (None, kind)]
    has_speed = uri.scheme != "serial" or bool(dict(uri.options).get("baud"))
    lines = [uri] if has_speed else [uri._replace(options=(("baud", str(b)),)) for b in bauds]
    came = 0
    for line in lines:
        stream = open_receiver_line(line)
        try:
            probe = BoardProbe(stream, time.monotonic)
            found = probe.ask()
            if found is not None:
                return _print_on(probe, found, seconds)
            came = max(came, probe.bytes)
        except OSError as error:
            raise ConfigError(
                f"{uri.name}: the line broke: {error.strerror or error}; check cable and power"
            ) from error
        finally:
            stream.close()
    heard = f"{came} bytes came, which are no words of one" if came else "the line is silent"
    raise ConfigError(
        f"{uri.name}: no board of ours speaks there: {heard}; write its program into it (agribot "
        "board flash), and check its power, its cable, and that the other program that may use "
        "the line has ended"
    )


def _print_on(probe: BoardProbe, found: FoundBoard, seconds: float) -> tuple[FoundBoard, bool]:
    """Print a board, and go on with a line a second; gives the last of it.

    What was said before is not said again as if it were of now.
    """
    from agribot.drivers.probe.board_probe import describe_board

    print_line(describe_board(found))
    heard_s = began_s = time.monotonic()
    is_heard = True
    try:
        while time.monotonic() < began_s + seconds:
            now = probe.listen(PERIOD_S)
            is_heard = now is not None
            if now is not None:
                found, heard_s = now, time.monotonic()
                print_line(describe_board(found))
            else:
                silent_s = time.monotonic() - heard_s
                print_line(
                    f"nothing from the board for {silent_s:.0f} s; check its power and cable"
                )
    except KeyboardInterrupt:
        pass
    return found, is_heard


def _print_json(found: FoundBoard) -> None:
    import msgspec

    sys.stdout.write(msgspec.json.encode(found).decode() + "\n")
