"""XML trees whose elements have their file and line."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any
from xml.parsers import expat

from agribot.core.errors import DescriptionError
from agribot.core.xml_text import recode_xml

_PREFIX = re.compile(rb"(?:</?|\s)([A-Za-z_][\w.-]*):[\w.-]+(?=[\s=/>])")
_DECLARED = re.compile(rb"\sxmlns:([\w.-]+)\s*=")
_FIRST_TAG = re.compile(rb"<[A-Za-z_][\w.:-]*")
# Prefixes of XML itself, and of xacro, without whose namespace nothing would be expanded.
_NEVER_DECLARED = {b"xml", b"xmlns", b"xacro"}
_GAZEBO_NAME = re.compile(rb"</?[\w.-]+(?:::[\w.-]+)+|\s[\w.-]+(?:::[\w.-]+)+(?=\s*=\s*[\"'])")


class PlacedElement(ET.Element):
    """An element with the place it was read from; line 0 means that it comes from no file."""

    file: str = ""
    line: int = 0


def parse_xml(text: bytes | str, file: str) -> ET.Element:
    """Parse a document; return its top element.

    Raises: DescriptionError: not well-formed; names the file and the line.
    """
    builder: Any = ET.TreeBuilder(element_factory=PlacedElement)
    parser = expat.ParserCreate(None, "}")
    parser.buffer_text = True

    def start(tag: str, attributes: dict[str, str]) -> None:
        named = {_expand_name(key): value for key, value in attributes.items()}
        element = builder.start(_expand_name(tag), named)
        element.file, element.line = file, parser.CurrentLineNumber

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: builder.end(_expand_name(tag))
    parser.CharacterDataHandler = builder.data
    try:
        data = text.encode() if isinstance(text, str) else recode_xml(text)
        parser.Parse(_declare_prefixes(_join_prefixes(data)), True)
    except (expat.ExpatError, LookupError, ValueError) as error:  # also an unknown encoding
        raise DescriptionError(f"{file}: not well-formed XML: {error}; fix that line") from error
    root: ET.Element = builder.close()
    return root


def _join_prefixes(text: bytes) -> bytes:
    """Write Gazebo's `gz::name`, which is no XML, as an element or attribute that is left alone."""
    return _GAZEBO_NAME.sub(lambda name: name[0].replace(b"::", b"-"), text)


def _declare_prefixes(text: bytes) -> bytes:
    """Declare prefixes such as `gz:`, which Gazebo takes without; what they name is left alone."""
    missing = {*_PREFIX.findall(text)} - {*_DECLARED.findall(text)} - _NEVER_DECLARED
    names = b"".join(b' xmlns:%s="urn:undeclared:%s"' % (one, one) for one in sorted(missing))
    return _FIRST_TAG.sub(lambda tag: tag[0] + names, text, count=1) if names else text


def read_xml(path: Path) -> ET.Element:
    """Read a document; return its top element.

    Raises: DescriptionError: no such file, or not well-formed.
    """
    try:
        text = path.read_bytes()
    except OSError as error:
        raise DescriptionError(f"{path} does not exist; check the path") from error
    return parse_xml(text, path.name)


def find_place(element: ET.Element) -> tuple[str, int]:
    """Return file and line; empty and 0 for an element that was not read from a file."""
    return getattr(element, "file", ""), getattr(element, "line", 0)


def copy_tree(element: ET.Element) -> ET.Element:
    """Copy an element with all below it, and their places."""
    copied = PlacedElement(element.tag, element.attrib)
    copied.text, copied.tail = element.text, element.tail
    copied.file, copied.line = find_place(element)
    copied.extend(map(copy_tree, element))
    return copied


def _expand_name(name: str) -> str:
    """Convert expat's `uri}name` to the spelling of ElementTree."""
    return "{" + name if "}" in name else name
