"""`agribot replay`: run the stack again on recorded batches; every command must be the same.

With other settings (`--with`) it shows what they change.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from agribot.cli.refusals import describe_error
from agribot.core.errors import AgribotError, ConfigError

if TYPE_CHECKING:
    from agribot.app.rerun import PassDifference, PassSummary


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recordings", type=Path, nargs="+", metavar="RUN.mcap")
    parser.add_argument(
        "--with", action="append", default=[], dest="settings", metavar="A.B=C",
        help="try another setting and show what it changes; repeatable",
    )  # fmt: skip
    parser.add_argument(
        "--check", action="store_true",
        help="one line for each recording; exit status 1 when any of them differs, 2 when any "
        "cannot be checked",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print the result as the last line")


def run(options: argparse.Namespace) -> int:
    if options.settings and (options.check or len(options.recordings) > 1):
        raise ConfigError("--with compares one recording with itself; leave out --check and others")
    if options.settings:
        return _compare(options.recordings[0], options.settings, options.json)
    results = []
    is_list = options.check or len(options.recordings) > 1
    for path in options.recordings:
        result = _try_check(path) if is_list else _check(path)
        results.append({"recording": str(path), **result})
        if not options.json or is_list:
            stream = sys.stderr if options.json else sys.stdout
            stream.write(f"{f'{path}: ' if is_list else ''}{_format_check(result)}\n")
    identical = all(result["identical"] for result in results)
    if options.json:
        single = len(results) == 1 and not options.check
        whole = results[0] if single else {"identical": identical, "recordings": results}
        sys.stdout.write(msgspec.json.encode(whole).decode() + "\n")
    if any("error" in result for result in results):
        return 2
    return 0 if identical else 1


def _try_check(path: Path) -> dict[str, Any]:
    """Check one recording of a list; what is wrong with it keeps none of the others from it."""
    try:
        return _check(path)
    except (AgribotError, OSError) as error:
        why = describe_error(error)
        return {"ticks": None, "identical": None, "first_difference": None, "error": why}


def _check(path: Path) -> dict[str, Any]:
    from agribot.app.rerun import compare_passes, read_pass, rerun
    from agribot.record.mcap_file import check_whole
    from agribot.record.replay import read_config

    recorded = read_pass(path)
    check_whole(path)
    replayed, _ = rerun(path, read_config(path))
    first = compare_passes(recorded, replayed).first
    return {"ticks": len(recorded), "identical": first is None, "first_difference": first}


def _format_check(result: dict[str, Any]) -> str:
    if "error" in result:
        return f"not checked: {result['error']}"
    if result["identical"]:
        return f"{result['ticks']} ticks replayed: every command is identical"
    return f"commands differ from tick {result['first_difference']} of {result['ticks']} on"


def _compare(path: Path, settings: list[str], as_json: bool) -> int:
    from agribot.app.rerun import (
        change_settings,
        compare_passes,
        find_ineffective,
        read_pass,
        rerun,
        summarise_pass,
    )
    from agribot.record.replay import read_config

    config = read_config(path)
    changed = change_settings(config, settings)
    recorded = read_pass(path)
    before, plants_before = rerun(path, config)
    after, plants_after = rerun(path, changed)
    is_repeatable = compare_passes(recorded, before).first is None
    notes = [
        f"{setting} has no effect here: the recording was made with the old value"
        for setting in find_ineffective(settings)
    ]
    if not is_repeatable:
        notes.append("this version already decides otherwise than the one that recorded")
    for note in notes:
        sys.stderr.write(f"note: {note}\n")
    old, new = summarise_pass(before, plants_before), summarise_pass(after, plants_after)
    apart = compare_passes(before, after)
    if as_json:
        result = {
            "recording": str(path), "settings": settings, "repeatable": is_repeatable,
            "recorded": old, "replayed": new, "difference": apart, "notes": notes,
        }  # fmt: skip
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
    else:
        sys.stdout.write(_format_table(old, new, apart))
    return 0


def _format_table(old: PassSummary, new: PassSummary, apart: PassDifference) -> str:
    from agribot.app.rerun import PassSummary

    lines = [f"{'':20} {'recorded':>14} {'replayed':>14} {'change':>12}"]
    for name in PassSummary.__struct_fields__:
        a, b = getattr(old, name), getattr(new, name)
        change = ""
        if a != b:
            both = isinstance(a, int | float) and isinstance(b, int | float)
            change = f"{b - a:+.4g}" if both else "changed"
        lines.append(f"{name:20} {_format_cell(a):>14} {_format_cell(b):>14} {change:>12}".rstrip())
    if apart.first is None:
        lines.append("every command is the same")
    else:
        lines.append(
            f"commands differ in {apart.ticks} ticks ({100.0 * apart.share:.1f} %), first at tick "
            f"{apart.first}; at most {apart.speed_max_mps:.3f} m/s and "
            f"{apart.yaw_rate_max_radps:.3f} rad/s"
        )
    if apart.position_rms_m is not None:
        lines.append(f"believed positions differ by {100.0 * apart.position_rms_m:.2f} cm rms")
    lines.append("the sensors are those of the recorded drive: they do not answer to new commands")
    return "\n".join(lines) + "\n"


def _format_cell(value: object) -> str:
    if value is None or value == "":
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
