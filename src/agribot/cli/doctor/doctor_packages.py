"""What `agribot doctor` says of packages, networks and compiled code."""

from __future__ import annotations

import hashlib
import importlib
import importlib.metadata
import importlib.util
import json
import os
import re
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from agribot.cli.doctor.doctor_findings import CheckResult
from agribot.core import extras
from agribot.core.errors import AgribotError

SELF_CHECK_S = 1.0
DRIVE = "one second on the farm"


def check_packages(*, loads: bool) -> Iterator[CheckResult]:
    """Check the packages by extra; only what every robot needs can be bad.

    With `loads` each is imported, which finds a broken one and takes many seconds; without it
    only those of an extra stay unopened.
    """
    try:
        wanted = list(extras.read_requirements())
    except importlib.metadata.PackageNotFoundError:
        detail = "is imported but not installed; pip install . in its folder"
        yield CheckResult(what="agribot", state="bad", detail=detail)
        return
    absent: dict[str, list[str]] = {}
    for one in wanted:
        if one.extra == extras.FOR_CONTRIBUTORS:
            continue
        finding = _check_package(one, loads=loads or not one.extra)
        if finding.state == "missing" and not loads:
            absent.setdefault(one.extra, []).append(one.package)
        else:
            yield finding
    for extra, names in absent.items():
        detail = f"{', '.join(names)} not installed; {extras.format_install(extra)} brings it"
        yield CheckResult(what=f"extra {extra}", state="missing", detail=detail)


def _check_package(wanted: extras.Requirement, *, loads: bool) -> CheckResult:
    name, least, extra = wanted.package, wanted.least, wanted.extra
    install = extras.format_install(extra)
    try:
        version = importlib.metadata.version(name)
        if loads:
            importlib.import_module(wanted.module)
    except importlib.metadata.PackageNotFoundError:
        return CheckResult(
            what=name,
            state="missing" if extra else "bad",
            detail=f"not installed; {install} brings it",
        )
    except (ImportError, OSError) as error:
        detail = f"is installed but cannot be loaded: {error}; reinstall it"
        return CheckResult(what=name, state="bad", detail=detail)
    if least is not None and _parse_version(version) < _parse_version(least):
        return CheckResult(
            what=name,
            state="bad",
            detail=f"{version} is older than {least}; {install} --upgrade",
        )
    return CheckResult(
        what=name, state="ok", detail=version + (f" (extra {extra})" if extra else "")
    )


def _parse_version(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])


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
        detail = "the package has no networks; make them: agribot train --out DIR"
        yield CheckResult(what="networks", state="bad", detail=detail)


def check_caches() -> Iterator[CheckResult]:
    """Check the folders for the simulator's compiled code: without one, every start compiles."""
    if importlib.util.find_spec("numba") is None:
        return
    named = os.environ.get("NUMBA_CACHE_DIR")
    beside = Path(__file__).parents[2] / "sim"
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    for folder in (Path(named),) if named else (beside, home):
        if _is_writable(folder):
            yield CheckResult(what="cache of compiled code", state="ok", detail=str(folder))
            return
    tried = named or f"{beside} and {home}"
    detail = (
        f"cannot write into {tried}: every start takes some ten seconds longer; "
        "set NUMBA_CACHE_DIR to a folder that you may write"
    )
    yield CheckResult(what="cache of compiled code", state="missing", detail=detail)


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def drive_farm(findings: Sequence[CheckResult]) -> CheckResult:
    """Drive the farm for a second with camera and network, where the simulator is installed."""
    absent = [f.what for f in findings if f.state != "ok" and f.what in ("mujoco-core", "numba")]
    if absent:
        return CheckResult(what=DRIVE, state="missing", detail=f"needs {' and '.join(absent)}")
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
        return CheckResult(what=DRIVE, state="bad", detail=str(error))
    wall_s, cpu_s = time.monotonic() - wall_s, time.process_time() - cpu_s
    detail = f"{ticks} ticks, {frames} camera frames; {wall_s:.1f} s, {cpu_s:.1f} CPU s with start"
    if ticks < SELF_CHECK_S * settings.tick_hz or not frames:
        return CheckResult(
            what=DRIVE, state="bad", detail=f"{detail}: too few; run agribot run farm"
        )
    return CheckResult(what=DRIVE, state="ok", detail=detail)
