"""The table of formats, and reading and writing of field files of any of them."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path, PurePath
from typing import Any

from agribot.core.errors import AgribotError, MissionError, has_advice
from agribot.core.facts import (
    EndingUnknown,
    FileBroken,
    FileKindUnknown,
    FileLarge,
    FileUnreadable,
    GeometryUnfit,
    NothingDrawn,
    NotPositions,
)
from agribot.core.geometries import split_geometry
from agribot.core.sqlite_file import read_with_log
from agribot.gis.field_choice import choose_field, split_choice
from agribot.gis.formats.geopackage import read_geopackage, write_geopackage
from agribot.gis.formats.gpx import read_gpx, write_gpx
from agribot.gis.formats.isoxml import holds_task_data, read_isoxml, write_isoxml
from agribot.gis.formats.kinds import close_lines, give_kinds
from agribot.gis.formats.kml import read_kml, read_kmz, write_kml, write_kmz
from agribot.gis.formats.shapes import read_shapefiles, write_shapefiles
from agribot.gis.formats.untrusted import MAX_FILE_BYTES, list_members
from agribot.gis.geojson import (
    Feature,
    Found,
    Geometry,
    make_feature,
    parse_features,
    read_geojson,
    read_position,
)
from agribot.gis.parts import describe_part, find_boundary, split_boundary

MAX_NAMED = 8  # things named that a file holds and that are left out
# Shapes without a kind that are guessed: their type, its word, and what they are taken for.
GUESSES = (
    ("LineString", "lines", "crop rows, which are driven along"),
    ("Point", "points", "goals, which plans do not keep off"),
)
_LEVELS = {"Point": (), "LineString": ("position",), "Polygon": ("ring", "position")}


def read_field_file(name: str, data: bytes) -> dict[str, Any]:
    """Read a FeatureCollection in WGS-84, without heights and multi-geometries.

    A feature without a `kind` gets the default one: areas are boundaries, and obstacles inside of
    them, lines are rows. Of a boundary of several parts the largest is the field; `parts` holds the
    others, which `choose_field` knows by their names.
    Raises: MissionError: an unknown kind of file, a broken one, or one in other coordinates.
    """
    return _read_shapes(name, data, is_field=True)


def read_areas_file(name: str, data: bytes) -> list[dict[str, Any]]:
    """Read the features of a file that is no field, all parts of them.

    Raises: MissionError: as `read_field_file`.
    """
    found: list[dict[str, Any]] = _read_shapes(name, data, is_field=False)["features"]
    return found


def _read_shapes(name: str, data: bytes, *, is_field: bool) -> dict[str, Any]:
    shown = f"'{name[:80]}'"
    reader = READERS.get(PurePath(name).suffix.lower())
    if reader is None:
        raise MissionError(FileKindUnknown(shown, ", ".join(sorted(READERS))))
    try:
        found, parts, left_out = _read_members(reader(data), shown, is_field=is_field)
    except AgribotError:
        raise
    except Exception as error:  # each library has its own errors for broken files
        reason = " ".join(str(error).split()) or "it is empty or cut off"
        raise MissionError(FileBroken(shown, reason, has_advice(reason))) from error
    if not found:
        raise MissionError(NothingDrawn(shown))
    changes: Counter[str] = Counter()
    close_lines(found, changes)
    left_out.update(describe_part(part) for part in parts)
    guessed = give_kinds(found, left_out)
    if not any(feature["properties"]["kind"] == "boundary" for feature in found):
        del guessed["LineString"]  # a file of rows
    notes = _name_changes(name, left_out, changes, guessed)
    more: dict[str, Any] = {"left_out": notes} if notes else {}
    if parts:
        more["parts"] = parts
    return {"type": "FeatureCollection", "features": found, **more}


def _read_members(
    members: Found, shown: str, *, is_field: bool
) -> tuple[list[dict[str, Any]], list[dict[str, Any]], Counter[str]]:
    """Split members into features of one part each; count what is left out, in words.

    The smaller parts of a boundary stand beside them.
    """
    whole: list[dict[str, Any]] = []
    spare: list[dict[str, Any]] = []
    left_out: Counter[str] = Counter()
    for geometry, properties in members:
        if geometry is None:
            left_out[properties["left_out"]] += 1
        whole.append({"geometry": geometry, "properties": properties})
    boundary = find_boundary(whole) if is_field else None
    found: list[dict[str, Any]] = []
    for number, feature in enumerate(whole):
        if feature["geometry"] is None:
            continue
        parts = _split_multi(feature["geometry"], f"{shown} feature {number}")
        if feature is boundary and len(parts) > 1:
            largest, *smaller = split_boundary(parts, feature["properties"])
            found.append(largest)
            spare += smaller
            continue
        found += [
            {"type": "Feature", "geometry": part, "properties": {**feature["properties"]}}
            for part in parts
        ]
    return found, spare, left_out


def _name_changes(
    name: str, left_out: Counter[str], changes: Counter[str], guessed: Counter[str]
) -> str:
    """Name in one line what was left out or changed, and what was guessed of lines and points."""
    notes = []
    if left_out:
        notes.append(f"left out: {_list_counted(left_out)}")
    if changes:
        notes.append(_list_counted(changes))
    notes += [
        f"{what} without a kind: {guessed[shape]}, taken for {meant}; draw what stands there as an "
        "area"
        for shape, what, meant in GUESSES
        if guessed[shape]
    ]
    return f"{name[:80]}: {'; '.join(notes)}" if notes else ""


def _list_counted(things: Counter[str]) -> str:
    some = [f"{count} x {what}" if count > 1 else what for what, count in things.items()]
    more = [f"{len(some) - MAX_NAMED} more"] if len(some) > MAX_NAMED else []
    return ", ".join([*some[:MAX_NAMED], *more])


def read_fields(path: Path) -> dict[str, Any]:
    """Read a field file from disk; of several fields in it that which is named behind a `#`.

    Raises: MissionError: as `read_field_file`, there is no such file, or no such field in it.
    """
    path, wanted = split_choice(path)
    root = _read_file(path)
    return choose_field(root, wanted, path.name) if wanted else root


def _read_file(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise MissionError(FileLarge(path.name, path.stat().st_size, MAX_FILE_BYTES))
        return read_field_file(path.name, read_with_log(path))
    except OSError as error:
        raise MissionError(FileUnreadable(str(path), str(error))) from error


def write_field_file(suffix: str, collection: object) -> bytes:
    """Write a FeatureCollection in the format of a suffix.

    Raises: MissionError: no such format, or the collection is no valid field.
    """
    writer = WRITERS.get(suffix)
    if writer is None:
        raise MissionError(EndingUnknown(f"'{suffix[:20]}'", ", ".join(WRITERS)))
    return writer(parse_features(collection, "the field"))


def find_ending(name: str) -> str:
    """Return the suffix of a name that a writer has, such as .json, or else its last suffix."""
    lowered = name.lower()
    endings = (ending for ending in WRITERS if lowered.endswith(ending))
    return next(endings, PurePath(lowered).suffix)


def _split_multi(geometry: Geometry, where: str) -> list[Geometry]:
    """Split multi-geometries, drop heights, and leave out what is empty."""
    found = []
    for single in split_geometry(geometry):
        kind = single["type"]
        if kind not in _LEVELS:
            raise MissionError(GeometryUnfit(where, repr(kind), "shapes"))
        if single["coordinates"]:
            places = _drop_heights(single["coordinates"], where, _LEVELS[kind])
            found.append({"type": kind, "coordinates": places})
    return found


def _drop_heights(coordinates: Any, where: str, levels: Sequence[str]) -> Any:
    """Keep longitude and latitude of positions that are nested by these levels."""
    if not levels:
        return list(read_position(coordinates, where))
    if not coordinates:
        raise ValueError("a line or a ring has no places; draw it again, or remove it")
    if not isinstance(coordinates, list | tuple):
        raise MissionError(NotPositions(where))
    return [
        _drop_heights(inner, f"{where} {levels[0]} {number}", levels[1:])
        for number, inner in enumerate(coordinates)
    ]


def _write_geojson(found: Sequence[Feature]) -> bytes:
    written = [
        make_feature(
            f.geometry, f.nest_coordinates(), kind=f.kind, **({"name": f.name} if f.name else {})
        )
        for f in found
    ]
    return json.dumps({"type": "FeatureCollection", "features": written}, indent=1).encode() + b"\n"


def _read_archive(data: bytes) -> Found:
    read = read_isoxml if holds_task_data(list_members(data)) else read_shapefiles
    return read(data)


READERS: dict[str, Callable[[bytes], Found]] = {
    ".geojson": read_geojson,
    ".json": read_geojson,
    ".kml": read_kml,
    ".kmz": read_kmz,
    ".gpkg": read_geopackage,
    ".gpx": read_gpx,
    ".zip": _read_archive,
}
# Writers by suffix; two of the formats are archives, distinguished by their suffixes.
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
