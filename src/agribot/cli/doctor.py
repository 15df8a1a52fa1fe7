"""`agribot doctor`: what is installed, what this machine is, and whether the robot would start."""

from __future__ import annotations

import argparse
import hashlib
import importlib
import importlib.metadata
import json
import os
import platform
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from agribot.app.workers import usable_cpus
from agribot.core import extras
from agribot.core.errors import AgribotError
from agribot.core.version import __version__

LEAST_PYTHON = (3, 11)
SELF_CHECK_S = 1.0
DRIVING = "driving for one second on the farm; the first time on a machine takes half a minute ..."


class CheckResult(msgspec.Struct, frozen=True, kw_only=True):
    """`state` is "ok", "missing" (an extra that nobody must have) or "bad"."""

    what: str
    state: str
    detail: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print the findings as the last line")


def run(options: argparse.Namespace) -> int:
    machine = describe_machine()
    _print_line(_format_heading(machine))
    findings: list[CheckResult] = []
    for look in (lambda: [_check_python()], check_packages, check_caches, check_weights):
        for finding in look():
            findings.append(finding)
            _print_line(_format_line(finding))
    _print_line(DRIVING)
    findings.append(drive_farm(findings))
    _print_line(_format_line(findings[-1]))
    ok = all(finding.state != "bad" for finding in findings)
    _print_line("OK" if ok else "NOT OK: mend what is called bad above")
    if options.json:
        result = {
            "ok": ok,
            "version": __version__,
            "machine": machine,
            "findings": msgspec.to_builtins(findings),
        }
        sys.stdout.write(json.dumps(result) + "\n")
    return 0 if ok else 1


def describe_machine() -> dict[str, Any]:
    """Describe the machine; null where the system does not say."""
    memory_bytes = None
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        memory_bytes = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return {
        "system": platform.platform(),
        "cpu": _read_cpu_name(),
        "cpus_usable": usable_cpus(),
        "memory_gib": round(memory_bytes / 2**30, 1) if memory_bytes else None,
    }


def check_packages() -> Iterator[CheckResult]:
    """Check the packages by extra; only what every robot needs can be bad."""
    try:
        wanted = list(extras.read_requirements())
    except importlib.metadata.PackageNotFoundError:
        detail = "is imported but not installed; pip install . in its folder"
        yield CheckResult(what="agribot", state="bad", detail=detail)
        return
    for one in wanted:
        if one.extra != extras.FOR_CONTRIBUTORS:
            yield _check_package(one)


def _check_package(wanted: extras.Requirement) -> CheckResult:
    name, least, extra = wanted.package, wanted.least, wanted.extra
    source = f"agribot[{extra}]" if extra else "agribot"
    absent = "missing" if extra else "bad"
    try:
        version = importlib.metadata.version(name)
        importlib.import_module(wanted.module)
    except importlib.metadata.PackageNotFoundError:
        return CheckResult(
            what=name, state=absent, detail=f"not installed; pip install '{source}' brings it"
        )
    except (ImportError, OSError) as error:
        detail = f"is installed but cannot be loaded: {error}; reinstall it"
        return CheckResult(what=name, state="bad", detail=detail)
    if least is not None and _parse_version(version) < _parse_version(least):
        return CheckResult(
            what=name,
            state="bad",
            detail=f"{version} is older than {least}; pip install --upgrade '{source}'",
        )
    return CheckResult(
        what=name, state="ok", detail=version + (f" (extra {extra})" if extra else "")
    )


def _parse_version(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])


def _check_python() -> CheckResult:
    if sys.version_info[:2] < LEAST_PYTHON:
        least = ".".join(str(part) for part in LEAST_PYTHON)
        detail = f"{platform.python_version()} is older than {least}; install a newer one"
        return CheckResult(what="python", state="bad", detail=detail)
    return CheckResult(what="python", state="ok", detail=platform.python_version())


