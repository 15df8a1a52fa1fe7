"""The doctor finds what is wrong with a machine, and says what would help."""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from agribot.cli.doctor import doctor, doctor_devices, doctor_machine, doctor_packages
from agribot.cli.doctor.doctor_findings import CheckResult
from agribot.cli.main import main


def examined(capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, dict[str, Any]]:
    status = main(["doctor", "--json", *options])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    return status, {finding["what"]: finding for finding in result["findings"]}


@pytest.fixture(autouse=True)
def healthy_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is plugged in here, and how full the disk is, is not what these tests are about."""
    for name in ("check_board", "check_disk", "check_clock", "check_heat"):
        monkeypatch.setattr(doctor_machine, name, lambda: iter(()))
    for name in ("check_devices", "check_gpsd"):
        monkeypatch.setattr(doctor_devices, name, lambda: iter(()))


def test_a_machine_that_can_run_the_farm_is_well(capsys: pytest.CaptureFixture[str]) -> None:
    status, findings = examined(capsys)
    assert status == 0
    assert findings["numpy"]["detail"] == importlib.metadata.version("numpy")
    assert findings["network agribot-sim"]["state"] == "ok"
    assert doctor_packages.DRIVE not in findings


def test_asked_for_everything_it_drives_on_the_farm(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor_packages, "check_packages", lambda loads: iter(()))
    status, findings = examined(capsys, "--full")
    assert status == 0
    assert "50 ticks" in findings[doctor_packages.DRIVE]["detail"]


def require(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: list(lines))


def test_a_missing_extra_is_no_illness_but_a_missing_requirement_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    require(monkeypatch, 'no-such-thing-9>=2.4; extra == "train"', "numpy>=1.26")
    status, findings = examined(capsys)
    assert (status, findings["extra train"]["state"]) == (0, "missing")
    assert "no-such-thing-9" in findings["extra train"]["detail"]
    assert "[train]" in findings["extra train"]["detail"]
    require(monkeypatch, "no-such-thing-9>=2.4", "numpy>=1.26")
    status, findings = examined(capsys)
    assert (status, findings["no-such-thing-9"]["state"]) == (1, "bad")


def test_a_version_that_is_too_old_is_named_with_the_least_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    require(monkeypatch, "numpy>=99.1")
    status, findings = examined(capsys)
    assert (status, findings["numpy"]["state"]) == (1, "bad")
    assert "99.1" in findings["numpy"]["detail"]


def test_broken_weights_are_found(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    broken = tmp_path / "agribot-sim.onnx"
    broken.write_bytes(b"no network")
    monkeypatch.setattr("agribot.autonomy.perceive.segmenter.model_path", lambda _: broken)
    status, findings = examined(capsys)
    assert (status, findings["network agribot-sim"]["state"]) == (1, "bad")


def test_without_a_place_for_compiled_code_the_start_is_only_slow(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    occupied = tmp_path / "file"
    occupied.write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(occupied / "cache"))
    status, findings = examined(capsys)
    assert status == 0
    assert "NUMBA_CACHE_DIR" in findings["cache of compiled code"]["detail"]


def test_without_the_simulator_the_drive_is_left_out() -> None:
    absent = CheckResult(what="numba", state="missing", detail="")
    finding = doctor_packages.drive_farm([absent])
    assert finding.state == "missing"
    assert "numba" in finding.detail


def test_what_belongs_to_an_extra_is_not_loaded_unless_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    require(monkeypatch, "numpy>=1.26", 'torch>=2.4; extra == "train"')
    loaded: list[str] = []
    monkeypatch.setattr(importlib, "import_module", loaded.append)
    list(doctor_packages.check_packages(loads=False))
    assert loaded == ["numpy"]
    list(doctor_packages.check_packages(loads=True))
    assert loaded == ["numpy", "numpy", "torch"]


def test_a_warning_does_not_make_the_answer_no(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for state, expected in (("warning", 0), ("bad", 1)):
        finding = CheckResult(what="heat", state=state, detail="")  # type: ignore[arg-type]
        monkeypatch.setattr(doctor_machine, "check_heat", lambda finding=finding: iter([finding]))
        assert examined(capsys)[0] == expected


def test_every_finding_is_told_as_soon_as_it_is_known(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said: dict[str, str] = {}

    def look(name: str, **_: bool) -> Iterator[CheckResult]:
        said[name] = capsys.readouterr().err
        yield CheckResult(what=name, state="ok", detail="")

    for name in ("packages", "caches", "weights"):
        check = functools.partial(look, name)
        monkeypatch.setattr(doctor_packages, f"check_{name}", check)
    monkeypatch.setattr(doctor_packages, "drive_farm", lambda _: next(look("drive")))
    assert main(["doctor", "--full"]) == 0
    assert "usable CPUs" in said["packages"]
    assert "python" in said["packages"]
    assert "packages" in said["caches"]
    assert "weights" in said["drive"]
    assert doctor.DRIVING in said["drive"]
    assert capsys.readouterr().err.splitlines()[-1] == "OK"


def test_the_first_line_comes_before_anything_is_loaded() -> None:
    code = (
        "import sys\nfrom types import SimpleNamespace\n"
        "from agribot.cli.doctor import doctor\n"
        "class Stop(Exception): pass\n"
        "def stop(text): raise Stop\n"
        "doctor.print_line = stop\n"
        "try: doctor.run(SimpleNamespace(original=False))\n"
        "except Stop: print(*{'numpy', 'msgspec', 'onnxruntime', 'socket'} & sys.modules.keys())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ
    )
    assert done.stdout.strip() == ""
