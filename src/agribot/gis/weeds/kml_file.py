"""Weed maps as KML, in pieces: neither side holds the whole document."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.parsers import expat
from xml.sax.saxutils import escape

from agribot.autonomy.weeds.plant_table import PlantTable
from agribot.core.table_text import CHUNK_BYTES, find_encoding
from agribot.core.xml_text import declares_other
from agribot.gis.formats.untrusted import refuse_doctype
from agribot.gis.weeds.found_plants import Reading
from agribot.gis.weeds.records import COLUMNS, Record, iterate_records
from agribot.gis.weeds.styles import STYLES, find_style

_HEAD = (
    '<?xml version="1.0" encoding="utf-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">'
    "<Document><name>Weed map</name>\n"
)
_ICONS = "http://maps.google.com/mapfiles/kml/shapes"
_BLOCK_BYTES = 1 << 20
_HEAD_BYTES = 400  # enough for the declaration of an encoding
MAX_DEPTH = 30
_TEXTS = {name for name, kind in COLUMNS.items() if kind == "TEXT"}


def write_kml(path: Path, table: PlantTable) -> None:
    with path.open("w", encoding="utf-8") as file:
        file.write(_HEAD)
        for number, (name, colour) in enumerate(STYLES.items()):
            shape = "triangle" if name == "crop" else "shaded_dot"
            blue_first = "ff" + colour[5:7] + colour[3:5] + colour[1:3]
            file.write(
                f'<Style id="s{number}"><IconStyle><color>{blue_first}</color><scale>0.4</scale>'
                f"<Icon><href>{_ICONS}/{shape}.png</href></Icon></IconStyle><LabelStyle><scale>0</scale>"
                f"</LabelStyle><!-- {name} --></Style>\n"
            )
        for records in iterate_records(table):
            file.write("".join(map(_format_mark, records)))
        file.write("</Document></kml>\n")


def _format_mark(record: Record) -> str:
    values = dict(zip(COLUMNS, record.values, strict=True))
    style = [*STYLES].index(find_style(values))
    data = "".join(
        f'<Data name="{name}"><value>{escape(str(value))}</value></Data>'
        for name, value in values.items()
        if value is not None
    )
    return (
        f"<Placemark><name>{values['class']} {values['id']}</name><styleUrl>#s{style}</styleUrl>"
        f"<ExtendedData>{data}</ExtendedData><Point><coordinates>{record.lon_deg:.9f},"
        f"{record.lat_deg:.9f}</coordinates></Point></Placemark>\n"
    )


def read_kml(path: Path) -> Reading:
    """Read the placemarks that are points; extended data has the columns.

    Raises: ValueError: no KML, with a document type of its own, or with no place of a plant.
    """
    return Reading(_iterate_marks(path))


def _iterate_marks(path: Path) -> Iterator[tuple[float, float, dict[str, Any]]]:
    marks = _Marks()
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = refuse_doctype
    parser.StartElementHandler = marks.begin
    parser.EndElementHandler = marks.end
    parser.CharacterDataHandler = marks.read
    try:
        for block in _read_blocks(path):
            parser.Parse(block, False)
            yield from marks.take()
        parser.Parse(b"", True)
        yield from marks.take()
        marks.check_found()
    except (expat.ExpatError, LookupError) as error:
        raise ValueError(f"not KML, or cut off: {error}") from error


def _read_blocks(path: Path) -> Iterator[str | bytes]:
    """Read text, whose encoding is found, or bytes that declare another one than Unicode."""
    with path.open("rb") as raw:
        is_declared = declares_other(raw.read(_HEAD_BYTES))
        raw.seek(0)
        encoding = None if is_declared else find_encoding(iter(lambda: raw.read(CHUNK_BYTES), b""))
    mode, errors = ("rb", None) if encoding is None else ("r", "replace")
    with path.open(mode, encoding=encoding, errors=errors) as file:
        yield file.read(_BLOCK_BYTES).lstrip()
        while block := file.read(_BLOCK_BYTES):
            yield block


class _Marks:
    """Collects the placemarks of the block that is being parsed."""

    def __init__(self) -> None:
        self._found: list[tuple[float, float, dict[str, Any]]] = []
        self._path: list[str] = []
        self._values: dict[str, Any] = {}
        self._place: tuple[float, float] | None = None
        self._key, self._text = "", ""
        self._points, self._others = 0, 0

    def take(self) -> list[tuple[float, float, dict[str, Any]]]:
        found, self._found = self._found, []
        return found

    def check_found(self) -> None:
        """Check that a file with something in it has a plant.

        Raises: ValueError: it has areas or lines alone, or leads to other files.
        """
        if self._others and not self._points:
            raise ValueError(f"a plant is a Point, and none of its {self._others} features has one")

    def begin(self, name: str, attributes: dict[str, str]) -> None:
        self._path.append(name.rpartition(":")[2])
        if len(self._path) == 1 and self._path != ["kml"]:
            raise ValueError(f"not KML: it begins with <{name[:40]}>")
        if len(self._path) > MAX_DEPTH:
            raise ValueError(f"elements more than {MAX_DEPTH} deep")
        if self._path[-1] == "Placemark":
            self._values, self._place = {}, None
        self._key = attributes.get("name", self._key)
        self._text = ""

    def read(self, text: str) -> None:
        self._text += text

    def end(self, _name: str) -> None:
        name = self._path.pop()
        if name in {"value", "SimpleData"} and "ExtendedData" in self._path:
            text = self._text.strip()
            self._values[self._key] = text if self._key in _TEXTS else _read_number(text)
        elif name == "coordinates" and self._path[-1:] == ["Point"]:
            if self._place is not None:
                raise ValueError("a plant is one Point, and a placemark has several")
            lon, lat = self._text.strip().split(",")[:2]
            self._place = float(lon), float(lat)
        elif name == "Placemark" and self._place is not None:
            self._found.append((*self._place, self._values))
            self._points += 1
        elif name in {"Placemark", "NetworkLink"}:
            self._others += 1


def _read_number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
