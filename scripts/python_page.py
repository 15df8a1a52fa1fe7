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
next; all others may change. They are typed (`py.typed`): `help(agribot.Run)` has every type.
Methods are listed with the names of their parameters, modules without their constants.

"""


def members(thing: type) -> list[str]:
    """List the public methods and properties that a class itself adds, in their order."""
    shown = []
    for name, member in vars(thing).items():
        if name.startswith("_") or any(hasattr(base, name) for base in thing.__bases__):
            continue
        if isinstance(member, property):
            shown.append(f"- `{name}`{_first_line(member.fget)}\n")
        elif inspect.isfunction(member):
            shown.append(f"- `{name}({_parameters(member)})`{_first_line(member)}\n")
    return shown


def entry(name: str, thing: Any) -> str:
    words = inspect.getdoc(thing) or ""
    if isinstance(thing, ModuleType):
        names = [n for n in getattr(thing, "__all__", vars(thing)) if not n.startswith("_")]
        own = [n for n in names if n in getattr(thing, "__all__", ()) or _is_of(thing, n)]
        own = [n for n in own if not n.isupper()]
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
    """Whether a class or function is one of the module, or of those that it is made of."""
    home: str = getattr(getattr(module, name), "__module__", "")
    return home.startswith(module.__name__) and not isinstance(getattr(module, name), ModuleType)


class _Shown(str):
    """A default as it is shown."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


def _signature(function: Any) -> str:
    """Format the parameters as they stand in the code; a default that is an object as `...`."""
    signature = inspect.signature(function)
    parameters = [
        parameter.replace(default=_show_default(parameter.default))
        for parameter in signature.parameters.values()
    ]
    return str(signature.replace(parameters=parameters)).replace("'", "")


def _show_default(default: Any) -> Any:
    if isinstance(default, str):
        return _Shown(f'"{default}"')
    plain = (bool, int, float, type(None), tuple, type)
    return default if isinstance(default, plain) else _Shown("...")


def _parameters(method: Any) -> str:
    return ", ".join(name for name in inspect.signature(method).parameters if name != "self")


def _first_line(function: Any) -> str:
    words = (inspect.getdoc(function) or "").split("\n")[0]
    return f": {words[:1].lower()}{words[1:]}" if words else ""


def _first_paragraph(words: str) -> str:
    return words.split("\n\n", maxsplit=1)[0]


if __name__ == "__main__":
    sys.stdout.write(page())
