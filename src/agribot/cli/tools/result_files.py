"""Files of a campaign's result: its tables, and the page of documents that shows them."""

from __future__ import annotations

from pathlib import Path

from agribot.core.errors import MAKE_ROOM, ConfigError, explain_os_error
from agribot.core.whole_file import write_at_once
from agribot.lab.bench.fault_tables import rewrite_block


def read_page(path: Path, name: str) -> str:
    """Read a page, and check before anything is driven that the table has its place there."""
    try:
        page = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"--markdown {path}: cannot be read: {error}; name a page that exists"
        ) from error
    rewrite_block(page, name, "")
    return page


def write_result(path: Path, text: str) -> None:
    """Write a file whole. Raises: RecordingError: there is no room for it."""
    with explain_os_error(f"cannot write into {path.parent}", MAKE_ROOM):
        write_at_once(path, text.encode())
