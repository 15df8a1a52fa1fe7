"""`agribot plugins`: what installed packages add, from where, and what is wrong with it."""

from __future__ import annotations

import argparse
import json
import sys

import msgspec

from agribot.cli.standard_error import print_line
from agribot.core.plugins import GROUPS, Plugin, list_plugins


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print the list as the last line")


def run(options: argparse.Namespace) -> int:
    """List the plugins; 1 where one cannot be imported."""
    found = list_plugins()
    for plugin in found:
        print_line(_format_line(plugin))
    if not found:
        print_line(
            f"no plugin is installed; a package adds one by an entry point of {', '.join(GROUPS)} "
            "(docs/contribute/plugins.md)"
        )
    if options.json:
        rows = msgspec.to_builtins(found)
        sys.stdout.write(json.dumps({"ok": not _count_bad(found), "plugins": rows}) + "\n")
    return 1 if _count_bad(found) else 0


def _count_bad(plugins: list[Plugin]) -> int:
    return sum(bool(plugin.error) for plugin in plugins)


def _format_line(plugin: Plugin) -> str:
    origin = f"{plugin.package} {plugin.version}".strip()
    settings = f", settings in [plugins.{plugin.name}]" if plugin.has_settings else ""
    state = plugin.error or f"{plugin.value}{settings}"
    return f"{plugin.group.removeprefix('agribot.'):12} {plugin.name:20} {origin:24} {state}"
