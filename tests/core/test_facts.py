"""Facts: codes, parts, numbers, what makes two the same, and their texts in each language."""

from __future__ import annotations

import ast
import math
import typing
from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path
from string import Formatter
from typing import Any

import msgspec
import pytest

import agribot
from agribot.core import facts
from agribot.core.fact_text import LANGUAGES, Template, load_table, render
from agribot.core.facts import (
    KINDS,
    AnyFact,
    BatteryLow,
    CameraAndGnssDisagree,
    ComesAndGoes,
    ContactorSilent,
    DeadReckoning,
    Fact,
    GnssJumped,
    GnssSilent,
    HeadingUnknown,
    InputSilent,
    NoPosition,
    RowsUnproven,
    RowUnproven,
    Said,
    SensorSilent,
    StoppedBy,
    StopToClear,
    WheelsWrong,
    find_kind,
)

ROOT = Path(agribot.__file__).parent
LOST = NoPosition(DeadReckoning(GnssSilent(3.02), 0.31, 0.3, is_lost=True))


def test_a_fact_knows_its_code_the_parts_at_fault_and_its_numbers() -> None:
    jumped = GnssJumped(0.4)
    assert (jumped.code, jumped.parts, jumped.severity) == (
        "gnss_jumped", ("gnss", "robot"), "fault",
    )  # fmt: skip
    assert LOST.causes == ("dead_reckoning", "gnss_silent")
    assert LOST.parts == ("gnss",), "those of the facts inside it"
    assert LOST.numbers == {"silent_s": 3.02, "std_m": 0.31, "limit_m": 0.3}
    assert SensorSilent("imu", math.inf, 1.0, "cable").numbers == {"limit_s": 1.0}
    assert InputSilent("red button", 1.0, 0.3).parts == ("inputs", "button")
    rows = RowsUnproven(rows=(RowUnproven(2, 4.0), RowUnproven(3)))
    assert (rows.causes, rows.numbers) == (("row_unproven",) * 2, {"more": 0.0})


def test_two_facts_are_the_same_while_only_their_numbers_change() -> None:
    assert GnssJumped(0.4).kind == GnssJumped(0.6).kind != GnssSilent(0.4).kind
    one, other = SensorSilent("imu", 1.0, 0.3, "imu"), SensorSilent("gnss", 1.0, 0.3, "gnss")
    assert one.kind != other.kind
    assert StopToClear(GnssJumped(1.0)).holds(GnssJumped(2.0))
    assert not StopToClear(GnssJumped(1.0)).holds(GnssSilent(2.0))
    told, asked = (CameraAndGnssDisagree(0.4, is_left_open=is_open) for is_open in (False, True))
    assert find_kind(told) == find_kind(asked) != find_kind(None)


@pytest.mark.wording
@pytest.mark.parametrize(
    "name", ["", "mark", "sensors", "the lost row", "{off_m}", "stopped by Ann; 3 m"]
)
def test_a_name_is_a_name_and_nothing_else(name: str) -> None:
    stopped = StoppedBy(name)
    assert (stopped.code, stopped.parts, stopped.numbers) == ("stopped_by", (), {})
    assert render(stopped) == f"stopped by {name}"


def test_facts_are_read_back_from_a_recording_as_they_were() -> None:
    for fact in (LOST, WheelsWrong(("left_wheel_F",), "stand", math.nan, 4.3), Said("x", "Ann")):
        data = msgspec.msgpack.encode(fact)
        assert repr(msgspec.msgpack.decode(data, type=AnyFact)) == repr(fact)


@pytest.mark.wording
@pytest.mark.parametrize(
    ("fact", "text"),
    [
        (LOST, "no position: GNSS silent for 3.0 s, dead reckoning with 0.31 m > 0.30 m; check "
         "antenna, sky view and receiver"),
        (HeadingUnknown(True, 3.0, 1.25, math.radians(12.0)), "no heading yet, known to 12 deg "
         "after 1.2 m, the magnetometer is silent; drive 3 m straight ahead by hand, or start on "
         "a mark with field.start_yaw_deg"),
        (WheelsWrong(("right_wheel_R", "right_wheel_F"), "stand", 0.04, 4.3),
         "right wheels do not turn: 0.0 rad/s instead of 4.3; check motor, gear and encoder"),
        (WheelsWrong(typing.get_args(facts.Wheel), "fast", 8.9, 0.0),
         "wheels turn too fast: 8.9 rad/s instead of 0.0; check motor, gear and encoder"),
        (BatteryLow(left_v=20.5, limit_v=21.0),
         "battery low: 20.5 V left, less than 21 V; charge it"),
        (ComesAndGoes("left_wheel_F", 3, 10.0, 0.31),
         "left front encoder: 3 short dropouts within 10 min, the longest of 0.31 s; check its "
         "plug and cable before they fail for good"),
        (None, ""),
    ],
)  # fmt: skip
def test_the_english_text_says_the_fact_and_what_to_do(fact: Fact | None, text: str) -> None:
    assert render(fact) == text


