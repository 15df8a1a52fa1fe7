"""xacro as it was written before ROS Jade: directives and macro calls without their prefix."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import xacro

from agribot.core.xml_text import recode_xml
from agribot.description.elements import FileFinding, SourceFile
from agribot.description.markup import PlacedElement

DIRECTIVES = {"property", "macro", "include", "if", "unless", "insert_block", "arg"}
# Elements whose contents belong to other programs, which may use the same words.
FOREIGN = {"plugin", "sensor"}


class OldDialect:
    """Translates while xacro reads, and keeps the texts to find the places of elements."""

    def __init__(self, source: SourceFile) -> None:
        self._source = source
        self._texts: dict[str, list[str]] = {}

    @contextmanager
    def accept(self) -> Iterator[None]:
        """Make xacro accept both dialects, while open."""
        parse, call = xacro.parse, xacro.handle_macro_call

        def parse_both(inp: Any, filename: str | None = None) -> Any:
            if inp is not None or filename is None:
                return parse(inp, filename)
            data = read_utf_8(Path(filename)) if Path(filename).is_file() else None
            document = parse(None if data is None else io.BytesIO(data), filename)
            self._read(document.documentElement, Path(filename), data or b"")
            return document

        def call_both(node: Any, macros: Any, symbols: Any) -> Any:
            if ":" not in node.tagName and node.tagName in macros:
                _prefix(node)
            return call(node, macros, symbols)

        xacro.parse, xacro.handle_macro_call = parse_both, call_both
        try:
            yield
        finally:
            xacro.parse, xacro.handle_macro_call = parse, call

    def place(self, root: ET.Element) -> None:
        """Give the named elements of the expanded tree the file and line of their source."""
        for element in root.iter():
            if isinstance(element, PlacedElement):
                element.line = 0
                name = element.get("name") or element.get("reference")
                if name is not None:
                    self._place(element, (f"<{element.tag} ", f'"{name}"'))

    def _place(self, element: PlacedElement, words: tuple[str, ...]) -> None:
        for file, lines in self._texts.items():
            for number, line in enumerate(lines, 1):
                if all(word in line for word in words):
                    element.file, element.line = file, number
                    return

    def _read(self, top: Any, file: Path, data: bytes) -> None:
        text = data.decode("utf-8", errors="replace")
        self._texts[file.name] = text.splitlines()
        old = sorted(_translate(top))
        if old:
            line = next(
                (n for n, line in enumerate(text.splitlines(), 1) if f"<{old[0]}" in line), 0
            )
            what = f"<{'>, <'.join(old)}> without the prefix xacro:, as before ROS Jade"
            self._source.findings.append(FileFinding(file.name, line, what, f"{file.name}: {what}"))
        for number, words in enumerate(text.splitlines(), 1):
            if words.strip().endswith(">>"):
                self._source.findings.append(FileFinding(file.name, number, "a '>' too many", ""))


def read_utf_8(path: Path) -> bytes:
    """Read XML as UTF-8, unless it declares another encoding or is no text.

    Raises: OSError: it cannot be read.
    """
    data = path.read_bytes()
    try:
        return recode_xml(data)
    except ValueError:
        return data


def _translate(node: Any) -> set[str]:
    """Prefix the directives below a node; return those that had none."""
    found = set()
    for child in node.childNodes:
        if child.nodeType != child.ELEMENT_NODE or child.tagName in FOREIGN:
            continue
        if child.tagName in DIRECTIVES:
            found.add(str(child.tagName))
            _prefix(child)
        found |= _translate(child)
    return found


def _prefix(node: Any) -> None:
    node.tagName = node.nodeName = f"xacro:{node.tagName}"
