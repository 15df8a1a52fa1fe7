"""Ten questions of a newcomer: each answer stands at most two clicks away from the README."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CLICKS = 2
# Heading of the last release.
VERSION = re.findall(r"^## (\d.*)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)[0]
_LINK = re.compile(r"\]\(([^)#\s]+)(?:#[\w-]*)?\)")
_HEADING = re.compile(r"^#+ ", re.MULTILINE)


@cache
def reach(clicks: int = CLICKS) -> dict[Path, int]:
    """Find the pages that links lead to, each with its number of clicks."""
    found = {ROOT / "README.md": 0}
    for click in range(1, clicks + 1):
        for page in [page for page, at in found.items() if at == click - 1]:
            for name in _LINK.findall(page.read_text(encoding="utf-8")):
                target = (page.parent / name).resolve()
                if target.suffix == ".md" and target.is_file():
                    found.setdefault(target, click)
    return found


def section_of(page: Path, heading: str) -> str:
    """Return the text below a heading, up to the next heading."""
    text = page.read_text(encoding="utf-8")
    _, found, rest = text.partition(f"# {heading}\n")
    assert found, f"{page.name} has no heading '{heading}'"
    return _HEADING.split(rest)[0]


@pytest.mark.parametrize(
    ("page", "heading", "answer"),
    [
        pytest.param("README.md", "State", "not yet: no machine has driven with it",
                     id="did it ever drive in a real field"),
        pytest.param("README.md", "Two commands", "make run", id="how do I see a first mission"),
        pytest.param("docs/tutorials/your-field.md", "1. Describe it", "pitch_m = 0.75",
                     id="how do I drive my own field with rows of 0.75 m"),
        pytest.param("docs/tutorials/your-photographs.md", "3. Train", "--data-dir photos",
                     id="what do I do with fifty photographs"),
        pytest.param("docs/hardware.md", "Will my parts work", "RoboClaw",
                     id="do an F9P, no magnetometer and a RoboClaw work"),
        pytest.param("docs/navigation.md", "Navigation along crop rows", "cross-track error, RMS",
                     id="how exactly does it drive with which receiver"),
        pytest.param("docs/ros.md", "Nav2", "no AMCL", id="does it work with Nav2 on Jazzy"),
        pytest.param("docs/navigation.md", "A receiver that is silent", "`estimate.gnss_timeout_s`",
                     id="what does it do when GNSS is lost in a row"),
        pytest.param("docs/contribute/correction.md", "Add a sensor that corrects the pose",
                     "one new file",
                     id="how do I add a correction of my own"),
        pytest.param("CHANGELOG.md", VERSION, "- ", id="what is in the last release"),
    ],
)  # fmt: skip
def test_a_question_is_answered_within_two_clicks(page: str, heading: str, answer: str) -> None:
    assert ROOT / page in reach()
    assert answer in section_of(ROOT / page, heading)


def test_every_tutorial_is_within_two_clicks_too() -> None:
    tutorials = {*(ROOT / "docs" / "tutorials").glob("*.md"), ROOT / "docs" / "build-a-robot.md"}
    assert len(tutorials) > 3
    assert tutorials <= reach().keys()
