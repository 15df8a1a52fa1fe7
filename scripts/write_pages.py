"""Write every page that is made from the code: `python scripts/write_pages.py`, or `make pages`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import architecture_page
import board_messages_page
import commands_page
import facts_page
import faults_page
import files_page
import hazards_page
import index_page
import llms_page
import mission_page
import original_page
import presets_page
import python_page
import settings_page
import topics_page

ROOT = Path(__file__).parents[1]
# Where each lies, and what makes it.
PAGES: dict[str, Callable[[], str]] = {
    "docs/architecture.md": architecture_page.page,
    "docs/board-messages.md": board_messages_page.page,
    "docs/commands.md": commands_page.page,
    "docs/facts.md": facts_page.page,
    "docs/faults.md": faults_page.page,
    "docs/field-file.md": settings_page.field_page,
    "docs/files.md": files_page.page,
    "docs/hazards.md": hazards_page.page,
    "docs/mission.md": mission_page.page,
    "docs/original.md": original_page.page,
    "docs/presets.md": presets_page.page,
    "docs/results/original.csv": original_page.rows,
    "docs/python.md": python_page.page,
    "docs/settings.md": settings_page.page,
    "docs/topics.md": topics_page.page,
    # These have the first sentences of the pages above.
    "docs/index.md": index_page.page,
    "llms.txt": llms_page.page,
}


def main() -> None:
    for name, make in PAGES.items():
        (ROOT / name).write_text(make(), encoding="utf-8")


if __name__ == "__main__":
    main()
