"""Messages to a page in its language: each text that has a fact beside it is written anew.

The facts stay here; where the page compares texts, it gets their kinds.
"""

from __future__ import annotations

import typing
from functools import cache
from typing import Any, NamedTuple, TypeVar

import msgspec
from starlette.requests import Request

from agribot.core.fact_text import LANGUAGES, render
from agribot.core.facts import Fact
from agribot.ui import wire

M = TypeVar("M", bound=msgspec.Struct)


class _Plan(NamedTuple):
    """Where a struct has facts: beside its own texts, by name, and in the structs that it holds."""

    texts: tuple[tuple[str, str], ...]
    inner: tuple[str, ...]
    missing: dict[str, Any]  # texts for a fact that is left out
    compared: frozenset[str]  # texts that a page compares


def find_language(wanted: str) -> str:
    """Find the language that a page asks for; English where there are no texts in it."""
    return wanted if wanted in LANGUAGES else LANGUAGES[0]


def language_of(request: Request) -> str:
    """Find the language of who sent a request, by the first that its header names."""
    return find_language(request.headers.get("accept-language", "")[:2].lower())


def say_in(language: str, message: M) -> M:
    """Write the texts of facts in a language, and leave the facts out."""
    plan = _plan(type(message))
    changes = {name: _say_inner(language, getattr(message, name)) for name in plan.inner}
    for text, name in plan.texts:
        fact = getattr(message, name)
        if isinstance(fact, Fact):
            changes |= {text: render(fact, language), name: plan.missing[name]}
            changes |= {text + wire.KINDS: fact.kinds} if text in plan.compared else {}
    return msgspec.structs.replace(message, **changes) if changes else message


def _say_inner(language: str, value: Any) -> Any:
    if isinstance(value, list):
        return [say_in(language, one) for one in value]
    return say_in(language, value) if isinstance(value, msgspec.Struct) else value


@cache
def _plan(struct: type[msgspec.Struct]) -> _Plan:
    fields = {field.name: field for field in msgspec.structs.fields(struct)}
    hints = typing.get_type_hints(struct)
    texts = [(name.removesuffix(wire.FACT), name) for name in fields if name.endswith(wire.FACT)]
    inner = [name for name in fields if not name.endswith(wire.FACT) and _has_facts(hints[name])]
    missing = {name: fields[name].default for _, name in texts}
    compared = frozenset(text for text, _ in texts if text + wire.KINDS in fields)
    return _Plan(tuple(texts), tuple(inner), missing, compared)


def _has_facts(hint: Any) -> bool:
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        plan = _plan(hint)
        return bool(plan.texts or plan.inner)
    return any(_has_facts(one) for one in typing.get_args(hint))
