"""Write the page's side of the wire: `python scripts/generate_wire.py` (or `make generate`).

`web/src/wire.ts` has the messages and bodies of `src/agribot/ui/wire.py` as TypeScript, and
`web/src/screens/index.ts` imports the screens that are listed there.
"""

from __future__ import annotations

import inspect
import types
import typing
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec
from msgspec import UnsetType

from agribot.core.messages import PlantClass
from agribot.ui import wire

ROOT = Path(__file__).parents[1]
WIRE, SCREENS = "web/src/wire.ts", "web/src/screens/index.ts"
NOTE = "Written by `make generate` from `src/agribot/ui/wire.py`: change that one."
PLAIN = {float: "number", int: "number", bool: "boolean", str: "string", type(None): "null",
         Any: "unknown", PlantClass: "number"}  # fmt: skip
LINE_LETTERS = 120

Struct = type[msgspec.Struct]


def write_files(root: Path = ROOT) -> dict[Path, str]:
    """Make the text of every generated file, by its path below `root`."""
    return {root / WIRE: write_wire(), root / SCREENS: write_screens(wire.SCREENS)}


def write_screens(names: Sequence[str]) -> str:
    imports = [f"import {{ {name} }} from './{name}.ts'" for name in sorted(names)]
    return "\n".join([
        f"/** {NOTE} */",
        "",
        "import type { Screen } from '../app.ts'",
        *imports,
        "",
        "/** Every screen in the order of the rail; the first four are the tabs of a phone. */",
        *_write_list("export const SCREENS: Screen[] = ", names),
        "",
    ])  # fmt: skip


def _write_list(head: str, items: Sequence[str]) -> list[str]:
    """As the page's formatter writes it: on one line where it has room there."""
    line = f"{head}[{', '.join(items)}]"
    return (
        [line] if len(line) <= LINE_LETTERS else [f"{head}[", *(f"  {one}," for one in items), "]"]
    )


def write_wire() -> str:
    aliases, structs = _find_used()
    names = Names(aliases)
    parts = [
        f"/** {NOTE} SI units; the map is East-North-Up. */",
        *(names.write_alias(name) for name in aliases),
        *(names.write_struct(struct) for struct in structs),
        _write_constants(),
    ]
    return "\n\n".join(parts) + "\n"


class Names:
    """Types by the names that `wire.py` gives them."""

    def __init__(self, aliases: Iterable[str]) -> None:
        self._aliases = {name: getattr(wire, name) for name in aliases}

    def write_alias(self, name: str) -> str:
        members = self._members(self._aliases[name], but=name)
        line = f"export type {name} = {' | '.join(members)}"
        if len(line) <= LINE_LETTERS:
            return line
        return "\n".join([f"export type {name} =", *(f"  | {member}" for member in members)])

    def write_struct(self, struct: Struct) -> str:
        config, fields = struct.__struct_config__, _fields_of(struct)
        lines = [*_write_comment(struct), f"export interface {struct.__name__} {{"]
        if config.tag is not None:
            lines.append(f"  kind: '{config.tag}'")
        sent = struct in SENT
        lines += [
            self._write_field(name, hint, sent and has_default)
            for name, hint, has_default in fields
        ]
        lines.append("}")
        if config.array_like:
            lines += self._write_row(struct.__name__, fields)
        return "\n".join(lines)

    def _write_field(self, name: str, hint: Any, is_optional: bool) -> str:
        is_unset = UnsetType in typing.get_args(hint)
        return f"  {name}{'?' if is_optional or is_unset else ''}: {self.write(hint)}"

    def _write_row(self, name: str, fields: list[tuple[str, Any, bool]]) -> list[str]:
        """Write the columns of a struct that crosses as a row, and the struct from them."""
        columns = [f"{column}: {self.write(hint)}" for column, hint, _ in fields]
        values = [f"    {column}: row[{number}]," for number, (column, _, _) in enumerate(fields)]
        return [
            "", *_write_list(f"export type {name}Row = ", columns), "",
            f"export function read{name}(row: {name}Row): {name} {{",
            "  return {", *values, "  }", "}",
        ]  # fmt: skip

    def write(self, hint: Any) -> str:
        return " | ".join(self._members(hint))

    def _members(self, hint: Any, but: str = "") -> list[str]:
        for name, alias in self._aliases.items():
            if name != but and hint == alias:
                return [name]
        origin, inner = typing.get_origin(hint), typing.get_args(hint)
        if origin is Literal:
            return [f"'{value}'" for value in inner]
        if origin in (typing.Union, types.UnionType):
            return self._fold(inner, but)
        return [self._write_one(hint, origin, inner)]

    def _fold(self, inner: tuple[Any, ...], but: str) -> list[str]:
        """Members of a union, those of a smaller one that has a name by that name."""
        left, found = [one for one in inner if one is not UnsetType], list[str]()
        for name, alias in self._aliases.items():
            members = typing.get_args(alias)
            is_union = typing.get_origin(alias) in (typing.Union, types.UnionType, Literal)
            if name != but and is_union and members and set(members) <= set(left):
                left = [one for one in left if one not in members]
                found.append(name)
        return [*found, *(member for one in left for member in self._members(one, but))]

    def _write_one(self, hint: Any, origin: Any, inner: tuple[Any, ...]) -> str:
        if origin is list or (origin is tuple and inner[1:] == (...,)):
            one = self.write(inner[0])
            return f"({one})[]" if " " in one else f"{one}[]"
        if origin is tuple:
            return f"[{', '.join(map(self.write, inner))}]"
        if origin is dict:
            return f"Record<{self.write(inner[0])}, {self.write(inner[1])}>"
        if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
            return hint.__name__ + ("Row" if hint.__struct_config__.array_like else "")
        return PLAIN[hint]


