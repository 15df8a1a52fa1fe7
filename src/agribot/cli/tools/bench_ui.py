"""`agribot bench ui`: what the operator's page costs with no, one and many viewers."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from agribot.cli.ranges import check_within, finite
from agribot.core.errors import ConfigError

SLOWEST_MBIT_PER_S, FASTEST_MBIT_PER_S = 0.5, 100.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--clients", default="0,1,16", metavar="N,N", help="default: 0,1,16")
    parser.add_argument(
        "--seconds", type=finite, default=20.0, metavar="S", help="for each of them"
    )
    parser.add_argument(
        "--growth", type=finite, default=0.0, metavar="S",
        help="then measure for S seconds how much memory grows; 300 is what the limits are for",
    )  # fmt: skip
    parser.add_argument(
        "--links", default="10,1", metavar="MBIT,MBIT",
        help="then see the camera over lines of these speeds, Mbit/s; none: leave them out",
    )  # fmt: skip
    parser.add_argument("--no-camera", action="store_true", help="states alone")


def run(options: argparse.Namespace) -> int:
    from agribot.lab.bench.ui import measure_page as measure

    try:
        clients = [int(word) for word in options.clients.split(",")]
    except ValueError as error:
        raise ConfigError(
            f"--clients {options.clients}: not numbers; write them as in 0,1,16"
        ) from error
    if not clients or min(clients) < 0 or max(clients) > 32:
        raise ConfigError(f"--clients {options.clients}: out of range; give 0 to 32 each")
    check_within("--seconds", options.seconds, 1.0, 600.0)
    check_within("--growth", options.growth, 0.0, 420.0, "s")
    result = measure(
        clients, options.seconds, not options.no_camera, growth_s=options.growth,
        links_mbit_per_s=_read_links(options),
    )  # fmt: skip
    sys.stderr.writelines(_format_phase(phase) for phase in result["phases"])
    sys.stderr.writelines(_format_delay(link) for link in result["links"])
    sys.stderr.writelines(_format_limit(limit) for limit in result["limits"])
    sys.stderr.write(f"load average of the machine at the end: {result['load_average']:.1f}\n")
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    return 0 if result["ok"] else 1


def _read_links(options: argparse.Namespace) -> list[float]:
    if options.no_camera or options.links == "none":
        return []
    try:
        links = [float(word) for word in options.links.split(",")]
    except ValueError as error:
        raise ConfigError(f"--links {options.links}: not numbers; write them as in 10,1") from error
    for link in links:
        check_within("--links", link, SLOWEST_MBIT_PER_S, FASTEST_MBIT_PER_S, "Mbit/s")
    return links


def _format_delay(link: dict[str, Any]) -> str:
    return (
        f"{link['mbit_per_s']:g} Mbit/s: state {link['state_hz']:.1f} Hz, "
        f"{link['state_age_p95_s'] * 1e3:.0f} ms old, camera {link['camera_hz']:.1f} Hz, "
        f"{link['camera_age_p95_s'] * 1e3:.0f} ms old (p95)\n"
    )


def _format_limit(limit: dict[str, Any]) -> str:
    value = "not measured" if limit["value"] is None else f"{limit['value']:g}"
    ends = [f"{word} {limit[key]:g}" for key, word in (("low", "at least"), ("high", "at most"))
            if limit[key] is not None]  # fmt: skip
    verdict = "ok" if limit["ok"] else "TOO FAR"
    return f"{limit['name']}: {value} ({' and '.join(ends)}) {verdict}\n"


def _format_phase(phase: dict[str, Any]) -> str:
    stalled = f" ({phase['stalled']} stalled)" if phase["stalled"] else ""
    seen = "" if phase["state_hz"] is None else f", state {phase['state_hz']:.1f} Hz"
    seen += "" if phase["camera_hz"] is None else f", camera {phase['camera_hz']:.1f} Hz"
    cpu, memory = f"{phase['server_cpu_ratio']:.1%}", f"{phase['server_rss_bytes'] / 1e6:.0f} MB"
    missed = f"{phase['ticks_missed']}/{phase['ticks']}"
    late_ms = phase["lateness_p99_s"] * 1e3
    return (
        f"{phase['clients']:2d} clients{stalled}: server {cpu} of a core, {memory}{seen}, "
        f"ticks missed {missed}, late p99 {late_ms:.1f} ms\n"
    )
