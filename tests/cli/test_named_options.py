"""Every option that a message of the program names is one that the reader can give."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from agribot.cli.main import COMMANDS
from tests.cli.parser_tree import Words, every_parser

ROOT = Path(__file__).parents[2] / "src"
SOURCES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted((ROOT / "agribot").rglob("*.py"))
}
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9]*(?:-[a-z0-9]+)*")
IMPORT = re.compile(r"^\s*from (agribot[\w.]*) import (\([^)]*\)|.+)", re.MULTILINE)
COMMAND = re.compile(r"\bagribot ((?:[a-z0-9][a-z0-9-]*)(?: [a-z0-9][a-z0-9-]*)*)")
# Of other programs, by the module that names them.
OF_OTHERS = {
    "agribot.app.declination": {"--upgrade"},  # pip
    "agribot.cli.doctor.doctor": {"--reload", "--subsystem-match"},  # udevadm
    "agribot.cli.doctor.doctor_devices": {"--now"},  # systemctl
    "agribot.cli.doctor.doctor_packages": {"--upgrade"},  # pip
    "agribot.cli.run.view": {"--ros-args"},  # rviz2
    "agribot.lab.bench.ui_browser": {"--no-sandbox", "--use-angle", "--enable-unsafe-swiftshader"},
    "agribot.lab.sweep.ray_cluster": {"--head"},  # ray start
    # Colours of a style sheet.
    "agribot.ros.graph_picture": {
        "--accent",
        "--accent-soft",
        "--ink",
        "--muted",
        "--strong-edge",
        "--surface",
    },
    "agribot.sim.mujoco_library": {"--force-reinstall"},  # pip
}
# Modules that commands share, and the commands that do not show what they say of an option:
# labels and exports read no folds, drawn sets or swapped values, and predict alone has a limit.
NOT_SHOWN_BY = {
    "agribot.lab.adapt.adapting": {"adapt"},  # --set of the run that is recorded
    "agribot.lab.dataset.classes": {"dataset", "label"},  # masks of a known --data
    "agribot.lab.dataset.importing": {"label"},
    "agribot.lab.dataset.picture_index": {"label"},
    "agribot.lab.dataset.placement": {"label"},  # it makes labels
    "agribot.lab.dataset.pictures": {"dataset", "label", "train", "eval", "live", "export"},
    "agribot.lab.dataset.recorded_rows": {"dataset"},  # --set of the run that is recorded
    "agribot.lab.sweep.ray_cluster": {"sweep"},  # of ray start
    # It writes a card, and trains nothing.
    **{f"agribot.lab.train.{name}": {"export"} for name in ("card", "data", "efficientnet")},
    **{f"agribot.lab.train.{name}": {"export"} for name in ("processes", "start")},
    "agribot.lab.train.photographs": {"dataset", "label", "export"},
}
# Commands that learn from pictures and masks that they wrote, by a plan of their own.
OF_OWN_DATA = {"adapt"}
GAP = "\N{HORIZONTAL ELLIPSIS}"  # in the place of what a message puts into its text
PARSERS = every_parser()


@cache
def text_of(module: str) -> str:
    return SOURCES[module].read_text(encoding="utf-8")


@cache
def texts_of(module: str) -> tuple[str, ...]:
    """All strings with options of a module but its docstrings; what is put into them left out."""
    if "--" not in text_of(module):
        return ()
    nodes = [*ast.walk(ast.parse(text_of(module)))]
    inside = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    joined = [node for node in nodes if isinstance(node, ast.JoinedStr)]
    inside |= {id(part) for node in joined for part in node.values}
    alone = [node for node in nodes if isinstance(node, ast.Constant) and id(node) not in inside]
    texts = [[getattr(part, "value", None) for part in node.values] for node in joined]
    texts += [[node.value] for node in alone if isinstance(node.value, str)]
    return tuple("".join(p if isinstance(p, str) else GAP for p in parts) for parts in texts)


def options_in(module: str) -> set[str]:
    found = {option for text in texts_of(module) for option in OPTION.findall(text)}
    return found - OF_OTHERS.get(module, set())


def options_below(words: Words) -> set[str]:
    """The options of a command, or of all that stand below a word."""
    below = [parser for key, parser in PARSERS.items() if key[: len(words)] == words]
    return {option for parser in below for option in parser._option_string_actions}


def known_words(text: str) -> Words:
    words = (*text.split(),)
    known = [key for key in PARSERS if words[: len(key)] == key]
    return max(known, key=len, default=())


@cache
def imports_of(module: str) -> set[str]:
    """The modules that a module imports, inside of functions, too."""
    found = IMPORT.findall(text_of(module))
    names = {f"{above}.{name}" for above, below in found for name in re.findall(r"\w+", below)}
    return (names | {above for above, _ in found}) & SOURCES.keys()


@cache
def reach_of(module: str) -> set[str]:
    """A module, and all that lies below it."""
    seen: set[str] = set()
    todo = [module]
    while todo:
        name = todo.pop()
        if name not in seen:
            seen.add(name)
            todo += imports_of(name)
    return seen


def test_every_option_that_is_named_exists() -> None:
    every = options_below(())
    unknown = {name: options_in(name) - every for name in SOURCES}
    assert not {name: options for name, options in unknown.items() if options}


def test_every_option_behind_a_command_is_one_of_this_command() -> None:
    wrong, checked = [], 0
    for module in SOURCES:
        for text in texts_of(module):
            starts = [*COMMAND.finditer(text)]
            ends = [*(start.start() for start in starts), len(text)][1:]
            for start, end in zip(starts, ends, strict=True):
                words = known_words(start[1])
                line = re.split(r"[;)\n]|'[,;. ]|, or ", text[start.start() : end])[0]
                named = set(OPTION.findall(line)) if words else set()
                checked += len(named)
                lacking = named - options_below(words) - OF_OTHERS.get(module, set())
                wrong += [f"{module}: {line}: {option}" for option in lacking]
    assert not wrong, "\n".join(wrong)
    assert checked > 60


@pytest.mark.parametrize("module", [m for m in SOURCES if m.startswith("agribot.lab.")])
def test_an_option_in_a_message_of_shared_code_is_one_of_every_command_that_shows_it(
    module: str,
) -> None:
    """A reader of data sets is used by commands with and without --images and --masks."""
    named = options_in(module)
    if not named:
        return
    is_own = module.startswith("agribot.lab.adapt.")
    for command, (home, *_) in COMMANDS.items():
        if command in OF_OWN_DATA and not is_own:
            continue
        if module in reach_of(home) and command not in NOT_SHOWN_BY.get(module, set()):
            assert named <= options_below((command,)), command
