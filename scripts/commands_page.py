"""Print docs/commands.md: every command with its example, and the options of many commands.

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

Written by `make pages` from the code: every command with an example. `agribot COMMAND --help`
explains its arguments and options. Exit status: 0 done and good, 1 ran but the result is bad, 2
wrong use or bad input, 130 interrupted after a clean stop.

## Options of many commands

Most belong to `agribot run`.

"""
# Commands with the same words from which on an option is explained at the top of the page.
MANY = 4
# Words, one line of help, example and parser.
Command = tuple[str, str, str, argparse.ArgumentParser]
Commands = list[Command]
Groups = argparse._SubParsersAction


def commands() -> Iterator[Command]:
    """Yield each command, and after it those below it."""
    for name, (module_name, words, example) in COMMANDS.items():
        parser = argparse.ArgumentParser(prog=f"agribot {name}")
        importlib.import_module(module_name).add_arguments(parser)
        yield name, words, example, parser
        yield from _below(name, parser)


def _below(name: str, parser: argparse.ArgumentParser) -> Iterator[Command]:
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
    """Format a line for each option that many commands explain with the same words."""
    found: dict[str, Counter[str]] = {}
    for *_, parser in every:
        for action in list_options(parser):
            found.setdefault(_name(action), Counter())[_explain(action, parser)] += 1
    lines = []
    for name, texts in sorted(found.items()):
        words, count = max(texts.items(), key=lambda item: (bool(item[0]), item[1]))
        lines += [f"- `{name}{words}\n"] if words and count >= MANY else []
    return "".join(lines)


def _name(action: argparse.Action) -> str:
    """Return the first long name of an option, or its only one."""
    return min(action.option_strings, key=lambda name: not name.startswith("--"))


def _explain(action: argparse.Action, parser: argparse.ArgumentParser) -> str:
    """Format the value and the help of an option; what ends its code span comes first."""
    words = (action.help or "").replace("%%", "%").replace("<", "&lt;")
    words = words % {**vars(action), "prog": parser.prog} if "%(" in words else words
    value = _value(action)
    return f"{' ' if value else ''}{value}`: {words}" if words else ""


def _value(action: argparse.Action) -> str:
    if action.nargs == 0:
        return ""
    if action.choices is not None:
        return "|".join(map(str, action.choices))
    names = action.metavar or action.dest.upper()
    return " ".join(names if isinstance(names, tuple) else (names,))


def page() -> str:
    every = list(commands())
    return (
        HEAD + explain_shared(every) + "".join(format_command(command, every) for command in every)
    )


def format_command(command: Command, every: Commands) -> str:
    """Format a heading for a command, and an item of a list for one below it."""
    name, words, example, _ = command
    if " " in name:
        return f"- {show_example(example)}: {words}.\n"
    text = f"\n## agribot {name}\n\n{words[:1].upper() + words[1:]}"
    has_more = any(other.startswith(f"{name} ") for other, *_ in every)
    return f"{text}.\n\n" if has_more else f"{text}:\n{show_example(example)}\n"


def show_example(example: str) -> str:
    """Format the first command of an example; what follows it is in `--help`."""
    return f"`{example.removeprefix('examples: ').split('; ')[0]}`"


if __name__ == "__main__":
    sys.stdout.write(page())
