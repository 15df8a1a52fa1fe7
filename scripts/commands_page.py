"""Print docs/commands.md: every command and its options, as the parsers declare them.

`make pages` writes all such pages.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Iterator

from agribot.cli.main import COMMANDS

HEAD = """# Commands

Written by `make pages` from the code; `agribot COMMAND --help` says the same. Exit status: 0 done
and good, 1 ran but the result is bad, 2 wrong use or bad input, 130 interrupted after a clean stop.

"""
Groups = argparse._SubParsersAction


def commands() -> Iterator[tuple[str, str, str, argparse.ArgumentParser]]:
    """Words, one line of help, example and parser of each command, and of those below it."""
    for name, (module_name, words, example) in COMMANDS.items():
        parser = argparse.ArgumentParser(prog=f"agribot {name}")
        importlib.import_module(module_name).add_arguments(parser)
        yield name, words, example, parser
        yield from _below(name, parser)


def _below(
    name: str, parser: argparse.ArgumentParser
) -> Iterator[tuple[str, str, str, argparse.ArgumentParser]]:
    for action in parser._actions:
        if not isinstance(action, Groups):
            continue
        words = {choice.dest: choice.help or "" for choice in action._choices_actions}
        for inner_name, inner in action.choices.items():
            example = (inner.epilog or "").removeprefix("example: ")
            yield f"{name} {inner_name}", words.get(inner_name, ""), example, inner
            yield from _below(f"{name} {inner_name}", inner)


def options(parser: argparse.ArgumentParser) -> str:
    """Format the arguments of one parser as a table; empty where it has none."""
    lines = []
    for action in parser._actions:
        if isinstance(action, Groups | argparse._HelpAction) or action.help == argparse.SUPPRESS:
            continue
        names = ", ".join(f"`{name}`" for name in action.option_strings)
        value = _value(action)
        shown = f"{names} {value}".strip() if names else value or f"`{action.dest}`"
        words = (action.help or "").replace("%%", "%").replace("|", "\\|")
        if "%(" in words:
            words %= {**vars(action), "prog": parser.prog}
        lines.append(f"| {shown} | {words} |\n")
    return "".join(["| argument | what |\n", "|---|---|\n", *lines]) if lines else ""


def _value(action: argparse.Action) -> str:
    if action.nargs == 0:
        return ""
    if action.choices is not None:
        return "`" + "\\|".join(map(str, action.choices)) + "`"
    metavar = action.metavar or (action.dest.upper() if action.option_strings else action.dest)
    names = metavar if isinstance(metavar, tuple) else (metavar,)
    return "`" + " ".join(names).replace("|", "\\|") + "`"


def page() -> str:
    text = HEAD
    for name, words, example, parser in commands():
        depth = "##" if " " not in name else "###"
        about = words[:1].upper() + words[1:]
        text += f"{depth} agribot {name}\n\n{about}.\n\n"
        text += f"```\n{example}\n```\n\n" if example else ""
        text += f"{table}\n" if (table := options(parser)) else ""
    return text


if __name__ == "__main__":
    sys.stdout.write(page())
