"""The origin of a run's map on Earth, as the original's initialize_origin had it: `--origin`.

It is fixed before anything else is opened and is `field.datum` from then on, so that rows,
waypoints, maps and the recording lie in one map from the first tick to the last.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import msgspec

from agribot.core.config import RunConfig, check_finite, read_toml
from agribot.core.errors import ConfigError, PlatformError
from agribot.core.geo import Datum
from agribot.core.home import find_home
from agribot.core.suggestions import suggest_name
from agribot.drivers.schemes import open_source, read_uri

FILE_NAME = "origins.toml"
PATIENCE_S = 60.0  # for the first valid fix; a cold receiver needs half of that
PERIOD_S = 0.05
HELP = (
    "of the map: a name in ~/.agribot/origins.toml, LAT,LON[,ALT], the first valid fix of a "
    "topic (ros2:/fix), or auto: that of the receiver from --source, else the world's own place"
)


class NamedOrigin(Datum, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A line of the original's list; its map may be turned, ours is East and North."""

    heading_deg: float = 0.0


def apply_origin(config: RunConfig, options: argparse.Namespace) -> RunConfig:
    """Return the settings with the requested origin, if any.

    Raises: ConfigError: no such origin. PlatformError: no valid fix came.
    """
    wanted: str | None = options.origin
    if wanted is None:
        return config
    datum, source = _find_datum(wanted, config, options)
    field = msgspec.structs.replace(config.field, datum=datum, datum_source=source)
    place = f"{datum.lat_deg:.7f}, {datum.lon_deg:.7f}, {datum.alt_m:.2f} m"
    sys.stderr.write(f"origin of the map: {place} ({source})\n")
    return msgspec.structs.replace(config, field=field)


def _find_datum(wanted: str, config: RunConfig, options: argparse.Namespace) -> tuple[Datum, str]:
    if wanted == "auto" and not config.sources.gnss:
        from agribot.description.worlds_sdf import load_world

        return load_world(config.world).datum, f"the place of world {config.world}"
    uri = config.sources.gnss if wanted == "auto" else wanted
    if ":" in uri:
        return _wait_for_fix(uri, options), f"first fix of {uri}"
    if "," in wanted:
        return _parse_place(wanted), "as told"
    return _find_named(wanted), wanted


def _parse_place(text: str) -> Datum:
    try:
        numbers = [float(number) for number in text.split(",")]
        names = ("lat_deg", "lon_deg", "alt_m")[: len(numbers)]
        tree = dict(zip(names, numbers, strict=True))
        check_finite(tree, f"--origin {text}", "")
        return msgspec.convert(tree, Datum)
    except (ValueError, msgspec.ValidationError) as error:
        raise ConfigError(
            f"--origin {text}: write LAT,LON or LAT,LON,ALT in degrees and m, as in 48.1,11.5"
        ) from error


def _find_named(name: str) -> Datum:
    path = find_home() / FILE_NAME
    known = read_origins(path)
    if name not in known:
        have = f"known: {', '.join(sorted(known))}" if known else f"{path} is not there"
        raise ConfigError(f"--origin {name}: no such origin{suggest_name(name, [*known])}; {have}")
    return known[name]


def read_origins(path: Path) -> dict[str, Datum]:
    """Read the list of origins by name; empty where there is no such file.

    Raises: ConfigError: what is written there is no list of origins.
    """
    if not path.is_file():
        return {}
    tree = read_toml(path)
    check_finite(tree, str(path), "")
    return {name: _parse_origin(name, entry, path) for name, entry in tree.items()}


def _parse_origin(name: str, entry: object, path: Path) -> Datum:
    try:
        named = msgspec.convert(entry, NamedOrigin)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: {name}: {error}; write lat_deg, lon_deg and alt_m") from error
    if named.heading_deg != 0.0:
        raise ConfigError(
            f"{path}: {name}.heading_deg = {named.heading_deg:g}: must be 0; the map's axes are "
            "East and North, turn the rows with field.row_yaw_deg"
        )
    return Datum(lat_deg=named.lat_deg, lon_deg=named.lon_deg, alt_m=named.alt_m)


def _wait_for_fix(uri: str, options: argparse.Namespace) -> Datum:
    """Wait for the first fix of a receiver or a base station, over any of the networks."""
    from agribot.cli.bridging import print_line
    from agribot.cli.sensor_sources import source_context
    from agribot.core.messages import GnssFix
    from agribot.description.loader import load_robot

    place, start_s = read_uri("--origin", uri), time.monotonic()
    sys.stderr.write(f"waiting for the first valid fix of {uri}\n")
    with source_context(load_robot(), options, print_line) as context:
        source = open_source("gnss", place, context)
        while time.monotonic() - start_s < PATIENCE_S:
            for fix in source.take(time.monotonic() - start_s):
                assert isinstance(fix, GnssFix)
                return Datum(lat_deg=fix.lat_deg, lon_deg=fix.lon_deg, alt_m=fix.alt_m)
            time.sleep(PERIOD_S)
    raise PlatformError(
        f"--origin: no valid fix of {uri} within {PATIENCE_S:g} s; check topic and receiver, or "
        "give the place as LAT,LON"
    )
