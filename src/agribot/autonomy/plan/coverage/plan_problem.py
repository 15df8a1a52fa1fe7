"""What is wrong with a plan: the rule of the certificate that it breaks, the fact and the place."""

from __future__ import annotations

import math
from typing import Literal

import msgspec

from agribot.core.fact_text import render
from agribot.core.facts import AnyFact, Fact
from agribot.core.messages import FloatArray, MapPoint

Rule = Literal["path", "curvature", "footprint", "margin", "wheels", "crop", "coverage"]


class PlanProblem(msgspec.Struct, frozen=True, kw_only=True):
    """A broken rule and its place, NaN where it has none; `message` is the text of the fact."""

    rule: Rule
    message: str
    east_m: float = math.nan
    north_m: float = math.nan
    fact: AnyFact


def report(rule: Rule, fact: Fact) -> PlanProblem:
    return PlanProblem(rule=rule, message=render(fact), fact=fact)


def report_at(
    rule: Rule, kind: type[Fact], place: MapPoint | FloatArray, **values: object
) -> PlanProblem:
    """Report a fact with these values, which states the place, too."""
    at = {"east_m": float(place[0]), "north_m": float(place[1])}
    return msgspec.structs.replace(report(rule, kind(**values, **at)), **at)
