"""Facts: what is found at run time, as small typed values, from where it is found to the edge.

A fault, a doubt, a contradiction, a hazard, a stop's cause and a state's reason are each one
`Fact`: a frozen struct of a closed, tagged union (`AnyFact`). It says

- its `code`, which is its class's name in snake case and never changes its meaning,
- its `parts`: those of the robot that are at fault, more than one where it leaves open which,
  those of the facts inside it included; a part that it is only compared with is not among them,
- its `severity`, and
- numbers in fields that name their units.

`None` stands for "nothing found". Nothing inside the program compares, masks or parses text: two
facts are the same while their `kind` is, which leaves out the numbers, and what a fact is about is
asked by `parts`, its class or its code. `fact_text.render` alone makes text, from one table for
each language (`facts.en.toml` and others): at the edge, for the page, logs, reports, ROS and
the text fields of messages. A new fact is a class in one of these modules and a section in each
table; a test compares codes and placeholders.

`Said` holds words from outside (a person, a device, an error of a planner): nothing looks into it.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Union

# ruff: noqa: F403 F405 (these modules hold facts and the words of their fields alone)
from agribot.core.facts.base import *
from agribot.core.facts.board import *
from agribot.core.facts.camera import *
from agribot.core.facts.certificates import *
from agribot.core.facts.clock import *
from agribot.core.facts.devices import *
from agribot.core.facts.drives import *
from agribot.core.facts.fields import *
from agribot.core.facts.files import *
from agribot.core.facts.gate import *
from agribot.core.facts.health import *
from agribot.core.facts.mission import *
from agribot.core.facts.page import *
from agribot.core.facts.position import *
from agribot.core.facts.requests import *
from agribot.core.facts.sensors import *
from agribot.core.facts.starting import *
from agribot.core.facts.ways import *
from agribot.core.facts.wheels import *

if not TYPE_CHECKING:

    def _list_kinds(base: type[Fact]) -> list[type[Fact]]:
        found = []
        for kind in base.__subclasses__():
            found += _list_kinds(kind) or [kind]
        return found

    AnyFact = Union[tuple(_list_kinds(Fact))]  # noqa: UP007 (a type made at run time)
    for kind in AnyFact.__args__:  # msgspec looks for the types of fields in the module of a class
        sys.modules[kind.__module__].AnyFact = AnyFact

KINDS: tuple[type[Fact], ...] = tuple(AnyFact.__args__) if not TYPE_CHECKING else ()
