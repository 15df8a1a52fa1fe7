"""Text as editors and spreadsheets save it: its encoding, and of tables separator and commas."""

from __future__ import annotations

import codecs
from collections.abc import Iterable, Iterator
from pathlib import Path

SEPARATORS = ",;\t"
CHUNK_BYTES = 1 << 20
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
                "spreadsheet does; save it as text in UTF-8, a table as CSV UTF-8"
            )
        try:
            decoder.decode(chunk)
        except UnicodeDecodeError:
            is_utf8 = False
    return "utf-8" if is_utf8 else "cp1252"


def read_text_file(path: Path) -> str:
    """Read a text that somebody else wrote, with any encoding and line ends.

    Raises: OSError: the file cannot be read. ValueError: it is no text.
    """
    return decode_text(path.read_bytes())


def decode_text(data: bytes) -> str:
    """Decode the text of a whole file; its lines end with a line feed.

    Raises: ValueError: it is not text.
    """
    encoding = find_encoding(_split(data))
    text = data.decode(encoding, errors="replace" if encoding == "cp1252" else "strict")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def recode_text(data: bytes) -> bytes:
    """Recode the text of a whole file as UTF-8 without a mark; a large file that is so stays one.

    Raises: ValueError: it is no text.
    """
    encoding = find_encoding(_split(data))
    if encoding in {"utf-8", "utf-8-sig"}:
        return data.removeprefix(codecs.BOM_UTF8)
    return decode_text(data).encode()


def _split(data: bytes) -> Iterator[bytes]:
    return (data[at : at + CHUNK_BYTES] for at in range(0, len(data), CHUNK_BYTES))


def find_separator(header: str) -> str:
    """Find what separates the values of a table from its line of names: comma, semicolon or tab."""
    return max(SEPARATORS, key=header.count)


def names_separator(line: str) -> bool:
    """Return whether a line names the separator alone, as Excel's `sep=;` before the names does."""
    return line.strip().strip('"').lower() in {f"sep={one}".strip() for one in SEPARATORS}


def read_decimal(text: str, separator: str) -> float:
    """Read a number; with a comma for its point where commas do not separate the values.

    Raises: ValueError: it is not a number.
    """
    is_comma = separator != "," and text.count(",") == 1 and "." not in text
    return float(text.replace(",", ".") if is_comma else text)
