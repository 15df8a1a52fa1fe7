"""Text of tables as spreadsheets save it: its encoding, its separator and its decimal commas."""

from __future__ import annotations

import codecs
from collections.abc import Iterable

SEPARATORS = ",;\t"
_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


def find_encoding(chunks: Iterable[bytes]) -> str:
    """Find how bytes are text: as their mark says, else as UTF-8, else as Windows-1252.

    Raises: ValueError: they are no text.
    """
    decoder, is_utf8, is_first = codecs.getincrementaldecoder("utf-8")(), True, True
    for chunk in chunks:
        marked = next((name for mark, name in _MARKS.items() if chunk.startswith(mark)), "")
        if is_first and marked:
            return marked
        is_first = False
        if b"\0" in chunk:
            raise ValueError(
                "it is no text in UTF-8 or UTF-16 but holds zero bytes, as the workbook of a "
                "spreadsheet does; save it as CSV UTF-8"
            )
        try:
            decoder.decode(chunk)
        except UnicodeDecodeError:
            is_utf8 = False
    return "utf-8" if is_utf8 else "cp1252"


def decode_text(data: bytes) -> str:
    """Decode the text of a whole file.

    Raises: ValueError: it is none.
    """
    encoding = find_encoding([data])
    return data.decode(encoding, errors="replace" if encoding == "cp1252" else "strict")


def find_separator(header: str) -> str:
    """Find what separates the values of a table from its line of names: comma, semicolon or tab."""
    return max(SEPARATORS, key=header.count)


def read_decimal(text: str, separator: str) -> float:
    """Read a number; with a comma for its point where commas do not separate the values.

    Raises: ValueError: it is none.
    """
    is_comma = separator != "," and text.count(",") == 1 and "." not in text
    return float(text.replace(",", ".") if is_comma else text)
