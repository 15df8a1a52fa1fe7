"""Reasons of recordings from before facts: their texts as facts, so that they can be compared.

Text fields without a fact become `Said`, numbers left out, as one whose numbers change is still the
same reason. It is the only place that looks into such a text.
"""

from __future__ import annotations

import re
from typing import Any

import msgspec

from agribot.core.facts import Said
from agribot.core.messages import SensorVerdicts, TickRecord

_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


def lift_reasons(record: TickRecord) -> TickRecord:
    """Return a tick whose texts have facts beside them, where it was recorded without."""
    estimate = _lift(
        record.estimate,
        reason="fact", contradiction="contradiction_fact", plants_doubt="plants_fact",
        verdicts=_lift_verdicts(record.estimate.verdicts),
    )  # fmt: skip
    gate = record.status.gate
    checks = tuple(_lift(check, text="fact") for check in gate.checks)
    status = _lift(
        record.status,
        reason="fact", stopped="stopped_fact", held="held_fact", warning="warning_fact",
        refusal="refusal_fact",
        gate=_lift(gate, reason="fact", warning="warning_fact", checks=checks),
    )  # fmt: skip
    return _lift(record, reason="fact", estimate=estimate, status=status)  # type: ignore[no-any-return]


def _lift_verdicts(verdicts: SensorVerdicts) -> SensorVerdicts:
    return {name: _lift(verdict, reason="fact") for name, verdict in verdicts.items()}


def _lift(struct: Any, **fields: Any) -> Any:
    """Put facts beside texts, by the names of both; whatever is no name replaces the field."""
    changed = {}
    for name, value in fields.items():
        if not isinstance(value, str):
            changed[name] = value
        elif (text := getattr(struct, name)) and getattr(struct, value) is None:
            changed[value] = Said(_NUMBER.sub("#", text))
    return msgspec.structs.replace(struct, **changed) if changed else struct
