"""Print docs/architecture.md, drawn from docs/architecture.toml and from the imports in the code.

`python scripts/architecture_page.py > docs/architecture.md`; `make pages` writes all such pages.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "agribot"

HEAD = """# Architecture

Written by `make pages` from [`architecture.toml`](architecture.toml) and from the imports in the
code; `tests/test_architecture.py` holds the code to the same table.

A room is a folder of `src/agribot`. An import goes to the same room or to a lower floor: never up,
and never to another room of the same floor. The rooms marked *pure* hold decisions: no input or
output, no clock, no thread, no hidden dice. A wing is a folder of a room; it imports only wings
named before it.

"""
FLOW = """
## How a tick flows

```
            Platform: read() -> SensorBatch, write(RobotCommand), inbox, close()
            simulator | your own robot | a recording       (sensors may come from elsewhere)
                 |                                                      ^
   wheels, IMU, magnetometer, GNSS, frames, requests                    | drive, implement
                 v                                                      |
   ESTIMATE   Localizer.update(batch) -> Estimate                       |
                 |---> PLAN     Mission.step(estimate, events) -> Goal  |
                 |                 v                                    |
                 |     CONTROL  Follower.step(estimate, goal) -> SUPERVISE: the last gate, which
                 |                                            may only make a command safer
   PERCEIVE   frame -> class mask -> row line (to ESTIMATE) and plants on the ground
                 v
   WEEDS      WeedMap.add(scene) -> IMPLEMENT  Implement.step(estimate, plants) -> command
```

`autonomy/stack.py` is this on one page. Every tick ends as one `TickRecord`, which goes to the
taps: recording, page and bridges. They read; requests of people and programs come back through the
platform's inbox, so that a recording holds them and a replay repeats them.

## Facts

A fault, a doubt, a hazard or the cause of a stop is a typed value with a code, the parts at fault,
a severity and numbers (`core/facts`). Nothing inside compares text; `core/fact_text.py` makes it
at the edge, from one table for each language (`core/facts.en.toml` and others).

## Frames, time, units

The map is East-North-Up in metres with its origin at the field's datum; the body is x forward, y
left, z up, on the ground under the robot's centre (REP-103, REP-105); cameras are x right, y down,
z forward. Yaw runs counter-clockwise from East in (-pi, pi]; compass headings exist at the edge
only, as `compass_deg`. `t_s` is the time of capture on the platform's clock. The unit stands in
every name; transforms are named so that chains cancel: `map_from_body @ body_from_camera`.
"""


def read_rooms() -> list[dict[str, Any]]:
    text = (ROOT / "docs" / "architecture.toml").read_text(encoding="utf-8")
    rooms: list[dict[str, Any]] = tomllib.loads(text)["rooms"]
    return rooms


def table(rooms: list[dict[str, Any]]) -> str:
    """Format the rooms as a table in Markdown, lowest floor first."""
    lines = ["| floor | room | what lives there |\n", "|---|---|---|\n"]
    for room in sorted(rooms, key=lambda room: room["floor"]):
        pure = " *Pure.*" if room.get("is_pure") else ""
        wings = ", ".join(f"`{wing}`" for wing in room.get("wings", []))
        wings = f" Wings: {wings}." if wings else ""
        lines.append(f"| {room['floor']} | `{room['name']}/` | {room['about']}.{pure}{wings} |\n")
    return "".join(lines)


def arrows(rooms: list[dict[str, Any]]) -> dict[str, set[str]]:
    """Which rooms each room imports."""
    names = {room["name"] for room in rooms}
    found: dict[str, set[str]] = {name: set() for name in names}
    for path in sorted(SOURCE.rglob("*.py")):
        home = _room_of(path.relative_to(SOURCE).with_suffix("").parts, names)
        used = {_room_of(parts, names) for parts in _imports(path)}
        if home:
            found[home] |= used - {"", home}
    return found


def drawing(rooms: list[dict[str, Any]]) -> str:
    """Draw the house in Mermaid; an arrow that follows from two others is left out."""
    graph = arrows(rooms)
    lines = ["```mermaid\n", "flowchart BT\n"]
    for floor in sorted({room["floor"] for room in rooms}):
        lines.append(f'  subgraph floor{floor}["floor {floor}"]\n')
        lines += [f"    {_node(room['name'])}\n" for room in rooms if room["floor"] == floor]
        lines.append("  end\n")
    for home in sorted(graph):
        beyond = set().union(*(_reach(graph, used) for used in graph[home]))
        used = " & ".join(_key(name) for name in sorted(graph[home] - beyond))
        lines += [f"  {_key(home)} --> {used}\n"] if used else []
    return "".join([*lines, "```\n"])


def page() -> str:
    rooms = read_rooms()
    text = "An arrow points to what a room imports; one that follows from two others is left out.\n"
    return HEAD + table(rooms) + "\n" + text + "\n" + drawing(rooms) + FLOW


def _imports(path: Path) -> Iterator[tuple[str, ...]]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        yield from (tuple(name.split(".")[1:]) for name in names if name.startswith("agribot."))


def _room_of(parts: tuple[str, ...], names: set[str]) -> str:
    folders = ("/".join(parts[:length]) for length in range(len(parts), 0, -1))
    return next((folder for folder in folders if folder in names), "")


def _reach(graph: dict[str, set[str]], start: str) -> set[str]:
    """Every room below one, itself not included."""
    below: set[str] = set()
    for room in graph[start]:
        below |= {room} | _reach(graph, room)
    return below


def _node(name: str) -> str:
    return name if _key(name) == name else f'{_key(name)}["{name}"]'


def _key(name: str) -> str:
    return name.replace("/", "_")


if __name__ == "__main__":
    sys.stdout.write(page())
