"""`agribot map`: maps for the page's background, kept on this machine."""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from typing import Any

from agribot.core.errors import ConfigError
from agribot.core.home import find_home
from agribot.core.whole_file import make_at_once
from agribot.gis.mbtiles import describe_map, find_maps, import_mbtiles
from agribot.gis.tile_grid import parse_bounds

_NAME = re.compile(r"^[^\W_][\w.-]{0,62}$")
_RASTERS = (".tif", ".tiff", ".vrt", ".jp2", ".img")
DEFAULT_ZOOMS = "0-19"
SHOWN_EVERY = 500  # tiles


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print the result as the last line")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    take = actions.add_parser(
        "import",
        help="take in a GeoTIFF, MBTiles, PMTiles or .geo file, or a region of a tile server",
        description="Take in a GeoTIFF, MBTiles, PMTiles or mapviz .geo file, or tiles of a "
        "server. Mind what the server's owner allows: many forbid to fetch whole regions.",
        epilog="examples: agribot map import ortho.tif; agribot map import "
        "'https://tiles.example/{z}/{x}/{y}.png' --name aerial --bbox 72.78,21.16,72.79,21.17 "
        "--zoom 15-20",
    )
    take.add_argument("source", metavar="FILE|URL", help="a URL has {z}, {x} and {y} in it")
    take.add_argument("--name", help="default: the file's; a URL needs one")
    take.add_argument("--bbox", metavar="W,S,E,N", help="region of a URL, degrees")
    take.add_argument("--zoom", default=DEFAULT_ZOOMS, metavar="A-B", help="of a URL")
    take.add_argument("--attribution", default="", help="of a URL: whose map it is, as it is shown")
    take.add_argument(
        "--live",
        action="store_true",
        help="of a URL: fetch tiles when somebody looks at them, and keep them",
    )
    actions.add_parser("list", help="say which maps there are", epilog="example: agribot map list")
    gone = actions.add_parser(
        "remove",
        help="delete a map with all its tiles",
        epilog="example: agribot map remove farm",
    )
    gone.add_argument("name")


def run(options: argparse.Namespace) -> int:
    folder = find_home() / "maps"
    troubles: list[str] = []
    if options.action == "import":
        maps = [_import(options, folder, troubles)]
    elif options.action == "remove":
        maps = _remove(options.name, folder)
    else:
        maps = _describe_all(folder, troubles)
    if options.json:
        sys.stdout.write(json.dumps(maps) + "\n")
    else:
        sys.stdout.writelines(_format_map(one) for one in maps)
        sys.stdout.write("" if maps or troubles else f"no maps in {folder}\n")
    sys.stderr.writelines(f"agribot map: {trouble}\n" for trouble in troubles)
    return 1 if troubles else 0


def _describe_all(folder: Path, troubles: list[str]) -> list[dict[str, Any]]:
    """Describe the maps; `troubles` says why a file is not one."""
    found = []
    for name, path in find_maps(folder).items():
        try:
            found.append(describe_map(path))
        except ConfigError as error:
            troubles.append(f"{error}; import it again, or: agribot map remove {name}")
    return found


def _import(options: argparse.Namespace, folder: Path, troubles: list[str]) -> dict[str, Any]:
    from agribot.gis import map_import, raster_import

    is_url = "://" in options.source
    name = options.name or ("" if is_url else Path(options.source).stem)
    if not _NAME.fullmatch(name):
        raise ConfigError(f"--name '{name}': not a name; use letters, digits and . _ -, at most 63")
    target = folder / f"{name}.mbtiles"
    if is_url:
        troubles += _import_from_server(options, target)
        return describe_map(target)
    source = Path(options.source)
    suffix = source.suffix.lower()
    if not source.is_file():
        raise ConfigError(f"map file {source} does not exist; check the path")
    if suffix == ".mbtiles":
        return import_mbtiles(source, folder, name)
    if suffix == ".pmtiles":
        return _convert(source, target, map_import.import_pmtiles)
    if suffix == ".geo":
        return _convert(source, target, raster_import.import_geo)
    if suffix in _RASTERS:
        return _convert(source, target, raster_import.import_geotiff)
    raise ConfigError(
        f"{source.name}: unknown format; give .mbtiles, .pmtiles, .geo, {', '.join(_RASTERS)} or "
        "a URL with {z}, {x} and {y}"
    )


def _convert(source: Path, target: Path, convert: Any) -> dict[str, Any]:
    """Convert a map file; a new one takes the place of an old one only when it is whole."""

    def make(beside: Path) -> None:
        for note in convert(source, beside, _show_progress):
            sys.stderr.write(f"note: {note}\n")
        describe_map(beside)

    make_at_once(target, make)
    return describe_map(target)


def _import_from_server(options: argparse.Namespace, target: Path) -> list[str]:
    """Fetch the tiles of a server, or note where to fetch them; gives what failed."""
    from agribot.gis import map_import

    zooms = _parse_zooms(options.zoom)
    if options.live:
        map_import.register_server(options.source, target, zooms, options.attribution)
        return []
    if options.bbox is None:
        raise ConfigError("a URL needs a region to fetch; give --bbox W,S,E,N, or --live")
    bounds = parse_bounds(options.bbox)
    missing = map_import.import_from_server(
        options.source, target, bounds, zooms, options.attribution, _show_progress
    )
    if missing.absent:
        sys.stderr.write(f"the server has no tile at {missing.absent} places\n")
    if not missing.failed:
        return []
    return [f"{missing.failed} tiles did not come: {missing.why}; the same command fetches them"]


def _parse_zooms(text: str) -> tuple[int, int]:
    try:
        first, _, last = text.partition("-")
        return int(first), int(last or first)
    except ValueError as error:
        raise ConfigError(f"--zoom {text}: not two numbers; write them as in 15-20") from error


def _remove(name: str, folder: Path) -> list[dict[str, Any]]:
    """Delete a map, also a broken one; returns what it was, as far as that can be read."""
    path = find_maps(folder).get(name)
    if path is None:
        raise ConfigError(f"there is no map '{name}'; see agribot map list")
    try:
        known = [describe_map(path)]
    except ConfigError:
        known = []
    path.unlink()
    return known


def _show_progress(done: int, count: int) -> None:
    if done % SHOWN_EVERY == 0 or done == count:
        sys.stderr.write(f"{done} of {count} tiles\n")


def _format_map(one: dict[str, Any]) -> str:
    zooms = f"zoom {one['minzoom']} to {one['maxzoom']}"
    live = ", more are fetched when they are looked at" if one["live"] else ""
    source = one["attribution"] or "no source"
    return f"{one['name']}: {one['tiles']} tiles, {zooms}, {source}{live}\n"
