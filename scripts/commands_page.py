"""Print docs/commands.md: every command with its example and the names of its options.

What an option does is printed by `--help`; those that many commands share are explained once.
`make pages` writes all such pages.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections import Counter
from collections.abc import Iterator

from agribot.cli.main import COMMANDS

HEAD = """# Commands

Written by `make pages` from the code. `agribot COMMAND --help` explains every option; this page
has their names, and what the ones that many commands share mean. Exit status: 0 done and good, 1
ran but the result is bad, 2 wrong use or bad input, 130 interrupted after a clean stop.

## Options of many commands

| option | what |
|---|---|
"""
# Commands with the same words from which on an option is explained at the top of the page.
MANY = 4
Commands = list[tuple[str, str, str, argparse.ArgumentParser]]
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


def list_options(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """List the options of one parser; what stands without a name is in its example."""
    return [
        action
        for action in parser._actions
        if action.option_strings
        and not isinstance(action, argparse._HelpAction)
        and action.help != argparse.SUPPRESS
    ]


def explain_shared(every: Commands) -> str:
    """Format a row for each option that many commands explain with the same words."""
    found: dict[str, Counter[str]] = {}
    for *_, parser in every:
        for action in list_options(parser):
            found.setdefault(_name(action), Counter())[_explain(action, parser)] += 1
    rows = []
    for name, texts in sorted(found.items()):
        words, count = max(texts.items(), key=lambda item: (bool(item[0]), item[1]))
        rows += [f"| {name} | {words} |\n"] if words and count >= MANY else []
    return "".join(rows)


def _name(action: argparse.Action) -> str:
    return ", ".join(f"`{name}`" for name in action.option_strings)


def _explain(action: argparse.Action, parser: argparse.ArgumentParser) -> str:
    words = (action.help or "").replace("%%", "%").replace("|", "\\|")
    words = words % {**vars(action), "prog": parser.prog} if "%(" in words else words
    value = _value(action)
    return f"{value}: {words}" if value and words else words


def _value(action: argparse.Action) -> str:
    if action.nargs == 0:
        return ""
    if action.choices is not None:
        return "`" + "\\|".join(map(str, action.choices)) + "`"
    metavar = action.metavar or (action.dest.upper() if action.option_strings else action.dest)
    names = metavar if isinstance(metavar, tuple) else (metavar,)
    return "`" + " ".join(names).replace("|", "\\|") + "`"


def page() -> str:
    every = list(commands())
    text = HEAD + explain_shared(every)
    for name, words, example, parser in every:
        depth = "##" if " " not in name else "###"
        text += f"\n{depth} agribot {name}\n\n{words[:1].upper() + words[1:]}.\n"
        text += f"\n```\n{example}\n```\n" if example else ""
        names = ", ".join(_name(action) for action in list_options(parser))
        text += f"\nOptions: {names}\n" if names else ""
    return text


if __name__ == "__main__":
    sys.stdout.write(page())
