"""The error of a request or a way that is refused for a fact."""

from __future__ import annotations

from agribot.core.errors import AgribotError, MissionError
from agribot.core.fact_text import render
from agribot.core.facts import AnyFact, Said


class MissionRefusal(MissionError):
    """Why there is no such way; its text is that of the fact."""

    def __init__(self, fact: AnyFact) -> None:
        super().__init__(render(fact))
        self.fact = fact


def find_fact(error: AgribotError) -> AnyFact:
    """Return what an error was raised for; of another than a refusal, its words."""
    return error.fact if isinstance(error, MissionRefusal) else Said(str(error))
