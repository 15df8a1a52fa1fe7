"""`agribot gnss`: what a receiver reports, and a u-blox receiver set up for driving."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import deque
from typing import Any

import msgspec

from agribot.cli.ranges import check_within, finite
from agribot.cli.standard_error import print_line
from agribot.core import extras
from agribot.core.errors import ConfigError
from agribot.core.fact_text import render
from agribot.core.geo import compass_deg_from_yaw
from agribot.core.messages import GnssFix, GnssHeading, GnssStatus

PERIOD_S = 1.0  # period of a line
POLL_S = 0.05
SILENT_S = 3.0  # a fix of a second that is older is not current
PATIENCE_S = 10.0  # time for the answers to all settings
RATES_HZ = 1.0, 20.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    show = actions.add_parser(
        "show", help="a line a second: state, accuracy, satellites, heading, corrections",
        description="Show what a receiver reports, a line a second.",
        epilog="example: agribot gnss show serial:/dev/ttyACM0?ntrip=ntrip://HOST:2101/MOUNT",
    )  # fmt: skip
    show.add_argument("uri", metavar="URI", help="as of --source gnss=URI")
    show.add_argument("--for", dest="seconds", type=finite, default=math.inf, metavar="SECONDS")
    setup = actions.add_parser(
        "configure", help="set up a u-blox receiver (M8, M9, F9, X20) for driving",
        description="Set up a u-blox receiver: rate, dynamic model, and the messages that are "
        "read. Other receivers are set up by their makers' programs.",
        epilog="example: agribot gnss configure serial:/dev/ttyACM0 --rate 10 --save",
    )  # fmt: skip
    setup.add_argument("uri", metavar="URI", help="serial:/dev/ttyACM0 or tcp://HOST:PORT")
    setup.add_argument("--rate", type=finite, default=10.0, metavar="HZ", help="default: 10")
    setup.add_argument("--model", default="automotive", help="of motion; default: automotive")
    setup.add_argument("--save", action="store_true", help="also after it is switched off")
    for made in (show, setup):
        made.add_argument("--json", action="store_true", help="the result as the last line")


def run(options: argparse.Namespace) -> int:
    """Show a receiver, or set it up.

    Raises: ConfigError: a line that cannot be opened, or a wrong option.
    """
    return _show(options) if options.action == "show" else _configure(options)


def _show(options: argparse.Namespace) -> int:
    from agribot.core.platform import SourceOfMore
    from agribot.description.loader import load_robot
    from agribot.drivers.line.schemes import (
        RosNetwork,
        SourceContext,
        open_source,
        read_uri,
        require_extras,
    )

    uri = read_uri("agribot gnss show", options.uri, "")
    require_extras({"gnss": uri})
    summary = ReceiverSummary()
    network = RosNetwork(lambda: 0, str, str)
    with SourceContext(load_robot(), network, print_line) as context:
        source = open_source("gnss", uri, context)
        try:
            begun_s = next_s = time.monotonic()
            while (now_s := time.monotonic()) - begun_s < options.seconds:
                t_s = now_s - begun_s
                more = source.take_more(t_s) if isinstance(source, SourceOfMore) else {}
                summary.add(t_s, source.take(t_s), more)
                if now_s >= next_s:
                    next_s += PERIOD_S
                    print_line(summary.describe())
                time.sleep(POLL_S)
        except KeyboardInterrupt:
            pass
        finally:
            source.close()
    print_line(summary.describe())
    if options.json:
        sys.stdout.write(msgspec.json.encode(summary.as_result()).decode() + "\n")
    return 0 if summary.has_position else 1


class ReceiverSummary:
    """The newest of everything, and how often fixes come."""

    def __init__(self) -> None:
        self.fix: GnssFix | None = None
        self.heading: GnssHeading | None = None
        self.status: GnssStatus | None = None
        self._times_s: deque[float] = deque(maxlen=20)
        self._t_s = 0.0

    @property
    def has_position(self) -> bool:
        """Whether satellites were measured."""
        return self.fix is not None and not self.fix.unmeasured

    def add(self, t_s: float, fixes: tuple[Any, ...], more: dict[str, tuple[Any, ...]]) -> None:
        self._t_s = t_s
        for fix in fixes:
            self.fix = fix
            self._times_s.append(fix.t_s)
        for heading in more.get("headings", ()):
            self.heading = heading
        for status in more.get("gnss_status", ()):
            self.status = status
        for note in more.get("notes", ()):
            print_line(render(note.fact))

    def describe(self) -> str:
        from agribot.drivers.probe.receiver_speaker import name_fix

        trouble = self.status.trouble if self.status is not None else ""
        words = [trouble or "no fix yet"]
        if self.fix is not None and (old_s := self._t_s - self.fix.t_s) > SILENT_S:
            words = [f"no fix for {old_s:.0f} s"]
        elif self.fix is not None:
            words = [
                f"{self.fix.lat_deg:.8f}, {self.fix.lon_deg:.8f}, {_describe_altitude(self.fix)}",
                f"{name_fix(self.fix)} +-{self.fix.pos_std_m:.3f} m",
                f"{self._find_rate_hz():.1f} Hz",
                *([trouble] if trouble else []),
            ]
        if self.status is not None:
            seen = self.status.satellites
            words += [f"{sum(each.is_used for each in seen)} of {len(seen)} satellites"]
            words += [f"HDOP {self.status.hdop:.1f}"] if self.status.hdop else []
            age_s = self.status.correction_age_s
            counts = ", ".join(f"{kind}: {n}" for kind, n in self.status.correction_counts)
            of_what = f" ({counts})" if counts else ""
            words += [] if age_s is None else [f"corrections {age_s:.0f} s old{of_what}"]
            words += _describe_use(self.status)
            unread = ", ".join(self.status.unread)
            words += [f"not read: {unread}"] if unread else []
        if self.heading is not None:
            words.append(f"heading {compass_deg_from_yaw(self.heading.yaw_map_rad):.1f} deg")
        return ", ".join(words)

    def as_result(self) -> dict[str, Any]:
        return {
            "fix": self.fix,
            "heading": self.heading,
            "status": self.status,
            "rate_hz": round(self._find_rate_hz(), 2),
        }

    def _find_rate_hz(self) -> float:
        times_s = self._times_s
        passed_s = times_s[-1] - times_s[0] if len(times_s) > 1 else 0.0
        return (len(times_s) - 1) / passed_s if passed_s > 0.0 else 0.0


def _describe_altitude(fix: GnssFix) -> str:
    return f"{fix.alt_m:.2f} m" if math.isfinite(fix.alt_m) else "no altitude"


def _describe_use(status: GnssStatus) -> list[str]:
    used, unused = status.corrections_used, status.corrections_unused
    if used is None or unused is None:
        return []
    return [f"{used} of {used + unused} corrections used by the receiver"]


def _configure(options: argparse.Namespace) -> int:
    from agribot.core.suggestions import suggest_name
    from agribot.drivers.gnss.ubx_setup import DYNAMIC_MODELS, ReceiverSetup, SetupPlan
    from agribot.drivers.line.schemes import read_uri
    from agribot.drivers.stream_sources import open_receiver_line

    check_within("--rate", options.rate, *RATES_HZ, "Hz")
    if options.model not in DYNAMIC_MODELS:
        raise ConfigError(
            f"--model {options.model}: unknown; give one of {', '.join(DYNAMIC_MODELS)}"
            f"{suggest_name(options.model, DYNAMIC_MODELS)}"
        )
    uri = read_uri("agribot gnss configure", options.uri, "")
    if uri.scheme == "serial":
        extras.require("hardware", f"agribot gnss configure {options.uri}")
    setup = ReceiverSetup(SetupPlan(options.rate, options.model, options.save))
    _talk(setup, open_receiver_line(uri))
    version = setup.version
    if version is None or not setup.is_done:
        raise ConfigError(
            f"{uri.name}: no u-blox receiver answers there; check baud (?baud=9600 of an M8 on its "
            "UART), and that it takes UBX"
        )
    print_line(
        f"{version.model} (protocol {version.protocol:g}): {setup.accepted} settings taken, "
        f"{len(setup.refused)} refused as not there"
    )
    if options.json:
        result = {
            "model": version.model, "protocol": version.protocol, "accepted": setup.accepted,
            "refused": len(setup.refused),
        }  # fmt: skip
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
    return 0 if setup.accepted else 1


def _talk(setup: Any, stream: Any) -> None:
    """Send and hear until all is answered, or nothing comes any more."""
    from agribot.drivers.gnss.ubx import UbxDecoder

    frames, heard_s = UbxDecoder(), time.monotonic()
    try:
        stream.write(setup.ask)
        while not setup.is_done and time.monotonic() - heard_s < PATIENCE_S:
            for frame in frames.feed(stream.read()):
                answer = setup.add(frame)
                if answer:
                    heard_s = time.monotonic()
                    stream.write(answer)
    except OSError as error:
        raise ConfigError(f"the line broke: {error.strerror or error}; try again") from error
    finally:
        stream.close()
