"""Print docs/python.md: the public API, as `import agribot` offers it.

`make pages` writes all such pages.
"""

from __future__ import annotations

import inspect
import sys
from types import ModuleType
from typing import Any

import agribot

HEAD = """# Python API

Written by `make pages` from the code. These names keep their meaning from one minor version to the
next; all others may change. They are typed (`py.typed`).

"""


def members(thing: type) -> list[str]:
    """List the public methods and properties that a class itself declares, in their order."""
    shown = []
    for name, member in vars(thing).items():
        if name.startswith("_"):
            continue
        if isinstance(member, property):
            shown.append(f"- `{name}`{_first_line(member.fget)}\n")
        elif inspect.isfunction(member):
            shown.append(f"- `{name}{_signature(member)}`{_first_line(member)}\n")
    return shown


def entry(name: str, thing: Any) -> str:
    words = inspect.getdoc(thing) or ""
    if isinstance(thing, ModuleType):
        names = [n for n in getattr(thing, "__all__", vars(thing)) if not n.startswith("_")]
        own = [n for n in names if not isinstance(getattr(thing, n), ModuleType)]
        own = [n for n in own if n in getattr(thing, "__all__", ()) or _is_of(thing, n)]
        listed = ", ".join(f"`{n}`" for n in own)
        return f"## agribot.{name}\n\n{_first_paragraph(words)}\n\n{listed}\n\n"
    if isinstance(thing, type):
        fields = getattr(thing, "__struct_fields__", ())
        listed = f"Fields: {', '.join(f'`{field}`' for field in fields)}\n\n" if fields else ""
        below = "".join(members(thing))
        return f"## agribot.{name}\n\n{words}\n\n{listed}{below}\n"
    return f"## agribot.{name}\n\n```python\n{name}{_signature(thing)}\n```\n\n{words}\n\n"


def page() -> str:
    return HEAD + "".join(
        entry(name, getattr(agribot, name)) for name in agribot.__all__ if name != "__version__"
    )


def _is_of(module: ModuleType, name: str) -> bool:
    return getattr(getattr(module, name), "__module__", "").startswith("agribot") or name.isupper()


def _signature(function: Any) -> str:
    """As it stands in the code, whatever version of Python prints it."""
    return str(inspect.signature(function)).replace("'", "")


def _first_line(function: Any) -> str:
    words = (inspect.getdoc(function) or "").split("\n")[0]
    return f": {words[:1].lower()}{words[1:]}" if words else ""


def _first_paragraph(words: str) -> str:
    return words.split("\n\n", maxsplit=1)[0]


if __name__ == "__main__":
    sys.stdout.write(page())
