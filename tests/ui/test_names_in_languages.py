"""Each language of the page names what the robot calls by an English name, and nothing else."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import get_args

import pytest

import agribot
from agribot.app.calibration.kinds import KINDS
from agribot.autonomy.control.hazards import CHECKS
from agribot.autonomy.plan.mission.errand_kind import ErrandKind
from agribot.core.fact_text import LANGUAGES
from agribot.core.implement.plants import REASONS
from agribot.core.messages import GateState, MissionState, SensorState
from agribot.record.events import EventKind

SOURCE = Path(agribot.__file__).parent
WEB = SOURCE.parents[1] / "web" / "src"
TABLE = re.compile(r"""^\s+(?:'([^']+)'|"([^"]+)"|(\w+)):(?:\s|$)""", re.MULTILINE)


def read_names(language: str) -> set[str]:
    text = (WEB / "texts" / f"{language}.ts").read_text(encoding="utf-8")
    return {
        next(filter(None, found))
        for found in TABLE.findall(text.partition("export const names")[2])
    }


def list_wanted() -> set[str]:
    kinds = [text for kind in KINDS.values() for text in (kind.title, kind.about, kind.ground)]
    named: Iterable[str] = (
        *get_args(GateState), *get_args(SensorState), *get_args(MissionState), *get_args(EventKind),
        *CHECKS, *filter(None, REASONS), *(kind.leg for kind in ErrandKind), *kinds,
    )  # fmt: skip
    return {re.sub(r"\d+(?:\.\d+)?", "#", name) for name in named}


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_a_language_names_all_that_the_robot_names_on_the_page(language: str) -> None:
    assert list_wanted() - read_names(language) == set()


def test_every_name_is_one_that_the_robot_or_a_display_has() -> None:
    files = [*SOURCE.rglob("*.py"), *WEB.glob("displays/*.ts")]
    source = "\n".join(path.read_text(encoding="utf-8") for path in files).lower()
    others = set().union(*map(read_names, LANGUAGES[1:])) - list_wanted()
    assert len(others) > 20
    assert {name for name in others if not is_named(name.lower(), source)} == set()


def is_named(name: str, source: str) -> bool:
    """Whether a text of the source begins so; where the name has a number, in any of its places."""
    pattern = re.escape(name).replace(r"\#", r"(?:\d+|\{[^}]*\})")
    return re.search(f"[\"'.]{pattern}", source) is not None
