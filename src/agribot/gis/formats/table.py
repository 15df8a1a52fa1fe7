"""The table of formats, and reading and writing of field files of any of them."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path, PurePath
from typing import Any

from agribot.core.errors import AgribotError, MissionError
from agribot.core.table_text import decode_text
from agribot.gis.formats.geopackage import read_geopackage, write_geopackage
from agribot.gis.formats.gpx import read_gpx, write_gpx
from agribot.gis.formats.isoxml import holds_task_data, read_isoxml, write_isoxml
from agribot.gis.formats.kml import read_kml, read_kmz, write_kml, write_kmz
from agribot.gis.formats.shapes import read_shapefiles, write_shapefiles
from agribot.gis.formats.untrusted import MAX_FILE_BYTES, list_members
from agribot.gis.geojson import (
    Feature,
    Found,
    Geometry,
    describe_left_out,
    find_other_crs,
    parse_features,
    read_position,
)

MAX_NAMED = 8  # of the things that a file holds and that are left out
_KIND_OF = {"LineString": "row", "Point": "waypoint"}


def read_field_file(name: str, data: bytes) -> dict[str, Any]:
    """Read a FeatureCollection in WGS-84, without heights and multi-geometries.

    A feature without a `kind` gets the default one: the first polygon is the boundary, others are
    obstacles, lines are rows.
    Raises: MissionError: an unknown kind of file, a broken one, or one in other coordinates.
    """
    shown = f"'{name[:80]}'"
    reader = READERS.get(PurePath(name).suffix.lower())
    if reader is None:
        raise MissionError(f"{shown}: files that can be read end with {', '.join(sorted(READERS))}")
    found: list[dict[str, Any]] = []
    left_out: Counter[str] = Counter()
    try:
        for geometry, properties in reader(data):
            if geometry is None:
                left_out[properties["left_out"]] += 1
                continue
            for shape in _split_multi(geometry, shown):
                found.append({"type": "Feature", "geometry": shape, "properties": {**properties}})
    except AgribotError:
        raise
    except Exception as error:  # each library has its own errors for broken files
        reason = " ".join(str(error).split()) or "it is empty or cut off"
        raise MissionError(f"{shown} cannot be read: {reason}") from error
    if not found:
        raise MissionError(f"{shown} holds no point, line or polygon")
    _give_kinds(found)
    told = _name_left_out(name, left_out, _count_bare_points(found))
    more = {"left_out": told} if told else {}
    return {"type": "FeatureCollection", "features": found, **more}


def _count_bare_points(found: Sequence[dict[str, Any]]) -> int:
    return sum("is_guessed" in each and each.pop("is_guessed") for each in found)


def _name_left_out(name: str, left_out: Counter[str], points: int) -> str:
    """Name in one line what was left out, and which points plans do not keep off."""
    told = []
    if left_out:
        some = [f"{count} x {what}" if count > 1 else what for what, count in left_out.items()]
        more = [f"{len(some) - MAX_NAMED} more"] if len(some) > MAX_NAMED else []
        told.append(f"left out: {', '.join([*some[:MAX_NAMED], *more])}")
    if points:
        told.append(
            f"points without a kind: {points}, taken for goals, which plans do not keep off; draw "
            "what stands there as an area"
        )
    return f"{name[:80]}: {'; '.join(told)}" if told else ""


def read_other(path: Path) -> dict[str, Any]:
    """Read a field file of another format from disk.

    Raises: MissionError: as `read_field_file`, or there is no such file.
    """
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise MissionError(
                f"{path.name} has {path.stat().st_size} bytes, more than {MAX_FILE_BYTES}"
            )
        return read_field_file(path.name, path.read_bytes())
    except OSError as error:
        raise MissionError(f"cannot read {path}: {error}; check the path") from error


def write_field_file(suffix: str, collection: object) -> bytes:
    """Write a FeatureCollection in the format of a suffix.

    Raises: MissionError: no such format, or the collection is no valid field.
    """
    writer = WRITERS.get(suffix)
    if writer is None:
        raise MissionError(f"'{suffix[:20]}': choose one of {', '.join(WRITERS)}")
    return writer(parse_features(collection, "the field"))


def find_ending(name: str) -> str:
    """Find the ending of a name among those that are written; what it is where it is none."""
    lowered = name.lower()
    endings = (ending for ending in WRITERS if lowered.endswith(ending))
    return next(endings, PurePath(lowered).suffix)


def _split_multi(geometry: Geometry, where: str) -> list[Geometry]:
    """Split multi-geometries, drop heights, and leave out what is empty."""
    kind = geometry["type"]
    if kind == "GeometryCollection":
        return [one for part in geometry["geometries"] for one in _split_multi(part, where)]
    parts = geometry["coordinates"] if kind.startswith("Multi") else [geometry["coordinates"]]
    single = kind.removeprefix("Multi")
    return [{"type": single, "coordinates": _drop_heights(part, where)} for part in parts if part]


def _drop_heights(coordinates: Any, where: str) -> Any:
    if not coordinates:
        raise ValueError("a line or a ring has no places; draw it again, or remove it")
    if isinstance(coordinates[0], int | float):
        return list(read_position(coordinates, where))
    return [_drop_heights(inner, where) for inner in coordinates]


def _give_kinds(found: Sequence[dict[str, Any]]) -> None:
    bounded = any(feature["properties"].get("kind") == "boundary" for feature in found)
    for feature in found:
        shape = feature["geometry"]["type"]
        area = "obstacle" if bounded else "boundary"
        if shape == "Point" and not feature["properties"].get("kind"):
            feature["is_guessed"] = True
        feature["properties"].setdefault("kind", _KIND_OF.get(shape, area))
        bounded = bounded or feature["properties"]["kind"] == "boundary"


def _read_geojson(data: bytes) -> Found:
    tree = json.loads(decode_text(data))
    other = find_other_crs(tree.get("crs"))
    if other:
        raise ValueError(f"coordinates are in {other}; convert them to WGS-84 first")
    kind = tree.get("type")
    if kind == "FeatureCollection":
        members = tree["features"]
    else:
        members = [tree if kind == "Feature" else {"geometry": tree}]
    for member in members:
        if member["geometry"] is None:
            yield describe_left_out("a feature without a place")
        else:
            yield member["geometry"], member.get("properties") or {}


def _write_geojson(found: Sequence[Feature]) -> bytes:
    written = [
        {
            "type": "Feature",
            "properties": {"kind": f.kind, **({"name": f.name} if f.name else {})},
            "geometry": {"type": f.geometry, "coordinates": f.nest_coordinates()},
        }
        for f in found
    ]
    return json.dumps({"type": "FeatureCollection", "features": written}, indent=1).encode() + b"\n"


def _read_archive(data: bytes) -> Found:
    read = read_isoxml if holds_task_data(list_members(data)) else read_shapefiles
    return read(data)


READERS: dict[str, Callable[[bytes], Found]] = {
    ".geojson": _read_geojson,
    ".json": _read_geojson,
    ".kml": read_kml,
    ".kmz": read_kmz,
    ".gpkg": read_geopackage,
    ".gpx": read_gpx,
    ".zip": _read_archive,
}
# Two of the formats are archives: their endings tell them apart.
WRITERS: dict[str, Callable[[Sequence[Feature]], bytes]] = {
    ".geojson": _write_geojson,
    ".json": _write_geojson,
    ".gpkg": write_geopackage,
    ".kml": write_kml,
    ".kmz": write_kmz,
    ".gpx": write_gpx,
    ".shp.zip": write_shapefiles,
    ".isoxml.zip": write_isoxml,
}
