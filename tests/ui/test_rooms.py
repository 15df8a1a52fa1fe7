"""The page's code stands in three rooms that meet in the modules above them, `wire` first."""

from __future__ import annotations

import re
from pathlib import Path

import agribot.ui

HOME = Path(agribot.ui.__file__).parent
ROOMS = ("robot_side", "server", "hand")
IMPORT = re.compile(r"^\s*(?:from|import) agribot\.ui\.(robot_side|server|hand)\b(.*)$", re.M)


def list_imports(files: list[Path]) -> set[tuple[str, str]]:
    """Who of these files imports a room, and which."""
    return {
        (file.stem, match[1])
        for file in files
        for match in IMPORT.finditer(file.read_text(encoding="utf-8"))
    }


def test_what_all_rooms_share_knows_none_of_them() -> None:
    assert list_imports(list(HOME.glob("*.py"))) == set()


def test_no_room_looks_into_another_but_to_start_the_server() -> None:
    for room in ROOMS:
        foreign = {
            (file, other)
            for file, other in list_imports(list((HOME / room).glob("*.py")))
            if other != room
        }
        assert foreign == ({("server_process", "server")} if room == "robot_side" else set())
