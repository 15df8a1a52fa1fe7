"""`agribot map`: maps for the page's background, kept on this machine."""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from typing import Any

from agribot.errors import ConfigError
from agribot.ui.address import home
from agribot.ui.tiles import described_map, import_mbtiles, map_files

_NAME = re.compile(r"^[^\W_][\w.-]{0,62}$")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print the result as the last line")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    take = actions.add_parser("import", help="take in an MBTiles file")
    take.add_argument("file", type=Path, help="MBTiles with raster tiles")
    take.add_argument("--name", help="default: the file's")
    actions.add_parser("list", help="say which maps there are")


def run(options: argparse.Namespace) -> int:
    folder = home() / "maps"
    if options.action == "import":
        maps = [_import(options, folder)]
    else:
        maps = [described_map(path) for path in map_files(folder).values()]
    if options.json:
        sys.stdout.write(json.dumps(maps) + "\n")
    else:
        sys.stdout.writelines(_line(one) for one in maps)
        sys.stdout.write("" if maps else f"no maps in {folder}\n")
    return 0


def _import(options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    if options.file.suffix.lower() != ".mbtiles":
        raise ConfigError(
            f"{options.file.name}: only .mbtiles can be imported; make one of a GeoTIFF with "
            "'gdal_translate -of MBTILES in.tif out.mbtiles && gdaladdo out.mbtiles 2 4 8 16'"
        )
    name = options.name or options.file.stem
    if not _NAME.fullmatch(name):
        raise ConfigError(f"--name {name}: use letters, digits and . _ -, at most 63")
    return import_mbtiles(options.file, folder, name)


def _line(one: dict[str, Any]) -> str:
    zooms = f"zoom {one['minzoom']} to {one['maxzoom']}"
    return f"{one['name']}: {one['tiles']} tiles, {zooms}, {one['attribution'] or 'no source'}\n"
