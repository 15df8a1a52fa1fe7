"""What the robot did about the faults that were injected, read from its events.

A sign of a fault is, after it began: any stop or hold, a mission that pauses, fails or drives on
with a reservation, and a fault or a limit that names the part, alone or as one of two. One reported
before the fault began does not count, unless it names the part, and one that names the part of
another injected fault belongs to that one. The parts that a reason names are those of its fact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.core.facts import Said
from agribot.record.events import Event
from agribot.record.report import CrushedWhen, CrushReport, FaultReport, Reaction
from agribot.sim.faults.schedule import Fault, parse_fault
from agribot.sim.safety_judge import Crush

# Strongest first; what is said of a part alone comes last.
_STRENGTH: tuple[Reaction, ...] = ("stopped", "held", "slowed", "named")
_STOPPING = ("paused", "failed")
SETTLE_S = 0.5  # a robot that was set down stands still after this time
_SAID = Said.__struct_config__.tag


def judge_faults(texts: Sequence[str], events: Sequence[Event]) -> tuple[FaultReport, ...]:
    """Judge every fault that began; those that the run ended before are left out."""
    found = []
    faults = [parse_fault(text) for text in texts]
    for fault in faults:
        others = [other for other in faults if other.name != fault.name]
        begins = f"{fault.text} begins"
        for index, event in enumerate(events):
            if event.kind == "injected" and event.reason == begins:
                found.append(_judge(fault, others, event, events[:index], events[index + 1 :]))
                break
    return tuple(found)


def judge_crushes(
    texts: Sequence[str],
    found: Sequence[FaultReport],
    crushes: Sequence[Crush],
    stood_s: Sequence[float],
) -> tuple[CrushReport, ...]:
    """Judge when each crop was crushed: `found` are the verdicts on the faults `texts`.

    `stood_s` are the times at which the robot came to rest, those of a true clock, as of crushes.
    """
    handled = [
        (fault.begin_s, fault.handled_until_s + SETTLE_S)
        for fault in map(parse_fault, texts)
        if fault.handled_until_s is not None
    ]
    noticed_s = min((f.detected_s for f in found if f.detected_s is not None), default=math.inf)
    rested_s = min((t_s for t_s in stood_s if t_s >= noticed_s), default=math.inf)

    def find_when(t_s: float) -> CrushedWhen:
        if any(begin_s <= t_s <= end_s for begin_s, end_s in handled):
            return "by_fault"
        if t_s < noticed_s:
            return "before_detection"
        return "after_detection" if t_s < rested_s else "after_standstill"

    return tuple(CrushReport(t_s=c.t_s, by=c.by, when=find_when(c.t_s)) for c in crushes)


def _judge(
    fault: Fault,
    others: Sequence[Fault],
    begin: Event,
    before: Sequence[Event],
    after: Sequence[Event],
) -> FaultReport:
    known = {name_kind(event) for event in before}
    signs: list[tuple[Event, Reaction]] = []
    for event in after:
        reaction = _read_reaction(event)
        is_reaction = reaction in ("stopped", "held") or event.kind == "mission"
        is_new = is_reaction and name_kind(event) not in known
        is_anothers = any(_mentions(other, event) for other in others)
        if reaction != "none" and (_mentions(fault, event) or (is_new and not is_anothers)):
            signs.append((event, reaction))
    if not signs:
        return FaultReport(name=fault.name, t_s=fault.begin_s, fault=fault.text)
    is_named = any(_names(fault, others, event) for event, _ in signs)
    mentioning = [sign for sign in signs if _mentions(fault, sign[0])]
    strongest, _ = min(mentioning or signs, key=lambda sign: _STRENGTH.index(sign[1]))
    return FaultReport(
        name=fault.name,
        t_s=fault.begin_s,
        # The robot's own clock may have been stepped; what passed on it is right.
        detected_s=fault.begin_s + max(signs[0][0].t_s - begin.t_s, 0.0),
        reaction=min((reaction for _, reaction in signs), key=_STRENGTH.index),
        reason=strongest.reason,
        code=strongest.code,
        parts=strongest.parts,
        numbers=strongest.numbers,
        fault=fault.text,
        is_named=is_named,
        is_one_of_two=bool(mentioning) and not is_named,
    )


def _mentions(fault: Fault, event: Event) -> bool:
    """Whether a reason of the robot names the part at fault, alone or beside others."""
    return not set(event.parts).isdisjoint(fault.kind.accepted)


def _names(fault: Fault, others: Sequence[Fault], event: Event) -> bool:
    """Whether a reason names the part at fault and none that is well."""
    faulty = {part for each in (fault, *others) for part in each.kind.accepted}
    return _mentions(fault, event) and set(event.parts) <= faulty


def _read_reaction(event: Event) -> Reaction:
    if event.kind == "mission":
        slowed: Reaction = "slowed" if event.state == "running" and event.code else "none"
        return "stopped" if event.state in _STOPPING else slowed
    kinds: dict[str, Reaction] = {
        "stop": "stopped", "hold": "held", "limit": "slowed", "fault": "named",
    }  # fmt: skip
    return kinds.get(event.kind, "none")


def name_kind(event: Event) -> tuple[object, ...]:
    """Return what stays the same while numbers change; words only where there is no code."""
    codes = event.code, *event.causes
    words = event.reason if not event.code or _SAID in codes else ""
    return event.state if event.kind == "mission" else "", codes, event.parts, words
