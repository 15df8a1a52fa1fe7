"""The origin of a run's map on Earth, as the original's initialize_origin had it: `--origin`.

It is fixed before anything else is opened and is `field.datum` from then on, so that rows,
waypoints, maps and the recording lie in one map from the first tick to the last. A real robot
whose settings state none takes its first good fix and keeps it, so that its map stays where it is.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from contextlib import closing
from pathlib import Path

import msgspec
import tomli_w

from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError, PlatformError, explain_os_error
from agribot.core.geo import Datum, is_place, make_datum
from agribot.core.home import find_home
from agribot.core.messages import GnssFix, GnssQuality
from agribot.core.platforms import find_platform
from agribot.core.suggestions import suggest_name
from agribot.core.toml_tree import check_finite, read_toml
from agribot.core.whole_file import write_at_once
from agribot.drivers.line.schemes import open_source, read_uri

FILE_NAME = "origins.toml"
FIRST_FIX_FILE_NAME = "first-fix.toml"  # the origin of a real robot that was given none
PATIENCE_S = 60.0  # time for the first good fix; a cold receiver needs half of that
# Time for the first good fix if the command asked for none; the robot may stand in its workshop.
UNASKED_PATIENCE_S = 10.0
PERIOD_S = 0.05
FIRST_FIX = "first fix"
GOOD_STD_M = 10.0  # 1 sigma of a fix that may be the origin
HELP = (
    "of the map: a name in ~/.agribot/origins.toml, LAT,LON[,ALT], the first good fix of a "
    "topic (ros2:/fix), or auto: that of the receiver from --source, else the world's own place; "
    "a real robot whose settings state none keeps its first good fix in ~/.agribot/first-fix.toml"
)


class NamedOrigin(Datum, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A line of the original's list; its map may be turned, ours is East and North."""

    heading_deg: float = 0.0


def apply_origin(config: RunConfig, options: argparse.Namespace, *, is_stated: bool) -> RunConfig:
    """Return the settings with the requested origin; `is_stated` where they have one themselves.

    Raises: ConfigError: no such origin. PlatformError: no good fix came.
    """
    wanted: str | None = options.origin
    is_real = find_platform(config.platform).needs_arming
    if wanted is not None:
        datum, source = _find_datum(wanted, config, options)
        if is_real and source.startswith(FIRST_FIX):
            _keep_first_fix(datum)
        return _move(config, datum, source)
    if not is_real:
        return _move_to_world(config)
    return config if is_stated else _move_to_first_fix(config, options)


def _move(config: RunConfig, datum: Datum, source: str, remark: str = "") -> RunConfig:
    field = msgspec.structs.replace(config.field, datum=datum, datum_source=source)
    place = f"{datum.lat_deg:.7f}, {datum.lon_deg:.7f}, {datum.alt_m:.2f} m"
    sys.stderr.write(f"origin of the map: {place} ({source}{remark})\n")
    return msgspec.structs.replace(config, field=field)


def _move_to_world(config: RunConfig) -> RunConfig:
    """Put the map of a simulated run where its world is, if that is far away."""
    from agribot.app.run_world import settle_origin

    field = settle_origin(config).field
    if field.datum_source == config.field.datum_source:
        return config
    return _move(config, field.datum, field.datum_source)


def _move_to_first_fix(config: RunConfig, options: argparse.Namespace) -> RunConfig:
    """Put the map where the robot had its first good fix, now or in an earlier run."""
    path, uri = find_home() / FIRST_FIX_FILE_NAME, config.sources.gnss
    if path.is_file():
        kept = _parse_origin(FIRST_FIX, read_toml(path), path)
        return _move(config, kept, f"{FIRST_FIX}, from {path}", "; --origin auto takes a new one")
    if not uri:
        return config
    try:
        datum = _wait_for_fix(uri, options, UNASKED_PATIENCE_S)
    except PlatformError as error:
        sys.stderr.write(f"{error}; until then the robot knows no place\n")
        return config
    _keep_first_fix(datum)
    return _move(config, datum, f"{FIRST_FIX} of {uri}", f", kept in {path}")


def _keep_first_fix(datum: Datum) -> None:
    """Keep it for the next runs. Raises: ConfigError: it cannot be written."""
    path = find_home() / FIRST_FIX_FILE_NAME
    with explain_os_error(
        f"the origin of the map cannot be kept in {path}",
        "make room, point AGRIBOT_HOME at a folder that you may write, or give --origin LAT,LON",
        ConfigError,
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_at_once(path, tomli_w.dumps(msgspec.to_builtins(datum)).encode(), is_synced=True)


def _find_datum(wanted: str, config: RunConfig, options: argparse.Namespace) -> tuple[Datum, str]:
    if wanted == "auto" and not config.sources.gnss:
        if find_platform(config.platform).needs_arming:
            raise ConfigError(
                "--origin auto: this robot has no receiver; name one with --source gnss=..., or "
                "give the place as LAT,LON"
            )
        from agribot.description.worlds_sdf import load_world

        return load_world(config.world).datum, f"the place of world {config.world}"
    uri = config.sources.gnss if wanted == "auto" else wanted
    if ":" in uri:
        return _wait_for_fix(uri, options, PATIENCE_S), f"{FIRST_FIX} of {uri}"
    if "," in wanted:
        return _parse_place(wanted), "as given"
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
            f"--origin {text}: not a place; give LAT,LON or LAT,LON,ALT, as in 48.1,11.5"
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


def _wait_for_fix(uri: str, options: argparse.Namespace, patience_s: float) -> Datum:
    """Wait for the first good fix of a receiver or a base station, over any of the networks.

    The receiver is closed again: the run opens it anew.
    """
    from agribot.cli.run.bridging import print_line
    from agribot.cli.run.sensor_sources import source_context
    from agribot.description.loader import load_robot

    place, start_s = read_uri("--origin", uri), time.monotonic()
    sys.stderr.write(f"waiting for the first good fix of {uri}\n")
    with (
        source_context(load_robot(), options, print_line) as context,
        closing(open_source("gnss", place, context)) as source,
    ):
        flat: Datum | None = None
        while time.monotonic() - start_s < patience_s:
            for fix in source.take(time.monotonic() - start_s):
                if not _is_good(fix):
                    continue
                datum = make_datum(fix.lat_deg, fix.lon_deg, fix.alt_m)
                if math.isfinite(fix.alt_m) or flat is not None:
                    return datum
                flat = datum  # another one may have an altitude
            time.sleep(PERIOD_S)
    raise PlatformError(
        f"--origin: no good fix (1 sigma within {GOOD_STD_M:g} m) of {uri} within "
        f"{patience_s:g} s; check topic, receiver and sky view and start again, or give the place "
        "as LAT,LON"
    )


def _is_good(fix: GnssFix) -> bool:
    is_known = fix.quality is not GnssQuality.NONE and is_place(fix.lat_deg, fix.lon_deg)
    return is_known and fix.pos_std_m <= GOOD_STD_M
