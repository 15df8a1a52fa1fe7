"""`agribot weeds`: weed maps of runs and robots, in and out of the files of farm software."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agribot.core.errors import ConfigError

if TYPE_CHECKING:
    from agribot.autonomy.weeds.plant_table import PlantTable

# What --format says -> how the file's name ends.
SUFFIXES = {
    "geojson": ".geojson", "gpkg": ".gpkg", "shp": ".shp", "kml": ".kml", "csv": ".csv",
}  # fmt: skip
_SOURCE = "folder of a run, run.mcap, or a weed map: .geojson, .gpkg, .shp, .shp.zip, .kml, .csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    export = actions.add_parser(
        "export",
        help="write a weed map for QGIS, farm software or a spreadsheet",
        epilog="example: agribot weeds export runs/first -o weeds.gpkg",
    )
    export.add_argument("source", metavar="RUN|MAP", help=_SOURCE)
    _add_output(export)
    take = actions.add_parser(
        "import",
        help="check a weed map from elsewhere and take it in",
        epilog="example: agribot weeds import a.shp --classes 1=weed,2=crop -o a.geojson",
    )
    take.add_argument("source", type=Path, metavar="MAP", help=_SOURCE)
    take.add_argument("--classes", metavar="VALUE=weed|crop,…", help="what its classes mean")
    take.add_argument("--field", type=Path, metavar="FIELD", help="refuse plants outside of it")
    take.add_argument("--name", help="of the map; default: the file's")
    _add_output(take)
    merge = actions.add_parser(
        "merge",
        help="make one map of those of several runs and robots",
        epilog="example: agribot weeds merge runs/may runs/june -o both.geojson",
    )
    merge.add_argument("sources", nargs="+", metavar="[NAME=]RUN|MAP", help=_SOURCE)
    _add_output(merge)


def _add_output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FILE")
    parser.add_argument("--format", choices=SUFFIXES, help="default: as the file's name ends")
    parser.add_argument("--json", action="store_true", help="print a summary as the last line")


def run(options: argparse.Namespace) -> int:
    actions: dict[str, Callable[[argparse.Namespace], PlantTable]] = {
        "export": _open, "import": _import, "merge": _merge,
    }  # fmt: skip
    _check_output(options)
    table = actions[options.action](options)
    from agribot.gis.weeds.files import write_map

    write_map(options.out, table, SUFFIXES.get(options.format or "", ""))
    _tell(options, table)
    return 0


def _check_output(options: argparse.Namespace) -> None:
    """Refuse a name that says another format, before anything is read."""
    from agribot.gis.weeds.files import find_suffix

    if options.format is None:
        find_suffix(options.out)
    elif options.out.suffix and options.out.suffix != SUFFIXES[options.format]:
        raise ConfigError(f"-o {options.out} is no name for --format {options.format}")


def _open(options: argparse.Namespace) -> PlantTable:
    from agribot.app.weed_maps import open_map

    return open_map(options.source)


def _merge(options: argparse.Namespace) -> PlantTable:
    from agribot.app.weed_maps import open_map
    from agribot.autonomy.weeds.merge import merge_maps

    return merge_maps([open_map(source) for source in options.sources])


def _import(options: argparse.Namespace) -> PlantTable:
    from agribot.gis.weeds.field_check import check_in_field
    from agribot.gis.weeds.files import read_map

    name = options.name or options.source.name.partition(".")[0]
    table = read_map(options.source, name, _read_classes(options.classes))
    if options.field is not None:
        check_in_field(table, options.field, f"'{options.source.name[:80]}'")
    return table


def _read_classes(text: str | None) -> dict[str, str]:
    classes = dict(pair.partition("=")[::2] for pair in (text or "").split(",") if pair)
    wrong = [value for value in classes.values() if value not in {"weed", "crop"}]
    if wrong:
        raise ConfigError(f"--classes {text}: write VALUE=weed or VALUE=crop, with commas between")
    return {key.strip().lower(): value for key, value in classes.items()}


def _tell(options: argparse.Namespace, table: PlantTable) -> None:
    summary = _summarise(table)
    sys.stderr.write(
        f"{options.out}: {summary['weeds']} weeds, {summary['crops']} crop plants, "
        f"{summary['treated']} treated, from {len(table.maps)} "
        f"map{'s' * (len(table.maps) != 1)}\n"
    )
    if options.json:
        sys.stdout.write(json.dumps({"file": str(options.out), **summary}) + "\n")


def _summarise(table: PlantTable) -> dict[str, Any]:
    from agribot.autonomy.weeds.merge import fuse
    from agribot.autonomy.weeds.plant_table import OUTCOMES, is_crop

    rows = fuse(table).rows
    counts = {
        outcome: int((rows["outcome"] == code).sum()) for code, outcome in enumerate(OUTCOMES)
    }
    crops = int(is_crop(rows).sum())
    return {
        "maps": list(table.maps), "weeds": len(rows) - crops, "crops": crops,
        "treated": counts["treated"] + counts["seen again"], "missed": counts["missed"],
        "seen_again": counts["seen again"], "in_several_maps": len(rows) - _count_single(table),
    }  # fmt: skip


def _count_single(table: PlantTable) -> int:
    import numpy as np

    return int((np.bincount(table.rows["group"]) == 1).sum()) if len(table.rows) else 0
