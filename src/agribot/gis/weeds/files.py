"""The table of formats of weed maps, and reading and writing of any of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from agribot.autonomy.weeds.plant_table import PlantTable
from agribot.core.errors import (
    CHECK_DISK,
    AgribotError,
    RecordingError,
    add_advice,
    explain_os_error,
)
from agribot.core.whole_file import make_at_once
from agribot.gis.weeds.found_plants import Reading, tabulate_found
from agribot.gis.weeds.geopackage_file import read_geopackage, write_geopackage
from agribot.gis.weeds.kml_file import read_kml, write_kml
from agribot.gis.weeds.shape_files import (
    PARTS,
    read_shape_archive,
    read_shapefile,
    write_shape_archive,
    write_shapefile,
)
from agribot.gis.weeds.text_files import read_csv, read_geojson, write_csv, write_geojson


class FileFormat(NamedTuple):
    read: Callable[[Path], Reading]
    write: Callable[[Path, PlantTable], None]


FORMATS = {
    ".geojson": FileFormat(read_geojson, write_geojson),
    ".gpkg": FileFormat(read_geopackage, write_geopackage),
    ".shp": FileFormat(read_shapefile, write_shapefile),
    ".shp.zip": FileFormat(read_shape_archive, write_shape_archive),
    ".kml": FileFormat(read_kml, write_kml),
    ".csv": FileFormat(read_csv, write_csv),
}


def find_suffix(path: Path) -> str:
    """Find the format that a file's name says.

    Raises: RecordingError: none that a weed map can have.
    """
    name = path.name.lower().removesuffix(".json") + (".geojson" * path.name.endswith(".json"))
    for suffix in sorted(FORMATS, key=len, reverse=True):
        if name.endswith(suffix):
            return suffix
    raise RecordingError(f"{path.name}: not a weed map; give one of {', '.join(FORMATS)}")


def read_map(path: Path, name: str, classes: Mapping[str, str] | None = None) -> PlantTable:
    """Read a weed map of any format; `name` and `classes` as in `tabulate_found`.

    Raises: RecordingError: no weed map, a broken one, or one in other coordinates.
    """
    suffix, shown = find_suffix(path), f"'{path.name[:80]}'"
    if not path.is_file():
        raise RecordingError(f"weed map {path} does not exist; check the path")
    try:
        return tabulate_found(FORMATS[suffix].read(path), shown, name, classes)
    except AgribotError:
        raise
    except Exception as error:  # each library has its own errors for broken files
        reason = " ".join(str(error).split()) or "it is empty or cut off"
        fact = f"{shown} cannot be read: {reason}"
        raise RecordingError(add_advice(fact, "export it anew")) from error


def write_map(path: Path, table: PlantTable, suffix: str = "") -> None:
    """Write a weed map in the format of a suffix, or that of its name; whole, or not at all.

    Raises: RecordingError: no such format, or it cannot be written.
    """
    suffix = suffix or find_suffix(path)
    write = FORMATS[suffix].write
    with explain_os_error(f"cannot write {path}", CHECK_DISK):
        path.parent.mkdir(parents=True, exist_ok=True)
        target = Path(os.path.realpath(path))  # links are followed
        if suffix == ".shp":
            _write_parts(target, table)
        elif target.exists() and not target.is_file():  # a pipe
            write(target, table)
        else:
            make_at_once(target, lambda beside: write(beside, table))


def _write_parts(path: Path, table: PlantTable) -> None:
    """Write a Shapefile beside its place, then put each of its files there."""
    beside = path.with_name(f".{path.stem}.new.shp")
    try:
        write_shapefile(beside, table)
        for suffix in PARTS:
            beside.with_suffix(suffix).replace(path.with_suffix(suffix))
    finally:
        for suffix in PARTS:
            beside.with_suffix(suffix).unlink(missing_ok=True)
