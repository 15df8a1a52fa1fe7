"""Weed maps as Shapefiles: .shp with .shx, .dbf, .prj and .cpg beside it, or all in a .shp.zip."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from agribot.autonomy.weeds.plant_table import PlantTable
from agribot.core.errors import RecordingError
from agribot.gis.formats.shapes import WGS84, check_projection, find_encoding, load_library
from agribot.gis.formats.untrusted import unpack
from agribot.gis.weeds.found_plants import Reading
from agribot.gis.weeds.records import COLUMNS, iterate_records

PARTS = (".shp", ".shx", ".dbf", ".prj", ".cpg")
# Names of ten letters for dBASE. The evidence does not fit into a field and is left out.
_SHORT = {"first_seen_s": "first_s", "last_seen_s": "last_s"}
# Names as GDAL shortens them.
_CUT = {name[:10]: name for name in COLUMNS if len(name) > 10}
_LONG = _CUT | {short: name for name, short in _SHORT.items()}
_NAMES = tuple(name for name in COLUMNS if name != "evidence")
_LONGEST_TEXT = 254  # bytes
# The least width of each field: those of ids and of names of maps grow with what is in them.
_WIDTHS = {
    "id": 10, "class": 4, "confidence": 8, "decision": 5, "outcome": 10, "reason": 24, "std_m": 9,
    "xx_m2": 13, "xy_m2": 13, "yy_m2": 13, "area_m2": 11, "sightings": 10, "first_seen_s": 14,
    "last_seen_s": 14, "treated_s": 14, "x_map_m": 11, "y_map_m": 11, "map": 40, "map_id": 10,
    "maps": 4,
}  # fmt: skip
_DECIMALS = {
    "confidence": 5, "std_m": 5, "xx_m2": 10, "xy_m2": 10, "yy_m2": 10, "area_m2": 7,
    "first_seen_s": 4, "last_seen_s": 4, "treated_s": 4, "x_map_m": 4, "y_map_m": 4,
}  # fmt: skip


def write_shapefile(path: Path, table: PlantTable) -> None:
    """Write `path`, which ends with .shp, and its four companions.

    Raises: RecordingError: the name of a map is too long for a Shapefile.
    """
    library, widths = load_library(), _choose_widths(table)
    with library.Writer(str(path), shapeType=library.POINT, encoding="utf-8") as writer:
        for name in _NAMES:
            kind = "C" if COLUMNS[name] == "TEXT" else "N"
            writer.field(_SHORT.get(name, name), kind, widths[name], _DECIMALS.get(name, 0))
        used = [
            ([*COLUMNS].index(name), "" if COLUMNS[name] == "TEXT" else None) for name in _NAMES
        ]
        for records in iterate_records(table):
            for record in records:
                writer.point(record.lon_deg, record.lat_deg)
                values = record.values
                writer.record(*(nil if values[at] is None else values[at] for at, nil in used))
    path.with_suffix(".prj").write_text(WGS84, encoding="ascii")
    path.with_suffix(".cpg").write_text("UTF-8", encoding="ascii")


def _choose_widths(table: PlantTable) -> dict[str, int]:
    """Choose fields as wide as their values: the library cuts off what is longer."""
    longest = max(table.maps, key=lambda name: len(name.encode()))
    wanted = {"map": len(longest.encode())}
    if wanted["map"] > _LONGEST_TEXT:
        raise RecordingError(
            f"the name of map '{longest[:80]}…' has {wanted['map']} bytes, a Shapefile takes "
            f"{_LONGEST_TEXT}; give it another one, NAME=FILE, or take a GeoPackage"
        )
    ids = table.rows["id"]
    ends = (int(ids.min()), int(ids.max())) if len(ids) else (0,)
    wanted["id"] = wanted["map_id"] = max(len(str(end)) for end in ends)
    return {name: max(width, wanted.get(name, 0)) for name, width in _WIDTHS.items()}


def write_shape_archive(path: Path, table: PlantTable) -> None:
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        shape = Path(folder) / "weed_map.shp"
        write_shapefile(shape, table)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for suffix in PARTS:
                archive.write(shape.with_suffix(suffix), f"weed_map{suffix}")


# Names of the types of shapes that are points.
_POINTS = {f"{many}POINT{more}" for many in ("", "MULTI") for more in ("", "Z", "M")}


def read_shapefile(path: Path) -> Reading:
    """Read points with their attributes; companions lie beside the .shp.

    Raises: ValueError: a companion is missing, or the coordinates are projected.
    """
    for suffix in (".dbf", ".prj"):
        if not path.with_suffix(suffix).is_file():
            raise ValueError(f"{path.with_suffix(suffix).name} is missing beside it")
    check_projection(path.with_suffix(".prj").read_bytes())
    return Reading(_iterate_shapes(path))


def read_shape_archive(path: Path) -> Reading:
    return Reading(_iterate_archive(path))


def _iterate_archive(path: Path) -> Iterator[tuple[float, float, Mapping[str, Any]]]:
    files = unpack(path.read_bytes(), *PARTS)
    shapes = [name for name in files if name.lower().endswith(".shp")]
    if len(shapes) != 1:
        raise ValueError(f"{len(shapes)} .shp files inside, where one is wanted")
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files.items():
            if name[:-4] == shapes[0][:-4]:
                (Path(folder) / f"map{name[-4:].lower()}").write_bytes(data)
        yield from read_shapefile(Path(folder) / "map.shp").found


def _iterate_shapes(path: Path) -> Iterator[tuple[float, float, dict[str, Any]]]:
    library = load_library()
    cpg = path.with_suffix(".cpg")
    with path.with_suffix(".dbf").open("rb") as file:
        encoding = find_encoding(cpg.read_bytes() if cpg.is_file() else b"", file.read(1 << 20))
    with library.Reader(str(path), encoding=encoding, encodingErrors="replace") as reader:
        if reader.shapeTypeName not in _POINTS:
            raise ValueError(f"its shapes are {reader.shapeTypeName}, not points")
        names = [
            _LONG.get(field[0], field[0]) for field in reader.fields if field[0] != "DeletionFlag"
        ]
        if reader.numShapes != reader.numRecords:
            raise ValueError(f"{reader.numShapes} shapes, but {reader.numRecords} records: cut off")
        for item in reader.iterShapeRecords():
            if item.shape.shapeType == library.NULL:  # a record without a place, as in GeoPackages
                continue
            if len(item.shape.points) != 1:
                raise ValueError(f"a plant is a point, not {len(item.shape.points)} of them")
            lon_deg, lat_deg = item.shape.points[0][:2]
            values = zip(names, item.record, strict=True)
            yield lon_deg, lat_deg, {k: v for k, v in values if v not in (None, "")}