@pytest.mark.wording
def test_the_same_fact_in_another_language_has_the_same_numbers() -> None:
    silent = ContactorSilent(0.52, 0.3)
    assert render(silent, "de") == (
        "das Schütz antwortet nicht: seit 0,52 s > 0,30 s stumm; Leitung und Stecker prüfen"
    )
    slow = WheelsWrong(("right_wheel_R", "left_wheel_F"), "slow", 1.25, 4.3)
    assert render(slow, "hi") == (
        "पीछे दाएँ और आगे बाएँ वाले पहिए बहुत धीरे घूमते हैं: 4.3 की जगह 1.2 rad/s; मोटर, गियर और एन्कोडर जाँचें"
    )
    with pytest.raises(ValueError, match=r"no texts in 'xx'; choose one of en, de, hi"):
        render(silent, "xx")


def list_fields(template: Template) -> set[str]:
    texts = [template] if isinstance(template, str) else list(template.values())
    return {name for text in texts for _, name, _, _ in Formatter().parse(text) if name}


@pytest.mark.wording
@pytest.mark.parametrize("language", LANGUAGES)
def test_each_language_has_every_fact_with_the_same_variants_and_fields(language: str) -> None:
    english, table = load_table("en").facts, load_table(language).facts
    assert set(table) == {kind.__struct_config__.tag for kind in KINDS}
    for kind in KINDS:
        code = str(kind.__struct_config__.tag)
        entry, original = table[code], english[code]
        named = list_fields(entry.text) | list_fields(entry.do)
        assert named <= set(kind.__struct_fields__), code
        assert named == list_fields(original.text) | list_fields(original.do), code
        for mine, theirs in ((entry.text, original.text), (entry.do, original.do)):
            if isinstance(mine, dict) and isinstance(theirs, dict):
                assert set(mine) == set(theirs), code


@pytest.mark.wording
@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_a_language_has_its_own_word_for_each_that_a_text_takes(language: str) -> None:
    table = load_table(language)
    for kind in KINDS:
        entry = table.facts[str(kind.__struct_config__.tag)]
        for name in list_fields(entry.text) | list_fields(entry.do):
            words = list_words(read_hints(kind)[name])
            assert words <= set(table.words.get(name, ())), (kind, name)


@cache
def read_hints(kind: type[Fact]) -> dict[str, Any]:
    return typing.get_type_hints(kind, vars(facts))


def list_words(hint: Any) -> set[str]:
    """The words that a field takes, where they are few."""
    if typing.get_origin(hint) is typing.Literal:
        return set(typing.get_args(hint))
    return set().union(*map(list_words, typing.get_args(hint)))


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_fact_has_a_text_for_each_value_of_its_fields(language: str) -> None:
    for kind in KINDS:
        for fact in list_samples(kind):
            assert render(fact, language), fact


def list_samples(kind: type[Fact]) -> list[Fact]:
    """Make facts of a class with every word that its fields take, and both truths."""
    samples: list[dict[str, Any]] = [{}]
    for name, hint in read_hints(kind).items():
        if name in kind.__struct_fields__:
            samples = [{**one, name: value} for one in samples for value in list_values(hint)]
    return [kind(**one) for one in samples]


def list_values(hint: Any) -> list[Any]:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if GnssSilent in args:
        return [GnssSilent(1.0), *([None] if type(None) in args else [])]
    if isinstance(hint, type) and issubclass(hint, Fact):
        return list_samples(hint)
    if origin is typing.Literal:
        return list(args)
    if origin is tuple:
        one, *_ = list_values(args[0])
        return [(), (one,), (one, one)]
    if args:  # of a union with None
        return [value for each in args for value in list_values(each)][:3]
    plain: dict[Any, list[Any]] = {
        float: [1.0, 0.0], int: [1, 2], str: ["word"], bool: [False, True], type(None): [None],
    }  # fmt: skip
    return plain[hint]


