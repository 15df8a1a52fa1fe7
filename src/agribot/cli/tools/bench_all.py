"""`agribot bench all`: every benchmark in its short form, one result."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import json
import os
import platform
import sys
from typing import Any

from agribot.cli.refusals import describe_error
from agribot.cli.tools.bench import add_options
from agribot.core.errors import AgribotError

# name -> (module, options that keep it to a minute or two)
SHORT = {
    "sim": ("agribot.cli.tools.bench_sim", ()),
    "nav": ("agribot.cli.tools.bench_nav", ("--seeds", "20000-20019")),
    "ground": ("agribot.cli.tools.bench_ground", ()),
    "perception": ("agribot.cli.tools.bench_perception", ("--frames", "10")),
    "closed-loop": (
        "agribot.cli.tools.bench_closed_loop",
        ("--fields", "beet,farm", "--lights", "noon", "--heights", "1", "--seeds", "1"),
    ),
    "ui": ("agribot.cli.tools.bench_ui", ("--seconds", "5")),
}
INTERRUPTED = 130


def add_arguments(_parser: argparse.ArgumentParser) -> None:
    """Add none of its own."""


def run(options: argparse.Namespace) -> int:
    """Return the worst status of all; one that cannot run is named, and the others still do."""
    card: dict[str, Any] = {"cpus": os.cpu_count(), "machine": platform.machine()}
    status = 0
    for name, (module_name, short) in SHORT.items():
        sys.stderr.write(f"\n{name}\n")
        try:
            one, card[name] = _run_benchmark(module_name, short)
        except (AgribotError, ImportError) as error:
            words = describe_error(error)
            sys.stderr.write(f"{name} cannot run: {words}\n")
            one, card[name] = 1, {"error": words}
        status = max(status, one)
        if one == INTERRUPTED:
            break
    if options.json:
        sys.stdout.write(json.dumps(card) + "\n")
    return status


def _run_benchmark(module_name: str, short: tuple[str, ...]) -> tuple[int, Any]:
    module = importlib.import_module(module_name)
    parser = argparse.ArgumentParser()
    add_options(parser, module_name)
    chosen = parser.parse_args([*short, "--json"])
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        status = int(module.run(chosen))
    lines = output.getvalue().splitlines()
    return status, json.loads(lines[-1]) if lines else None
