"""The doctor tells a healthy machine from a sick one, and what would help."""

from __future__ import annotations

import importlib.metadata
import json
from pathlib import Path
from typing import Any

import pytest

from agribot.cli import doctor
from agribot.cli.main import main


def examined(capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    status = main(["doctor", "--json"])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    return status, {finding["what"]: finding for finding in result["findings"]}


def test_a_machine_that_can_run_the_farm_is_well(capsys: pytest.CaptureFixture[str]) -> None:
    status, findings = examined(capsys)
    assert status == 0
    assert findings["numpy"]["detail"] == importlib.metadata.version("numpy")
    assert findings["network agribot-sim"]["state"] == "ok"
    assert "50 ticks" in findings["one second on the farm"]["detail"]


@pytest.fixture
def without_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    """The drive on the farm is slow and not what these tests are about."""
    quiet = doctor.CheckResult(what="one second on the farm", state="ok", detail="")
    monkeypatch.setattr(doctor, "drive_farm", lambda _: quiet)


def require(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: list(lines))


@pytest.mark.usefixtures("without_drive")
def test_a_missing_extra_is_no_illness_but_a_missing_requirement_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    require(monkeypatch, 'no-such-thing-9>=2.4; extra == "train"', "numpy>=1.26")
    status, findings = examined(capsys)
    assert (status, findings["no-such-thing-9"]["state"]) == (0, "missing")
    assert "agribot[train]" in findings["no-such-thing-9"]["detail"]
    require(monkeypatch, "no-such-thing-9>=2.4", "numpy>=1.26")
    status, findings = examined(capsys)
    assert (status, findings["no-such-thing-9"]["state"]) == (1, "bad")


@pytest.mark.usefixtures("without_drive")
def test_a_version_that_is_too_old_is_named_with_the_least_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    require(monkeypatch, "numpy>=99.1")
    status, findings = examined(capsys)
    assert (status, findings["numpy"]["state"]) == (1, "bad")
    assert "99.1" in findings["numpy"]["detail"]


@pytest.mark.usefixtures("without_drive")
def test_broken_weights_are_found(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    broken = tmp_path / "agribot-sim.onnx"
    broken.write_bytes(b"no network")
    monkeypatch.setattr("agribot.autonomy.perceive.segmenter.model_path", lambda _: broken)
    status, findings = examined(capsys)
    assert (status, findings["network agribot-sim"]["state"]) == (1, "bad")


@pytest.mark.usefixtures("without_drive")
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
    absent = doctor.CheckResult(what="numba", state="missing", detail="")
    finding = doctor.drive_farm([absent])
    assert finding.state == "missing"
    assert "numba" in finding.detail


def test_every_finding_is_told_as_soon_as_it_is_known(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said: dict[str, str] = {}

    def look(name: str) -> list[doctor.CheckResult]:
        said[name] = capsys.readouterr().err
        return [doctor.CheckResult(what=name, state="ok", detail="")]

    for name in ("packages", "caches", "weights"):
        monkeypatch.setattr(doctor, f"check_{name}", lambda name=name: look(name))
    monkeypatch.setattr(doctor, "drive_farm", lambda _: look("drive")[0])
    assert main(["doctor"]) == 0
    assert "usable CPUs" in said["packages"]
    assert "python" in said["packages"]
    assert "packages" in said["caches"]
    assert "weights" in said["drive"]
    assert doctor.DRIVING in said["drive"]
    assert capsys.readouterr().err.splitlines()[-1] == "OK"
