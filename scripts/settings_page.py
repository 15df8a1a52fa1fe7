"""Print docs/settings.md: every setting of a run, and every key of a FIELD.toml.

Types, limits and defaults are those of the structs in the code; the words are their docstrings
and the comments that stand beside the fields. `make pages` writes all such pages.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec
from msgspec import inspect as types

from agribot.core.config import RunConfig
from agribot.description import field_settings

HEAD = """# Settings

Written by `make pages` from the code. A profile (`agribot run PROFILE`) is a TOML file of these
settings, and `--set GROUP.NAME=VALUE` changes one; `config.toml` in the folder of a run holds all
of them. An unknown name or a value out of range is refused.

Units stand in the names: `_m` metres, `_mps` metres per second, `_rad` radians, `_deg` degrees,
`_s` seconds, `_std_` one sigma; points are East and North in the map. The values that a setting
may have stand in parentheses behind its default; one with `-` is not set.

"""
FIELD_HEAD = """# FIELD.toml

Written by `make pages` from the code. `agribot world generate FIELD.toml` grows a field with these
keys; [the packaged ones](../src/agribot/description/fields) are examples.

"""

NAMES: dict[type, str] = {
    types.BoolType: "true/false",
    types.StrType: "text",
    types.DictType: "table",
}
# Kinds that the default shows.
PLAIN = {"true/false", "text", "number", "table"}


class Setting(NamedTuple):
    """One line of a table."""

    name: str
    kind: str
    default: str
    words: str


def settings_of(struct: type[msgspec.Struct]) -> Iterator[Setting]:
    """List the plain settings of one struct; groups within it are left out."""
    words = comments_of(struct)
    for field in msgspec.structs.fields(struct):
        if is_group(field.type):
            continue
        default = field.default
        if default is msgspec.NODEFAULT:
            default = (
                None if field.default_factory is msgspec.NODEFAULT else field.default_factory()
            )
        kind = describe(types.type_info(field.type))
        yield Setting(field.name, kind, _show(default), words.get(field.name, ""))


def groups_of(struct: type[msgspec.Struct]) -> Iterator[tuple[str, type[msgspec.Struct]]]:
    for field in msgspec.structs.fields(struct):
        if is_group(field.type):
            yield field.name, field.type


def is_group(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct) and kind.__name__ != "Datum"


def comments_of(struct: type[msgspec.Struct]) -> dict[str, str]:
    """Read the comment above or behind each field, with what it inherits."""
    source = inspect.getsource(struct)
    lines = source.splitlines()
    (tree,) = ast.parse(source).body
    assert isinstance(tree, ast.ClassDef)
    found: dict[str, str] = {}
    for node in tree.body:
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        _, _, behind = lines[(node.end_lineno or node.lineno) - 1].partition("  # ")
        above: list[str] = []
        number = node.lineno - 2
        while number >= 0 and lines[number].lstrip().startswith("# "):
            above.insert(0, lines[number].strip()[2:])
            number -= 1
        found[node.target.id] = " ".join([*above, behind]).strip()
    return found


def describe(kind: types.Type) -> str:
    """Describe a type and its limits, such as "> 0, ≤ 2" of a number."""
    match kind:
        case types.Metadata():
            words = describe(kind.type)
        case types.UnionType():
            parts = [part for part in kind.types if not isinstance(part, types.NoneType)]
            words = " or ".join(describe(part) for part in parts)
        case types.TupleType():
            words = "(" + ", ".join(describe(part) for part in kind.item_types) + ")"
        case types.VarTupleType():
            words = f"list of {describe(kind.item_type)}"
        case types.LiteralType():
            words = ", ".join(f"`{value}`" for value in kind.values)
        case types.StructType():
            words = "{" + ", ".join(field.name for field in kind.fields) + "}"
        case types.FloatType() | types.IntType():
            name = "number" if isinstance(kind, types.FloatType) else "whole number"
            words = _limits(kind) or name
        case _:
            words = NAMES[type(kind)]
    return words


def _limits(kind: types.FloatType | types.IntType) -> str:
    if kind.ge is not None and kind.le is not None:
        return f"{kind.ge:g}…{kind.le:g}"
    signs = ((">", kind.gt), ("≥", kind.ge), ("<", kind.lt), ("≤", kind.le))
    return ", ".join(f"{sign}{limit:g}" for sign, limit in signs if limit is not None)


def _show(value: Any) -> str:
    if value is None or value == "":
        return "-"
    if isinstance(value, msgspec.Struct):
        value = msgspec.to_builtins(value)
    return "`" + msgspec.json.encode(value).decode() + "`"


def table(struct: type[msgspec.Struct], prefix: str = "") -> str:
    lines = ["| setting | default (values) | what |\n", "|---|---|---|\n"]
    for setting in settings_of(struct):
        words = setting.words[:1].upper() + setting.words[1:]
        values = setting.default + _show_values(setting)
        lines.append(f"| `{prefix}{setting.name}` | {values} | {words} |\n")
    return "".join(lines)


def _show_values(setting: Setting) -> str:
    """Format the values that a setting may have, where its default does not show them."""
    if setting.kind in PLAIN or setting.kind.startswith("{"):
        return ""
    return f" {setting.kind}" if setting.kind.startswith("(") else f" ({setting.kind})"


def sections(struct: type[msgspec.Struct]) -> str:
    """Format a table of what stands at the top, and one for each group."""
    text = table(struct)
    for name, group in groups_of(struct):
        words = inspect.cleandoc(group.__doc__ or "")
        words = f"{words}\n\n" if words else ""
        text += f"\n## {name}\n\n{words}{table(group, f'{name}.')}"
    return text


def page() -> str:
    return HEAD + sections(RunConfig)


def field_page() -> str:
    return FIELD_HEAD + sections(field_settings.FieldSettings)


if __name__ == "__main__":
    sys.stdout.write(page())