SENT = {*typing.get_args(wire.PageMessage), *wire.SENT_BODIES}


def _find_used() -> tuple[list[str], list[Struct]]:
    """Aliases and structs that a page knows, in the order of `wire.py`."""
    structs: dict[Struct, None] = {}
    hints: list[Any] = [wire.PageMessage, wire.ServerMessage, *wire.SENT_BODIES, *wire.READ_BODIES]
    seen: list[Any] = []
    while hints:
        hint = hints.pop()
        seen.append(hint)
        if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
            if hint not in structs:
                structs[hint] = None
                hints += [inner for _, inner, _ in _fields_of(hint)]
        else:
            hints += [inner for inner in typing.get_args(hint) if not isinstance(inner, str)]
    named = {
        n: v for n, v in vars(wire).items() if n[0].isupper() and typing.get_origin(v) is not None
    }
    roots = {"PageRequest", "Growth"}
    aliases = [name for name, alias in named.items() if alias in seen or name in roots]
    return aliases, [one for one in vars(wire).values() if _is_struct(one) and one in structs]


def _is_struct(one: Any) -> bool:
    return isinstance(one, type) and issubclass(one, msgspec.Struct)


def _fields_of(struct: Struct) -> list[tuple[str, Any, bool]]:
    """Name, type and whether it may be left out; facts stay in the server."""
    hints = typing.get_type_hints(struct)
    return [
        (field.name, hints[field.name], not field.required)
        for field in msgspec.structs.fields(struct)
        if not field.name.endswith(wire.FACT)
    ]


def _write_comment(struct: Struct) -> list[str]:
    text = inspect.cleandoc(struct.__doc__ or "")
    if not text:
        return []
    lines = text.splitlines()
    if len(lines) == 1:
        return [f"/** {text} */"]
    return ["/**", *(f" * {line}".rstrip() for line in lines), " */"]


def _write_constants() -> str:
    kinds = [f"'{one.__struct_config__.tag}'" for one in typing.get_args(wire.ServerMessage)]
    lines = [
        "/** The kinds of messages that a server sends. */",
        *_write_list("export const SERVER_KINDS: readonly string[] = ", kinds),
        "",
        f"export const CAMERA_HEAD_BYTES = {wire.CAMERA_HEAD.size}",
    ]
    return "\n".join(lines)


def main() -> None:
    for path, text in write_files().items():
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
