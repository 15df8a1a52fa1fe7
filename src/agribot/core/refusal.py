"""The fact that something was refused for."""

from __future__ import annotations

from agribot.core.errors import AgribotError, MissionError
from agribot.core.facts import AnyFact, Said


def find_fact(error: AgribotError) -> AnyFact:
    """Return the fact of an error; of one without a fact, its words."""
    return error.fact if isinstance(error, MissionError) else Said(str(error))
