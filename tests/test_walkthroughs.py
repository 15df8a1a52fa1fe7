"""The tutorials for users: their files and commands, as they stand there, print what they say."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from agribot.cli.main import main
from tests import nightly
from tests.test_tutorials import files_of

PAGES = sorted((Path(__file__).parents[1] / "docs" / "tutorials").glob("*.md"))
_STEP = re.compile(r"^```sh run\n(.*?)^```$\n\n<!-- expect: (.*?) -->", re.DOTALL | re.MULTILINE)
_RUNS = re.compile(r"^```sh run$", re.MULTILINE)
# Commands that take no longer than some seconds.
CHEAP = ("agribot world", "agribot plan")


def steps_of(page: Path) -> list[tuple[list[str], str]]:
    """Commands of each block, and what the last of them prints."""
    text = page.read_text(encoding="utf-8")
    steps = [(block.splitlines(), words) for block, words in _STEP.findall(text)]
    assert len(steps) == len(_RUNS.findall(text)), "a block without its expectation"
    return steps


def follow(
    page: Path, folder: Path, capsys: pytest.CaptureFixture[str], only: tuple[str, ...] = ("",)
) -> int:
    """Run the commands of a page that begin with one of `only`; how many steps were judged."""
    for name, text in files_of(page).items():
        (folder / name).write_text(text, encoding="utf-8")
    judged = 0
    for commands, words in steps_of(page):
        if not all(command.startswith(only) for command in commands):
            continue
        capsys.readouterr()
        for command in commands:
            assert main(shlex.split(command)[1:]) == 0, command
        output = capsys.readouterr()
        assert words in output.out + output.err, commands
        judged += 1
    return judged


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_is_quick_on_a_page_prints_what_the_page_says(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert follow(page, tmp_path, capsys, CHEAP) > 0


@nightly.by_day("test_what_is_quick_on_a_page_prints_what_the_page_says")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_reader_who_follows_a_page_sees_what_it_says(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert follow(page, tmp_path, capsys) == len(steps_of(page))
