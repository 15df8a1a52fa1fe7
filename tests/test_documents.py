"""What the documents name exists: files, headings, commands with their options."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.cli.parser_tree import Words, every_parser

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("ros?/*.md")])
OF_TODAY = [page for page in DOCUMENTS if page.name != "CHANGELOG.md"]  # that one tells history
TOP_PACKAGES = "app|autonomy|cli|core|description|drivers|gis|lab|record|ros|sim|ui"

_LINK = re.compile(r"\]\(([^)\s]+)\)")
_FILE = re.compile(r"\b((?:src|tests|docs|examples|web|scripts|benchmarks)/[\w./-]*\w)")
_MODULE = re.compile(rf"\bagribot\.(?:{TOP_PACKAGES})(?:\.\w+)+")
_CODE = re.compile(r"`(agribot [^`]+)`")
_FENCE = re.compile(r"^```\w*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_PARSERS = every_parser()
# What the text speaks of but is none of the program's: a placeholder, and a page's own example.
NOT_OURS = ("COMMAND", "rows")


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def anchors_of(path: Path) -> set[str]:
    """The headings of a document as GitHub links to them."""
    heads = re.findall(r"^#+ (.+)$", text_of(path), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


def list_missing_links(page: Path) -> Iterator[str]:
    for link in _LINK.findall(text_of(page)):
        if "://" in link:
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name) if name else page
        if not target.exists() or (anchor and anchor not in anchors_of(target.resolve())):
            yield link


@pytest.mark.parametrize("page", DOCUMENTS, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page: Path) -> None:
    assert not [*list_missing_links(page)]


@pytest.mark.parametrize("page", OF_TODAY, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_file_and_module_that_is_named_exists(page: Path) -> None:
    text = text_of(page)
    missing = [name for name in _FILE.findall(text) if not (ROOT / name).exists()]
    assert not [name for name in missing if not is_made(name)]
    modules = (name.split(".") for name in _MODULE.findall(text))
    assert not [".".join(name) for name in modules if not has_module(name)]


def is_made(name: str) -> bool:
    """Whether a build makes it, or it is a pattern of names."""
    return name.startswith(("src/agribot/ui/page", "web/node_modules", "web/.test-build"))


def has_module(name: list[str]) -> bool:
    """Whether a dotted name begins with a module, down to a class or function in it."""
    for length in (len(name), len(name) - 1, len(name) - 2):
        path = (ROOT / "src").joinpath(*name[:length])
        if length > 1 and path.with_suffix(".py").is_file():
            return all(word in text_of(path.with_suffix(".py")) for word in name[length:])
        if length > 1 and (path / "__init__.py").is_file():
            return all(word in text_of(path / "__init__.py") for word in name[length:])
    return False


def whole_commands_of(page: Path) -> Iterator[str]:
    """Every line of a block that begins with `agribot`, up to where the shell goes on."""
    for block in _FENCE.findall(text_of(page)):
        for line in block.replace("\\\n", " ").splitlines():
            if line.startswith("agribot "):
                yield re.split(r"; | [>|&] ", line)[0]


def split_command(text: str) -> tuple[Words, list[str]]:
    """The words of a command and what follows them. Raises: LookupError: there is none such."""
    words = shlex.split(text, comments=True)[1:]
    known = [key for key in _PARSERS if (*words,)[: len(key)] == key]
    if not known:
        raise LookupError(text)
    command = max(known, key=len)
    return command, words[len(command) :]


def parse(text: str) -> None:
    """Let the command's own parser read all of it. Raises: SystemExit: it does not."""
    command, words = split_command(text)
    if words and "--help" not in words:
        _PARSERS[command].parse_args(words)


@pytest.mark.parametrize("page", OF_TODAY, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_line_is_one_that_the_program_takes(
    page: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    commands = [*whole_commands_of(page)]
    if page.name == "coming-from-the-original.md":  # whose commands in the text are whole, too
        commands += _CODE.findall(text_of(page))
    wrong = []
    for command in commands:
        try:
            parse(command)
        except (SystemExit, LookupError):
            wrong.append(f"{command}: {capsys.readouterr().err.splitlines()[-1:]}")
    assert not wrong, "\n".join(wrong)


def test_every_command_for_a_real_robot_names_its_board_and_lets_a_person_arm_it() -> None:
    every = (line for page in OF_TODAY for line in whole_commands_of(page))
    real = [
        line for line in every if re.match("agribot run (hardware|.*--platform hardware)", line)
    ]
    assert len(real) > 2
    lacking = [
        line for line in real if "base=" not in line or not {"--ui", "--arm"} & {*line.split()}
    ]
    assert not lacking


@pytest.mark.parametrize("page", OF_TODAY, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_in_the_text_exists_with_its_options(page: Path) -> None:
    wrong = []
    for text in _CODE.findall(text_of(page)):
        if text.split()[1] in NOT_OURS:
            continue
        command, words = split_command(text)
        known = _PARSERS[command]._option_string_actions
        options = [word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)]
        wrong += [f"{text}: {option}" for option in options if option not in known]
    assert not wrong


def test_every_type_in_the_glossary_is_one_of_the_code() -> None:
    types = set(re.findall(r"`([A-Z]\w+)`", text_of(ROOT / "docs" / "glossary.md")))
    code = "".join(text_of(path) for path in (ROOT / "src").rglob("*.py"))
    assert types and not {
        name for name in types if not re.search(rf"^class {name}\b|^{name} = ", code, re.M)
    }
