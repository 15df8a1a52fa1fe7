"""Weed maps as GeoJSON (RFC 7946) and as CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from agribot.autonomy.weeds.plant_table import PlantTable
from agribot.core.geo import Datum
from agribot.core.table_text import (
    CHUNK_BYTES,
    find_encoding,
    find_separator,
    names_separator,
    read_decimal,
    recode_text,
)
from agribot.gis.geojson import find_other_crs
from agribot.gis.weeds.found_plants import Reading
from agribot.gis.weeds.records import COLUMNS, Record, iterate_records

FORMAT = 1
MAX_TEXT_BYTES = 800_000_000
_PLACES = {"Point", "MultiPoint"}
_PLACE = {
    "lon_deg": ("lon_deg", "lon", "longitude", "x"),
    "lat_deg": ("lat_deg", "lat", "latitude", "y"),
}
_TEXTS = {name for name, kind in COLUMNS.items() if kind == "TEXT"}


class _Header(msgspec.Struct, frozen=True):
    format: int
    datum: Datum


class _Shape(msgspec.Struct, frozen=True):
    type: str
    coordinates: Any = None


class _Member(msgspec.Struct, frozen=True):
    geometry: _Shape | None = None
    properties: dict[str, Any] | None = None


class _Collection(msgspec.Struct, frozen=True):
    """A FeatureCollection whose features wait as text: decoded at once they would fill memory."""

    type: str
    features: list[msgspec.Raw]
    crs: Any = None
    agribot: _Header | None = None


def write_geojson(path: Path, table: PlantTable) -> None:
    head = {"format": FORMAT, "datum": msgspec.to_builtins(table.datum)}
    begin = b'{"type":"FeatureCollection","agribot":' + msgspec.json.encode(head)
    with path.open("wb") as file:
        file.write(begin + b',"features":[')
        between = b"\n"
        for records in iterate_records(table):
            file.write(between + b",\n".join(map(_encode_feature, records)))
            between = b",\n"
        file.write(b"\n]}\n")


def _encode_feature(record: Record) -> bytes:
    values = dict(zip(COLUMNS, record.values, strict=True))
    if values["evidence"] is None:
        del values["evidence"]
    values["treated"] = values["treated_s"] is not None
    return msgspec.json.encode(
        {
            "type": "Feature",
            "id": values["id"],
            "geometry": {"type": "Point", "coordinates": (record.lon_deg, record.lat_deg)},
            "properties": values,
        }
    )


def read_geojson(path: Path) -> Reading:
    """Read a FeatureCollection of points.

    Raises: ValueError: not such a collection, or in other coordinates.
    """
    size = path.stat().st_size
    if size > MAX_TEXT_BYTES:
        raise ValueError(f"{size} bytes, more than {MAX_TEXT_BYTES}; take a GeoPackage")
    found = msgspec.json.decode(recode_text(path.read_bytes()), type=_Collection)
    if found.type != "FeatureCollection":
        raise ValueError(f"a {found.type[:40]} and no FeatureCollection")
    other = find_other_crs(found.crs)
    if other:
        raise ValueError(f"its coordinates are in {other}; convert it to WGS-84 (EPSG:4326) first")
    return Reading(_decode_features(found.features), found.agribot.datum if found.agribot else None)


def _decode_features(features: list[msgspec.Raw]) -> Iterator[tuple[float, float, dict[str, Any]]]:
    decoder = msgspec.json.Decoder(_Member)
    for raw in features:
        member = decoder.decode(raw)
        shape = member.geometry
        if shape is None or (shape.type in _PLACES and not shape.coordinates):  # without a place
            continue
        lon_deg, lat_deg = _find_point(shape)[:2]
        yield float(lon_deg), float(lat_deg), member.properties or {}


def _find_point(shape: _Shape) -> Any:
    if shape.type == "MultiPoint" and len(shape.coordinates) == 1:
        return shape.coordinates[0]
    if shape.type != "Point":
        raise ValueError(f"a plant is a Point, not {shape.type[:40]}")
    return shape.coordinates


def write_csv(path: Path, table: PlantTable) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*COLUMNS, "lat_deg", "lon_deg"])
        for records in iterate_records(table):
            writer.writerows([*r.values, r.lat_deg, r.lon_deg] for r in records)


def read_csv(path: Path) -> Reading:
    """Read a table with a line of names; latitude and longitude are in degrees.

    Commas, semicolons or tabs separate its values.
    Raises: ValueError: it has no such columns, or a line is too short.
    """
    return Reading(_iterate_lines(path))


def _iterate_lines(path: Path) -> Iterator[tuple[float, float, dict[str, Any]]]:
    with path.open("rb") as raw:
        encoding = find_encoding(iter(lambda: raw.read(CHUNK_BYTES), b""))
    with path.open(encoding=encoding, errors="replace", newline="") as file:
        first = file.readline()
        separator = find_separator(first)
        skipped = int(names_separator(first))
        if not skipped:
            file.seek(0)
        lines = csv.reader(file, delimiter=separator)
        names = [name.strip() for name in next(lines, [])]
        lon, lat = (_find_column(names, wanted) for wanted in _PLACE.values())
        for number, line in enumerate(lines, 2 + skipped):
            if not line:
                continue
            if len(line) != len(names):
                raise ValueError(
                    f"line {number} has {len(line)} values, not {len(names)}: it is cut off, or its"
                    " values are not separated as the names in the first line are"
                )
            values = {
                name: (text if name in _TEXTS else _read_number(text, separator))
                for name, text in zip(names, line, strict=True)
                if text
            }
            lon_deg, lat_deg = (read_decimal(line[column], separator) for column in (lon, lat))
            yield lon_deg, lat_deg, values


def _find_column(names: list[str], wanted: tuple[str, ...]) -> int:
    lowered = [name.lower() for name in names]
    for name in wanted:
        if name in lowered:
            return lowered.index(name)
    raise ValueError(f"no column {wanted[0]}; its first line is {','.join(names)[:100]!r}")


def _read_number(text: str, separator: str) -> float | str:
    try:
        return read_decimal(text, separator)
    except ValueError:
        return text
