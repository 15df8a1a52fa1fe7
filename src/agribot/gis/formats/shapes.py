"""Shapefiles in a ZIP archive, one for each of areas, lines and points."""

from __future__ import annotations

import codecs
import io
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from agribot.core.errors import ConfigError
from agribot.core.extras import format_install
from agribot.gis.formats.untrusted import pack, unpack
from agribot.gis.geojson import Feature, Found, describe_left_out, split_layers

WGS84 = (
    'GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]'
)


def read_shapefiles(data: bytes) -> Found:
    shapefile = load_library()
    files = {
        name.lower(): part for name, part in unpack(data, ".shp", ".dbf", ".prj", ".cpg").items()
    }
    layers = [name.removesuffix(".shp") for name in files if name.endswith(".shp")]
    if not layers:
        raise ValueError("no .shp file inside")
    for layer in layers:
        if f"{layer}.prj" in files:
            check_projection(files[f"{layer}.prj"])
        parts = {"shp": io.BytesIO(files[f"{layer}.shp"])}
        if f"{layer}.dbf" in files:
            parts["dbf"] = io.BytesIO(files[f"{layer}.dbf"])
        encoding = find_encoding(files.get(f"{layer}.cpg", b""), files.get(f"{layer}.dbf", b""))
        with shapefile.Reader(**parts, encoding=encoding, encodingErrors="replace") as reader:
            for record in reader.iterShapeRecords():
                fields = record.record.as_dict() if record.record else {}
                plain = {
                    k: v for k, v in fields.items() if isinstance(v, str | int | float) and v != ""
                }
                if record.shape.shapeType == shapefile.NULL:
                    yield describe_left_out(f"a record of layer '{layer[:40]}' without a place")
                else:
                    yield dict(record.shape.__geo_interface__), plain


def write_shapefiles(features: Sequence[Feature]) -> bytes:
    files: dict[str, bytes] = {}
    for geometry, layer, found in split_layers(features):
        files |= _write_layer(geometry, layer, found)
    return pack(files)


def _write_layer(geometry: str, layer: str, features: Sequence[Feature]) -> dict[str, bytes]:
    shapefile = load_library()
    parts = {suffix: io.BytesIO() for suffix in ("shp", "shx", "dbf")}
    kinds = {
        "Polygon": shapefile.POLYGON, "LineString": shapefile.POLYLINE, "Point": shapefile.POINT,
    }  # fmt: skip
    with shapefile.Writer(**parts, shapeType=kinds[geometry]) as writer:
        writer.field("kind", "C", 20)
        writer.field("name", "C", 80)
        for feature in features:
            if geometry == "Point":
                writer.point(*feature.parts[0][0])
            else:
                writer.shape({"type": geometry, "coordinates": feature.nest_coordinates()})
            writer.record(feature.kind, feature.name)
        writer.close()
    written = {f"{layer}.{suffix}": part.getvalue() for suffix, part in parts.items()}
    return written | {f"{layer}.prj": WGS84.encode(), f"{layer}.cpg": b"UTF-8"}


def check_projection(text: bytes) -> None:
    """Check that a .prj is of longitude and latitude in WGS-84, in either version of WKT.

    Raises: ValueError: it is not.
    """
    known = text.lstrip().upper()
    if not known.startswith((b"GEOGCS", b"GEOGCRS")) or b"WGS" not in known or b"84" not in known:
        raise ValueError("its .prj is not WGS-84 (EPSG:4326); convert it first")


def find_encoding(cpg: bytes, dbf: bytes) -> str:
    """Find the encoding of texts: what the .cpg names; else UTF-8 where they are, else Windows's.

    Of the .dbf its beginning is enough.
    """
    named = cpg.decode("ascii", "replace").strip()
    for name in (named, f"cp{named}"):  # 1252 is a name, too
        with suppress(LookupError, ValueError):
            return codecs.lookup(name).name
    records = dbf[int.from_bytes(dbf[8:10], "little") :]  # behind the header
    try:
        codecs.getincrementaldecoder("utf-8")().decode(records)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def load_library() -> Any:
    try:
        import shapefile
    except ImportError as error:
        raise ConfigError(f"Shapefiles need pyshp; {format_install('ui')}") from error
    return shapefile
