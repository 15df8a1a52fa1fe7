"""`agribot weeds`: weed maps of runs and robots, in and out of the files of farm software."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agribot.cli.ranges import check_within
from agribot.core.errors import ConfigError

if TYPE_CHECKING:
    from agribot.autonomy.plan.coverage.area import MapLine
    from agribot.autonomy.weeds.plant_table import PlantTable
    from agribot.core.messages import Row

# Suffix of the file by --format.
SUFFIXES = {
    "geojson": ".geojson", "gpkg": ".gpkg", "shp": ".shp", "kml": ".kml", "csv": ".csv",
}  # fmt: skip
STRAIGHT_M = 0.1
ISOXML = "isoxml"  # .isoxml.zip, or any .zip with --format
_SOURCE = "folder of a run, run.mcap, or a weed map: .geojson, .gpkg, .shp, .shp.zip, .kml, .csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    export = actions.add_parser(
        "export",
        help="write a weed map for QGIS, farm software or a spreadsheet",
        epilog="example: agribot weeds export runs/first -o weeds.gpkg",
    )
    export.add_argument("source", metavar="RUN|MAP", help=_SOURCE)
    _add_output(export, [*SUFFIXES, ISOXML])
    tasks = export.add_argument_group("ISOXML: a prescription of what is left, and what was done")
    tasks.add_argument("--rate", type=float, default=200.0, metavar="L/HA", help="default: 200")
    tasks.add_argument("--cell", type=float, default=0.5, metavar="M", help="default: 0.5")
    tasks.add_argument(
        "--margin", type=float, default=0.1, metavar="M", help="around a weed; default: 0.1"
    )
    tasks.add_argument(
        "--began", metavar="UTC", help="2026-05-04T07:30; default: by the file's date"
    )
    tasks.add_argument("--version", choices=("3", "4"), default="4", help="default: 4")
    take = actions.add_parser(
        "import",
        help="check a weed map from elsewhere and take it in",
        epilog="example: agribot weeds import a.shp --classes 1=weed,2=crop -o a.geojson",
    )
    take.add_argument("source", type=Path, metavar="MAP", help=_SOURCE)
    take.add_argument("--classes", metavar="VALUE=weed|crop,…", help="what its classes mean")
    take.add_argument("--field", type=Path, metavar="FIELD",
                      help="refuse plants outside of it; of several fields in the file: "
                           "FILE#NAME")  # fmt: skip
    take.add_argument("--name", help="of the map; default: the file's")
    _add_output(take)
    report = actions.add_parser(
        "report",
        help="draw a page of it: weeds per square metre, treated and left, stand of the crop",
        epilog="example: agribot weeds report runs/first -o weeds.html",
    )
    report.add_argument("source", metavar="RUN|MAP", help=_SOURCE)
    report.add_argument("--field", type=Path, metavar="FIELD", help="field file with its rows")
    report.add_argument("-o", "--out", type=Path, required=True, metavar="FILE.html")
    report.add_argument("--json", action="store_true", help="print a summary as the last line")
    merge = actions.add_parser(
        "merge",
        help="make one map of those of several runs and robots",
        epilog="example: agribot weeds merge runs/may runs/june -o both.geojson",
    )
    merge.add_argument("sources", nargs="+", metavar="[NAME=]RUN|MAP", help=_SOURCE)
    _add_output(merge)


def _add_output(parser: argparse.ArgumentParser, formats: Iterable[str] = SUFFIXES) -> None:
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FILE")
    parser.add_argument("--format", choices=[*formats], help="default: as the file's name ends")
    parser.add_argument("--json", action="store_true", help="print a summary as the last line")


def run(options: argparse.Namespace) -> int:
    if options.action == "report":
        return _report(options)
    actions: dict[str, Callable[[argparse.Namespace], PlantTable]] = {
        "export": _open, "import": _import, "merge": _merge,
    }  # fmt: skip
    _check_output(options)
    table = actions[options.action](options)
    if _is_isoxml(options):
        _write_tasks(options, table)
    else:
        from agribot.gis.weeds.files import write_map

        write_map(options.out, table, SUFFIXES.get(options.format or "", ""))
    _print_summary(options, table)
    return 0


def _report(options: argparse.Namespace) -> int:
    if options.out.suffix.lower() not in {".html", ".htm"}:
        raise ConfigError(f"-o {options.out}: not a name of a page; end it with .html")
    from agribot.autonomy.weeds.plant_table import move_to_datum
    from agribot.record.weed_page import write_weed_report

    table = _open(options)
    rows: tuple[Row, ...] = ()
    if options.field is not None:
        from agribot.gis.field_file import read_field
        from agribot.gis.weeds.field_check import check_in_field

        check_in_field(table, options.field, f"'{options.source[-80:]}'")
        area, datum = read_field(options.field)
        table, rows = move_to_datum(table, datum), _take_straight(area.rows)
    write_weed_report(options.out, table, rows)
    _print_summary(options, table)
    return 0


def _take_straight(lines: Sequence[MapLine]) -> tuple[Row, ...]:
    """Take the rows that are straight to a decimetre, and say how many are left out."""
    import numpy as np

    from agribot.core.messages import Row
    from agribot.core.row_shape import project_on_row

    rows = []
    for index, line in enumerate(lines):
        row = Row(index=index, start_map_m=line[0], end_map_m=line[-1])
        _, left_m, _ = project_on_row(row, *np.array(line).T)
        if np.abs(left_m).max() <= STRAIGHT_M:
            rows.append(row)
    if len(rows) < len(lines):
        sys.stderr.write(f"note: {len(lines) - len(rows)} rows bend, their stand is not counted\n")
    return tuple(rows)


def _check_output(options: argparse.Namespace) -> None:
    """Refuse a name that says another format, before anything is read."""
    from agribot.gis.weeds.files import find_suffix

    if _is_isoxml(options):
        if options.out.suffix != ".zip":
            raise ConfigError(f"-o {options.out}: not a name of an archive; end it with .zip")
    elif options.format is None:
        find_suffix(options.out)
    elif options.out.suffix and options.out.suffix != SUFFIXES[options.format]:
        raise ConfigError(
            f"-o {options.out} is no name for --format {options.format}; "
            f"end it with {SUFFIXES[options.format]}"
        )


def _is_isoxml(options: argparse.Namespace) -> bool:
    by_name = options.format is None and options.out.name.lower().endswith(".isoxml.zip")
    return bool(options.action == "export" and (by_name or options.format == ISOXML))


def _write_tasks(options: argparse.Namespace, table: PlantTable) -> None:
    from agribot.gis.weeds.isoxml_tasks import TaskOptions, write_tasks

    limits = {"--rate": (options.rate, 0.0, 1e5), "--cell": (options.cell, 0.05, 100.0),
              "--margin": (options.margin, 0.0, 10.0)}  # fmt: skip
    for name, (value, low, high) in limits.items():
        check_within(name, value, low, high)
    began = _read_time(options, table)
    write_tasks(
        options.out, table,
        TaskOptions(began, options.rate, options.cell, options.margin, options.version),
    )  # fmt: skip


def _read_time(options: argparse.Namespace, table: PlantTable) -> datetime:
    """Read when the run's clock was zero; without --began, the file was written at its end."""
    import numpy as np

    if options.began is not None:
        try:
            began = datetime.fromisoformat(options.began)
            return began.astimezone(UTC) if began.tzinfo else began.replace(tzinfo=UTC)
        except (ValueError, OverflowError) as error:
            raise ConfigError(
                f"--began {options.began}: not a time; give it in UTC, as in 2026-05-04T07:30"
            ) from error
    times_s = table.rows["last_seen_s"]
    source = Path(options.source.partition("=")[2] or options.source)
    passed_s = float(np.nanmax(times_s)) if np.isfinite(times_s).any() else 0.0
    written_s = source.stat().st_mtime
    began = datetime.fromtimestamp(written_s - min(passed_s, written_s), UTC)
    sys.stderr.write(f"note: taken as begun at {began:%Y-%m-%dT%H:%M:%S} UTC; --began says else\n")
    return began


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
        raise ConfigError(f"--classes {text}: not classes; write VALUE=weed,VALUE=crop")
    return {key.strip().lower(): value for key, value in classes.items()}


def _print_summary(options: argparse.Namespace, table: PlantTable) -> None:
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
