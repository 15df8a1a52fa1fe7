"""Untrusted files: XML and archives, read with limits."""

from __future__ import annotations

import html.entities
import io
import re
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import NoReturn
from xml.parsers import expat

from agribot.core.xml_text import recode_xml

MAX_FILE_BYTES = 100_000_000
MAX_MEMBERS = 10_000
MAX_ELEMENTS = 1_000_000
MAX_DEPTH = 100
_AMPERSAND = re.compile(rb"<!\[CDATA\[.*?\]\]>|&(#?\w{1,32};)?", re.DOTALL)
_OF_XML = (b"amp;", b"lt;", b"gt;", b"apos;", b"quot;")


def parse_xml(data: bytes) -> ET.Element:
    """Parse XML; tags are without their prefixes, also those whose namespace is missing.

    Raises: ValueError: no XML, with entities of its own, or beyond the limits.
    """
    text = recode_xml(data)
    try:
        return _build(text)
    except (expat.ExpatError, LookupError) as error:  # also an encoding that is not known
        fixed = _AMPERSAND.sub(_write_reference, text)
        try:
            return _build(fixed)
        except (expat.ExpatError, LookupError):
            raise ValueError(f"not XML: {error}") from error


def _build(text: bytes) -> ET.Element:
    parser, tree = expat.ParserCreate(), _BoundedTree()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = refuse_doctype
    parser.StartElementHandler = tree.begin
    parser.EndElementHandler = tree.end
    parser.CharacterDataHandler = tree.read
    parser.Parse(text, True)
    return tree.close()


def _write_reference(found: re.Match[bytes]) -> bytes:
    """Write a bare & of a name, or an entity of HTML, so that XML has it too."""
    if found[0].startswith(b"<") or found[1] in _OF_XML or (found[1] or b"").startswith(b"#"):
        return found[0]
    characters = html.entities.html5.get((found[1] or b"").decode("ascii", "replace"), "")
    written = "".join(f"&#{ord(one)};" for one in characters).encode()
    return written or b"&amp;" + (found[1] or b"")


class _BoundedTree:
    """Builds elements up to the limits."""

    def __init__(self) -> None:
        self._builder = ET.TreeBuilder()
        self._depth = self._elements = 0

    def begin(self, name: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        self._elements += 1
        if self._depth > MAX_DEPTH or self._elements > MAX_ELEMENTS:
            raise ValueError(
                f"more than {MAX_ELEMENTS} elements, or more than {MAX_DEPTH} inside each other"
            )
        self._builder.start(get_local(name), attributes)

    def end(self, name: str) -> None:
        self._depth -= 1
        self._builder.end(get_local(name))

    def read(self, text: str) -> None:
        self._builder.data(text)

    def close(self) -> ET.Element:
        return self._builder.close()


def get_local(name: str) -> str:
    """Return a name without its prefix."""
    return name.rpartition(":")[2]


def refuse_doctype(*_: object) -> NoReturn:
    """Handle a document type for expat by refusing it: entities are never expanded."""
    raise ValueError("document type declarations are not accepted")


def read_text(element: ET.Element, name: str) -> str:
    """Return the text of the child of this name, or an empty string."""
    return next(((e.text or "").strip() for e in element if e.tag == name), "")


def encode_xml(root: ET.Element) -> bytes:
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def list_members(data: bytes) -> list[str]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return [_find_name(entry) for entry in archive.infolist()]


def unpack(data: bytes, *suffixes: str) -> dict[str, bytes]:
    """Unpack the files with these suffixes from a ZIP archive, in memory.

    Raises: ValueError: beyond the limits; zipfile.BadZipFile: no archive.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {_find_name(e): archive.read(e) for e in _select_members(archive, suffixes)}


def _find_name(entry: zipfile.ZipInfo) -> str:
    """Return the name of a file in an archive; old packers of Windows write backslashes."""
    return entry.filename.replace("\\", "/")


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
    """Return whether an entry is metadata that macOS packs beside a file, with its suffix."""
    path = PurePosixPath(_find_name(entry))
    return "__MACOSX" in path.parts or path.name.startswith("._")


def pack(files: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()
