"""Untrusted files: XML and archives, read with limits."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Any, NoReturn
from xml.parsers import expat

MAX_FILE_BYTES = 100_000_000
MAX_MEMBERS = 10_000
MAX_ELEMENTS = 1_000_000
MAX_DEPTH = 100


def parse_xml(data: bytes) -> ET.Element:
    """Parse XML.

    Raises: ValueError: no XML, with entities of its own, or beyond the limits.
    """
    _LimitCheck().check(data)
    try:
        return ET.fromstring(data)
    except (ET.ParseError, LookupError) as error:  # a prefix without a namespace, an encoding
        raise ValueError(f"not XML: {error}") from error


class _LimitCheck:
    """A first pass without a tree: entities are refused before any of them is expanded."""

    def __init__(self) -> None:
        self._depth = self._elements = 0

    def check(self, data: bytes) -> None:
        parser = expat.ParserCreate()
        parser.StartDoctypeDeclHandler = refuse_doctype
        parser.StartElementHandler = self._begin
        parser.EndElementHandler = self._end
        try:
            parser.Parse(data, True)
        except (expat.ExpatError, LookupError) as error:
            raise ValueError(f"not XML: {error}") from error

    def _begin(self, _name: str, _attributes: Any) -> None:
        self._depth += 1
        self._elements += 1
        if self._depth > MAX_DEPTH or self._elements > MAX_ELEMENTS:
            raise ValueError(
                f"more than {MAX_ELEMENTS} elements, or more than {MAX_DEPTH} inside each other"
            )

    def _end(self, _name: str) -> None:
        self._depth -= 1


def refuse_doctype(*_: object) -> NoReturn:
    """Handle a document type for expat by refusing it: entities are never expanded."""
    raise ValueError("document type declarations are not accepted")


def get_local_name(element: ET.Element) -> str:
    """Return an element's tag without its namespace."""
    return element.tag.rpartition("}")[2]


def read_text(element: ET.Element, name: str) -> str:
    """Return the text of the child of this name; empty where there is none."""
    return next(((e.text or "").strip() for e in element if get_local_name(e) == name), "")


def encode_xml(root: ET.Element) -> bytes:
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def list_members(data: bytes) -> list[str]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return archive.namelist()


def unpack(data: bytes, *suffixes: str) -> dict[str, bytes]:
    """Unpack the files with these suffixes from a ZIP archive, in memory.

    Raises: ValueError: beyond the limits; zipfile.BadZipFile: no archive.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {e.filename: archive.read(e) for e in _select_members(archive, suffixes)}


def _select_members(
    archive: zipfile.ZipFile, suffixes: tuple[str, ...]
) -> Iterator[zipfile.ZipInfo]:
    entries = archive.infolist()
    if len(entries) > MAX_MEMBERS:
        raise ValueError(f"{len(entries)} files inside, more than {MAX_MEMBERS}")
    found = [e for e in entries if e.filename.lower().endswith(suffixes) and not _is_shadow(e)]
    size = sum(e.file_size for e in found)
    if size > MAX_FILE_BYTES:
        raise ValueError(f"unpacks to {size} bytes, more than {MAX_FILE_BYTES}")
    yield from found


def _is_shadow(entry: zipfile.ZipInfo) -> bool:
    """Tell whether it is what macOS packs beside a file: its marks, under the file's own ending."""
    path = PurePosixPath(entry.filename)
    return "__MACOSX" in path.parts or path.name.startswith("._")


def pack(files: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()
