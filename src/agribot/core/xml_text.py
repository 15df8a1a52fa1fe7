"""XML as editors save it: in another encoding than it declares, or with a line before its begin."""

from __future__ import annotations

import re

from agribot.core.table_text import recode_text

_DECLARED = re.compile(rb"""\s*<\?xml[^>]{0,100}?encoding\s*=\s*["']([^"']{1,40})""")
_DECLARATION = re.compile(rb"(\s*)(?:<\?xml[^>]{0,200}\?>)?")


def declares_other(data: bytes) -> bool:
    """Return whether XML declares an encoding other than Unicode, which its parser obeys."""
    declared = _DECLARED.match(data)
    return declared is not None and not declared[1].lower().startswith(b"utf")


def recode_xml(data: bytes) -> bytes:
    """Recode a document as UTF-8 without a declaration, unless it declares another encoding.

    Its lines keep their numbers.
    Raises: ValueError: it is no text.
    """
    if declares_other(data):
        return data.lstrip()
    return _DECLARATION.sub(rb"\1", recode_text(data), count=1)