def check_caches() -> list[CheckResult]:
    """Check the folders for compiled code: without one, every start compiles anew."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    beside = Path(__file__).parents[1] / "sim"
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    for folder in (Path(named),) if named else (beside, home):
        if _is_writable(folder):
            return [CheckResult(what="cache of compiled code", state="ok", detail=str(folder))]
    tried = named or f"{beside} and {home}"
    detail = (
        f"cannot write into {tried}: every start takes some ten seconds longer; "
        "set NUMBA_CACHE_DIR to a folder that you may write"
    )
    return [CheckResult(what="cache of compiled code", state="missing", detail=detail)]


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def check_weights() -> Iterator[CheckResult]:
    """Check that every packaged network opens and is the file that its card describes."""
    from agribot.autonomy.perceive.segmenter import Segmenter, model_names, model_path

    names = model_names()
    for name in names:
        path = model_path(name)
        try:
            height, width = Segmenter(path).map_shape
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            card = path.with_suffix(".json")
            known = json.loads(card.read_text("utf-8")).get("sha256") if card.is_file() else None
        except (AgribotError, ImportError, OSError, ValueError) as error:
            yield CheckResult(what=f"network {name}", state="bad", detail=str(error))
            continue
        if known is not None and known != digest:
            detail = f"{path} is not the file that its card describes; install agribot again"
            yield CheckResult(what=f"network {name}", state="bad", detail=detail)
            continue
        detail = f"{width} x {height} px, {digest[:12]}" + ("" if known else ", no card beside it")
        yield CheckResult(what=f"network {name}", state="ok", detail=detail)
    if not names:
        detail = "there are none in the package; make them: agribot train --out DIR"
        yield CheckResult(what="networks", state="bad", detail=detail)


def drive_farm(findings: list[CheckResult]) -> CheckResult:
    """Drive the farm for a second with camera and network, where the simulator is installed."""
    what = "one second on the farm"
    absent = [f.what for f in findings if f.state != "ok" and f.what in ("mujoco-core", "numba")]
    if absent:
        return CheckResult(what=what, state="missing", detail=f"needs {' and '.join(absent)}")
    from agribot.app.simulated_run import simulate
    from agribot.core import config

    wall_s, cpu_s = time.monotonic(), time.process_time()
    try:
        settings = config.load("farm", [f"duration_s={SELF_CHECK_S}", "record.enabled=false"])
        with (
            tempfile.TemporaryDirectory() as folder,
            simulate(settings, Path(folder)) as session,
        ):
            ticks = sum(1 for _ in session.ticks())
            frames = session.meter.frames if session.meter is not None else 0
    except (AgribotError, ImportError, OSError) as error:
        return CheckResult(what=what, state="bad", detail=str(error))
    wall_s, cpu_s = time.monotonic() - wall_s, time.process_time() - cpu_s
    detail = f"{ticks} ticks, {frames} camera frames; {wall_s:.1f} s, {cpu_s:.1f} CPU s with start"
    if ticks < SELF_CHECK_S * settings.tick_hz or not frames:
        return CheckResult(
            what=what, state="bad", detail=f"{detail}: too few; run agribot run farm"
        )
    return CheckResult(what=what, state="ok", detail=detail)


def _read_cpu_name() -> str | None:
    try:
        text = Path("/proc/cpuinfo").read_text("utf-8")
    except OSError:
        return platform.processor() or None
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return found[1] if found else platform.processor() or None


def _format_heading(machine: dict[str, Any]) -> str:
    memory = "?" if machine["memory_gib"] is None else machine["memory_gib"]
    return (
        f"agribot {__version__} on {machine['system']}\n"
        f"{machine['cpu'] or 'unknown CPU'}, {machine['cpus_usable']} usable CPUs, {memory} GiB"
    )


def _format_line(finding: CheckResult) -> str:
    return f"{finding.state:8} {finding.what}: {finding.detail}"


def _print_line(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()
