"""The commands of the program and theirs, as the parsers name them."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterator

from agribot.cli.main import COMMANDS

Words = tuple[str, ...]


def every_parser() -> dict[Words, argparse.ArgumentParser]:
    """By the words that lead to it: ("world", "check")."""
    found: dict[Words, argparse.ArgumentParser] = {}
    for name, (module_name, _, example) in COMMANDS.items():
        parser = argparse.ArgumentParser(epilog=f"example: {example}")
        importlib.import_module(module_name).add_arguments(parser)
        found |= dict(_below((name,), parser))
    return found


def every_command() -> list[Words]:
    """Those that do something: where others stand below a word, it alone is no command."""
    parsers = every_parser()
    return [words for words, parser in parsers.items() if not _groups(parser)]


def _below(
    words: Words, parser: argparse.ArgumentParser
) -> Iterator[tuple[Words, argparse.ArgumentParser]]:
    yield words, parser
    for group in _groups(parser):
        for name, inner in group.choices.items():
            yield from _below((*words, name), inner)


def _groups(
    parser: argparse.ArgumentParser,
) -> list[argparse._SubParsersAction[argparse.ArgumentParser]]:
    return [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
