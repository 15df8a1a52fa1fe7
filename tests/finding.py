"""Facts in tests: what was found is compared by class, fields and numbers, never by its wording."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import msgspec
import pytest

from agribot.core.errors import MissionError
from agribot.core.facts import Fact
from agribot.record.events import Event

Kind = TypeVar("Kind", bound=Fact)
SHOWN = 0.0051  # half of the last decimal that a text shows


def list_facts(fact: Fact | None) -> Iterator[Fact]:
    """List a fact and those inside it, the nearest first."""
    if fact is not None:
        yield fact
        for inner in fact.inner:
            yield from list_facts(inner)


def find(fact: Fact | None, kind: type[Kind]) -> Kind:
    """Find the fact of a class in another one, or fail."""
    for one in list_facts(fact):
        if isinstance(one, kind):
            return one
    raise AssertionError(f"no {kind.__name__} in {fact}")


def is_like(found: object, wanted: object, within: float = SHOWN) -> bool:
    """Whether a value of a fact, or a fact, is as wanted; numbers may be off by `within`.

    `unittest.mock.ANY` in a field stands for any value of it.
    """
    if isinstance(wanted, Fact):
        pairs = ((getattr(found, name, None), value) for name, value in wanted.values)
        return type(found) is type(wanted) and all(is_like(*pair, within) for pair in pairs)
    if isinstance(wanted, tuple) and isinstance(found, tuple):
        same = (is_like(*pair, within) for pair in zip(found, wanted, strict=False))
        return len(found) == len(wanted) and all(same)
    if isinstance(wanted, float) and isinstance(found, float | int):
        is_nan = math.isnan(wanted) and math.isnan(found)
        return is_nan or math.isclose(found, wanted, rel_tol=0.0, abs_tol=within)
    return found == wanted


def holds(fact: Fact | None, *wanted: Fact | type[Fact], within: float = SHOWN) -> bool:
    """Whether each of these facts, or one of each of these classes, is the fact or inside it."""
    facts = tuple(list_facts(fact))
    return all(
        any(isinstance(one, each) if isinstance(each, type) else is_like(one, each, within)
            for one in facts)
        for each in wanted
    )  # fmt: skip


def list_codes(events: Iterable[Event]) -> set[str]:
    """List the codes of the facts of events, and of those inside them."""
    return {code for event in events for code in (event.code, *event.causes)}


@contextmanager
def refused(*wanted: Fact | type[Fact]) -> Iterator[None]:
    """Expect a MissionError with each of these facts, or one of each of these classes."""
    with pytest.raises(MissionError) as raised:
        yield
    assert holds(raised.value.fact, *wanted), raised.value.fact
    msgspec.json.encode(raised.value.fact)
