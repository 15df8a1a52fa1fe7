"""Tutorials and how-to pages: their commands, as they stand there, do what the page says.

A block `sh run` is executed. Its output contains what a comment `expect` below it says. What a
reader has already, such as photographs, is made by comments `before`; a comment `shorter: A -> B`
makes a long command short for the test. Any other block with a command of the program is followed
by a line `*Needs ...*`, which says to a reader and to the test what it needs.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

from agribot.cli.main import main
from tests import nightly
from tests.test_tutorials import files_of

ROOT = Path(__file__).parents[1]
_PART = re.compile(
    r"^<!-- before: (?P<before>.*?) -->$|^```sh run\n(?P<block>.*?)^```$"
    r"(?:\n\n<!-- expect: (?P<expect>.*?) -->)?",
    re.DOTALL | re.MULTILINE,
)
_SHORTER = re.compile(r"<!-- shorter: (.*?) -> (.*?) -->")
_FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```$(?=\s*([^\n]*))", re.DOTALL | re.MULTILINE)
# Characters that only a shell understands.
SHELL = re.compile(r"[*|>;&]")
# Commands that take no longer than some seconds.
CHEAP = ("agribot world", "agribot plan", "agribot describe")


class Step(NamedTuple):
    commands: list[str]
    expected: str = ""


def list_pages() -> Iterator[Path]:
    """List the pages that mkdocs.yml has as tutorials and how-to pages."""
    menu = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    for section in menu:
        for title, pages in section.items():
            if title in ("Tutorials", "How to"):
                names = (name for page in pages for name in page.values() if isinstance(name, str))
                yield from (ROOT / "docs" / name for name in names)


PAGES = sorted(page for page in list_pages() if page.parent.name != "contribute")
RUN = [page for page in PAGES if "```sh run" in page.read_text(encoding="utf-8")]


def steps_of(page: Path) -> list[Step]:
    """List what is run: preparations and blocks, each as its commands."""
    text = page.read_text(encoding="utf-8")
    return [
        Step([part["before"]])
        if part["before"]
        else Step(part["block"].replace("\\\n", " ").splitlines(), part["expect"] or "")
        for part in _PART.finditer(text)
    ]


def shorten(command: str, page: Path) -> str:
    for long, short in _SHORTER.findall(page.read_text(encoding="utf-8")):
        command = command.replace(long, short)
    return command


def run(command: str) -> int:
    """Run a line in this process, or in a shell where it needs one; its exit status."""
    words = shlex.split(command, comments=True)
    if not words:
        return 0
    if words[0] == "agribot" and not SHELL.search(command.partition(" #")[0]):
        return main(words[1:])
    line = f'agribot() {{ "{sys.executable}" -m agribot.cli "$@"; }}; {command}'
    return subprocess.run(["bash", "-c", line], check=False).returncode


def follow(page: Path, steps: list[Step], folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Do what a page says in these steps, in a folder beside the examples.

    What the test cut short by `--for` may end with 1: the mission is not done.
    """
    (folder / "examples").symlink_to(ROOT / "examples")
    for name, text in files_of(page).items():
        (folder / name).write_text(text, encoding="utf-8")
    for step in steps:
        capfd.readouterr()
        for command in step.commands:
            shorter = shorten(command, page)
            is_cut = "--for" in shorter and "--for" not in command
            assert run(shorter) <= is_cut, f"{shorter}\n{capfd.readouterr().err}"
        output = capfd.readouterr()
        assert step.expected in output.out + output.err, step.commands


def is_cheap(step: Step) -> bool:
    return all(command.startswith(CHEAP) for command in step.commands)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT / "docs").as_posix())
def test_every_command_of_a_page_is_run_or_says_what_it_needs(page: Path) -> None:
    fences = _FENCE.findall(page.read_text(encoding="utf-8"))
    silent = [
        block
        for kind, block, after in fences
        if re.search(r"^agribot ", block, re.MULTILINE)
        and kind != "sh run"
        and not after.startswith("*Needs ")
    ]
    assert not silent, "\n".join(silent)


def test_what_is_quick_in_the_first_tutorial_prints_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    page = ROOT / "docs" / "tutorials" / "your-field.md"
    monkeypatch.chdir(tmp_path)
    cheap = [step for step in steps_of(page) if is_cheap(step)]
    assert len(cheap) == 2
    follow(page, cheap, tmp_path, capfd)


@nightly.by_day("test_what_is_quick_in_the_first_tutorial_prints_what_the_page_says")
@pytest.mark.parametrize("page", RUN, ids=lambda page: page.relative_to(ROOT / "docs").as_posix())
def test_a_reader_who_follows_a_page_sees_what_it_says(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    follow(page, steps_of(page), tmp_path, capfd)