TEXTS = frozenset(
    {"reason", "stopped", "held", "warning", "contradiction", "plants_doubt", "refusal",
     "trouble"}
)  # fmt: skip
NAMES = frozenset({"reason", "refusal", "why"})  # of variables that hold one
OPERATIONS = frozenset(
    {"startswith", "endswith", "split", "rsplit", "splitlines", "partition", "rpartition", "find",
     "rfind", "index", "rindex", "count", "removeprefix", "removesuffix", "replace", "translate",
     "strip", "lstrip", "rstrip", "lower", "upper", "casefold", "title", "capitalize", "swapcase",
     "sub", "subn", "match", "search", "fullmatch", "findall", "finditer"}
)  # fmt: skip
# Where a text is still looked into, and why it may be; the list may only become shorter.
LOOKED_INTO = {
    "autonomy/weeds/map.py": "of a plant that was left: the number of one of the implement's words",
    "cli/run/teleop.py": "it is shortened for a line of the terminal",
    "lab/bench/fault_rows.py": "of reports: why a run ended, which has no fact",
    "record/localization/page.py": "of results: the word ok",
    "ui/server/app.py": "a refused connection has room for this many letters",
    "ui/server/sockets.py": "a closing frame takes 120 letters",
}
# Where texts are made inside the program: fields of messages that others read, refusals, and the
# line of a board in a terminal.
RENDERED = frozenset(
    {
        "app/localization/log_pictures.py", "app/stop_memory.py",
        "autonomy/control/gate_machine.py", "autonomy/control/hazards.py",
        "autonomy/estimate/localizer.py", "autonomy/estimate/verdicts.py",
        "autonomy/perceive/plants.py",
        "autonomy/plan/coverage/plan_problem.py",
        "autonomy/plan/mission/answers.py", "autonomy/plan/mission/mission.py",
        "autonomy/plan/mission/status.py", "autonomy/stack.py", "drivers/probe/board_probe.py",
        "record/events.py",
    }
)  # fmt: skip


def reads_text(node: ast.AST) -> bool:
    """Whether an expression is one of the texts of messages, by its name."""
    is_field = isinstance(node, ast.Attribute) and node.attr in TEXTS
    return is_field or (isinstance(node, ast.Name) and node.id in NAMES)


def looks_into_text(node: ast.AST) -> bool:
    """Whether a node compares, searches or takes apart the text of a message."""
    if isinstance(node, ast.Compare):
        sides = (node.left, *node.comparators)
        words = [isinstance(side, ast.Constant) and isinstance(side.value, str) for side in sides]
        is_in = any(isinstance(op, ast.In | ast.NotIn) for op in node.ops)
        return any(map(reads_text, sides)) and (any(words) or (is_in and reads_text(sides[-1])))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        of_text = reads_text(node.func.value) or any(map(reads_text, node.args))
        return node.func.attr in OPERATIONS and of_text
    return isinstance(node, ast.Subscript) and reads_text(node.value)


def find_files(check: Callable[[ast.AST], bool], words: Collection[str]) -> set[str]:
    """Find the files with such a node, among those that hold any of the words."""
    found = set()
    for path in ROOT.rglob("*.py"):
        text = path.read_text("utf-8")
        is_likely = any(word in text for word in words)
        if is_likely and any(check(node) for node in ast.walk(ast.parse(text))):
            found.add(str(path.relative_to(ROOT)))
    return found


def test_nothing_looks_into_the_text_of_a_reason() -> None:
    looked_into = find_files(looks_into_text, TEXTS | NAMES)
    assert looked_into == set(LOOKED_INTO)


def test_texts_are_made_where_messages_are_and_nowhere_else_inside_the_program() -> None:
    def renders(node: ast.AST) -> bool:
        return isinstance(node, ast.Call) and getattr(node.func, "id", "") == "render"

    inside = ("app/", "autonomy/", "record/", "sim/", "drivers/")
    files = {file for file in find_files(renders, ["render("]) if file.startswith(inside)}
    assert files == RENDERED
