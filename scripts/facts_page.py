"""Print docs/facts.md: every message of the robot with its code, from the table of texts.

`make pages` writes all such pages.
"""

from __future__ import annotations

import re
import sys
from itertools import groupby

from agribot.core.fact_text import Template, load_table
from agribot.core.facts import KINDS, Fact

HEAD = """# Messages and their codes

Written by `make pages` from the code. A message of the robot, on the page, in `events.jsonl` and
over ROS, is the text of a fact. Its code does not change; programs read that one.

After a *warning* the robot goes on; after a *fault* it must not, or not by itself. A word in
`this type` is a number or name (`_m`, `_s`, `_rad`: its unit). Of several texts of a fact the first
is here. Notes and answers to requests are left out ([all](../src/agribot/core/facts.en.toml)).
[Hazards](hazards.md) lists the reactions.
"""
# Modules of facts; those left out hold answers to requests and words of others.
TITLES = {
    "board": "Motor board, contactor, battery",
    "camera": "Camera and network",
    "clock": "Clock",
    "devices": "Devices and their lines",
    "gate": "The last gate before the motors",
    "health": "Health",
    "mission": "Mission",
    "position": "Position and heading",
    "sensors": "Sensors",
    "wheels": "Wheels",
}
COLUMNS = "| message | what to do | code, severity |\n|---|---|---|\n"
# A value in a template, without its format.
_VALUE = re.compile(r"\{(\w*)[^{}]*\}")


def page() -> str:
    shown = [kind for kind in KINDS if kind.severity != "note" and _name_module(kind) in TITLES]
    by_module = groupby(sorted(shown, key=_name_module), _name_module)
    return HEAD + "".join(_write_section(name, list(kinds)) for name, kinds in by_module)


def _name_module(kind: type[Fact]) -> str:
    return kind.__module__.rpartition(".")[2]


def _write_section(module: str, kinds: list[type[Fact]]) -> str:
    rows = "".join(map(_write_row, kinds))
    return f"\n## {TITLES[module]}\n\n{COLUMNS}{rows}"


def _write_row(kind: type[Fact]) -> str:
    code = str(kind.__struct_config__.tag)
    entry = load_table("en").facts[code]
    return f"| {_show(entry.text)} | {_show(entry.do)} | `{code}`, {kind.severity} |\n"


def _show(template: Template) -> str:
    """Show the first text of a fact, with the names of its values."""
    text = template if isinstance(template, str) else next(iter(template.values()))
    return _VALUE.sub(r"`\1`", text).replace("|", r"\|")


if __name__ == "__main__":
    sys.stdout.write(page())
