"""The only place that makes text of facts: one table for each language, read when it is needed.

A section of a table is the code of a fact: `text` says what is so, `do` what to do about it, each
one template or, where the fact has variants, one for each of them. A template names the fact's
fields as a format string does. Beside the formats of Python it knows `!d` (radians as degrees),
`!k` (metres as kilometres), `!m` (seconds as milliseconds) and `!l` (a list, divided by
semicolons). Words in a field are looked up in `words.<field>`; a fact in a field is rendered in its
place. `words.number.point` is what stands between a number and its decimals.
"""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from importlib.resources import files
from string import Formatter
from typing import Any

import msgspec

from agribot.core.facts import Fact, PluginFact

LANGUAGES = ("en", "de", "hi")
UNKNOWN = "?"  # a value that is not known
_SCALES = {"d": math.degrees(1.0), "k": 1e-3, "m": 1e3}

Template = str | dict[str, str]  # one, or one for each variant


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The texts of one fact."""

    text: Template
    do: Template = ""


class Table(msgspec.Struct, frozen=True):
    """The texts of a language."""

    facts: Mapping[str, Entry]
    words: Mapping[str, Mapping[str, str]]


@cache
def load_table(language: str) -> Table:
    """Read the table of a language.

    Raises: ValueError: there is no such table.
    """
    if language not in LANGUAGES:
        raise ValueError(f"no texts in '{language}'; choose one of {', '.join(LANGUAGES)}")
    text = files("agribot.core").joinpath(f"facts.{language}.toml").read_text("utf-8")
    sections = tomllib.loads(text)
    words = sections.pop("words")
    return Table(msgspec.convert(sections, dict[str, Entry]), words)


def render(fact: Fact | None, language: str = "en") -> str:
    """Make the text of a fact, and what to do about it; empty without a fact."""
    if fact is None:
        return ""
    text, advice = render_apart(fact, language)
    return f"{text}; {advice}" if advice else text


def render_apart(fact: Fact, language: str = "en") -> tuple[str, str]:
    """Make the text of a fact, and that of what to do about it, which may be empty."""
    if isinstance(fact, PluginFact) and (own := _find_of_package(fact, language)) is not None:
        return str(own.text), str(own.do)
    entry = load_table(language).facts[str(fact.__struct_config__.tag)]
    text = _fill(choose(entry.text, fact), fact, language)
    return text, _fill(choose(entry.do, fact), fact, language)


class _Amount:
    """A number that is formatted with the decimal point of a language."""

    def __init__(self, value: float, point: str) -> None:
        self._value, self._point = value, point

    def __format__(self, spec: str) -> str:
        return format(self._value, spec).replace(".", self._point)


@cache
def _load_texts(plugin: str, path: tuple[str, ...]) -> Any:
    """Import the texts of a package that is installed on `path`."""
    (point,) = entry_points(group="agribot.facts", name=plugin)
    return point.load()


def _find_of_package(fact: PluginFact, language: str) -> Entry | None:
    """Fill the texts that a package has for its fact, those in English where it lacks a language.

    None where it has none, or where they do not fit: a text must not end a run.
    """
    try:
        texts = _load_texts(fact.plugin, tuple(sys.path))
        entry = msgspec.convert((texts.get(language) or texts["en"])[fact.name], Entry)
        point = load_table(language).words["number"]["point"]
        amounts = {name: _Amount(value, point) for name, value in fact.amounts.items()}
        return Entry(str(entry.text).format(**amounts), str(entry.do).format(**amounts))
    except Exception:  # noqa: BLE001 (whatever is in a package of others)
        return None


def choose(template: Template, fact: Fact) -> str:
    """Choose the template of the fact's variant."""
    return template if isinstance(template, str) else template[fact.variant]


def _fill(template: str, fact: Fact, language: str) -> str:
    filled = []
    for literal, name, spec, conversion in _split(template):
        filled.append(literal)
        if name is not None:
            value = getattr(fact, name)
            filled.append(_write(value, name, spec or "", conversion, language))
    return "".join(filled)


@cache
def _split(template: str) -> tuple[tuple[str, str | None, str | None, str | None], ...]:
    return tuple(Formatter().parse(template))


def _write(value: Any, name: str, spec: str, conversion: str | None, language: str) -> str:
    """Write one value of a fact."""
    if isinstance(value, Fact):
        return render(value, language)
    if value is None:
        return UNKNOWN
    words = load_table(language).words
    known = words.get(name, {})
    if isinstance(value, str):
        return known.get(value, value)
    if isinstance(value, tuple):
        value = tuple(render(one, language) if isinstance(one, Fact) else one for one in value)
        return _join(value, known, "; " if conversion == "l" else f" {words['list']['and']} ")
    number = format(value if conversion is None else value * _SCALES[conversion], spec)
    return number.replace(".", words["number"]["point"])


def _join(values: tuple[Any, ...], known: Mapping[str, str], divider: str) -> str:
    """Join words, or take the word for all of them; numbers stand in brackets."""
    if not all(isinstance(value, str) for value in values):
        return str(list(values))
    together = known.get("+".join(values))
    each = [known.get(value, value) for value in values]
    return divider.join(each) if together is None else together
