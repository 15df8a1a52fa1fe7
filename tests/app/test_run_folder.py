"""A run never overwrites a run, nor do two drive in one folder."""

from __future__ import annotations

import errno
import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from agribot.app.run_folder import (
    LOCK_NAME,
    MADE_FILES,
    RUN_FILES,
    RunFolder,
    check_not_driven,
    clear_run,
)
from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.cli.main import main
from agribot.core import config
from agribot.core.errors import RecordingError

HOLDER = """
import sys
from pathlib import Path
from agribot.app.run_folder import RunFolder
folder = RunFolder(Path(sys.argv[1]))
print("claimed", flush=True)
sys.stdin.read()
"""


FIELD = str(Path(__file__).parents[2] / "examples" / "field.geojson")
QUICK = ["perception.enabled=false", 'world="empty"', "field.start_map_m=[0,0]"]


class FullDisk(io.FileIO):
    def write(self, _: Any) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def fill_disk(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """It has no room for the file of this name, also under the name it has until it is whole."""
    open_file = Path.open

    def open_full(path: Path, mode: str = "r", *rest: Any, **more: Any) -> Any:
        if name in path.name and mode[0] in "wx":
            return FullDisk(path, mode[0])
        return open_file(path, mode, *rest, **more)

    monkeypatch.setattr(Path, "open", open_full)


def field_plan(folder: Path) -> str:
    path = folder / "made.geojson"
    assert main(["plan", "--field", FIELD, "--implement-width", "0.9", "--out", str(path)]) == 0
    return path.read_text()


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("name", RUN_FILES)
def test_a_folder_with_any_file_of_a_run_is_refused_and_not_touched(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(b"of an earlier run")
    with pytest.raises(RecordingError, match=f"holds a run already.*{name}.*another --out"):
        RunFolder(tmp_path)
    assert contents(tmp_path) == {name: b"of an earlier run"}


@pytest.mark.parametrize("name", MADE_FILES)
def test_files_of_a_person_that_a_run_would_overwrite_are_refused_and_not_touched(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(b"of a person")
    with pytest.raises(RecordingError, match=f"holds files that a run writes.*{name}.*move them"):
        RunFolder(tmp_path)
    assert contents(tmp_path) == {name: b"of a person"}


@pytest.mark.figures
def test_a_world_alone_writes_none_of_them_and_takes_such_a_folder(tmp_path: Path) -> None:
    (tmp_path / "map.png").write_bytes(b"of a person")
    quick = ["sim", "--world", "empty", "--for", "0.1", "--speed", "max", "--out", str(tmp_path)]
    assert main(quick) == 0
    assert (tmp_path / "map.png").read_bytes() == b"of a person"


def test_a_field_is_not_planned_over_the_plan_of_a_person(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "plan.geojson").write_bytes(b"of a person")
    wanted = ["run", "farm", "--headless", "--field", FIELD, "--out", str(tmp_path)]
    assert main(wanted) == 2
    assert "holds files that a run writes (plan.geojson)" in capsys.readouterr().err
    with pytest.raises(RecordingError, match="holds files"):  # also one that appears at the start
        simulate(config.load("farm", QUICK), tmp_path, plan_text=field_plan(tmp_path / "planned"))
    assert (tmp_path / "plan.geojson").read_bytes() == b"of a person"


@pytest.mark.parametrize("name", ["config.toml", "plan.geojson", "run.mcap"])
def test_a_start_that_fails_on_the_disk_gives_the_folder_back(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, plan = tmp_path / "run", field_plan(tmp_path / "planned")

    def start() -> SimulatedRun:
        return simulate(config.load("farm", QUICK), folder, plan_text=plan)

    with monkeypatch.context() as broken:
        fill_disk(broken, name)
        with pytest.raises(RecordingError, match=rf"cannot .*{name}"):
            start()
    assert not folder.exists()
    folder.mkdir()
    (folder / "notes.txt").write_bytes(b"of a person")
    with monkeypatch.context() as broken:
        fill_disk(broken, name)
        with pytest.raises(RecordingError, match=rf"cannot .*{name}"):
            start()
    assert contents(folder) == {"notes.txt": b"of a person"}
    with start():
        assert (folder / "plan.geojson").read_text() == plan


def test_the_command_refuses_in_one_line_and_names_the_way_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mission.json").write_bytes(b"{}")
    assert main(["run", "farm", "--headless", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"agribot run --resume {tmp_path}" in said
    assert contents(tmp_path) == {"mission.json": b"{}"}


def test_a_world_alone_spares_a_run_as_well(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.mcap").write_bytes(b"of an earlier run")
    assert main(["sim", "--world", "empty", "--for", "1", "--out", str(tmp_path)]) == 2
    assert "holds a run already" in capsys.readouterr().err
    assert contents(tmp_path) == {"run.mcap": b"of an earlier run"}


def test_a_session_from_python_is_refused_too(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"of an earlier run")
    with pytest.raises(RecordingError, match="holds a run already"):
        simulate(config.load("farm", ["perception.enabled=false"]), tmp_path)
    assert contents(tmp_path) == {"run.mcap": b"of an earlier run"}


def test_a_session_that_never_ticked_leaves_no_folder(tmp_path: Path) -> None:
    """What kept it from driving, such as a port that is taken, can be fixed and tried again."""
    with simulate(config.load("farm", ["perception.enabled=false"]), tmp_path / "run"):
        assert (tmp_path / "run" / "config.toml").exists()
    assert not (tmp_path / "run").exists()


def test_two_at_once_in_one_folder_are_refused_until_the_first_lets_go(tmp_path: Path) -> None:
    first = RunFolder(tmp_path / "run")
    with pytest.raises(RecordingError, match="another agribot drives a run"):
        RunFolder(tmp_path / "run")
    with pytest.raises(RecordingError, match="another agribot drives a run"):
        check_not_driven(tmp_path / "run")
    first.close()
    first.close()
    assert contents(tmp_path / "run") == {}
    RunFolder(tmp_path / "run").close()


def test_a_killed_process_holds_no_folder(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLDER, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"claimed\n"
        with pytest.raises(RecordingError, match="another agribot"):
            RunFolder(tmp_path)
        holder.kill()
    assert (tmp_path / LOCK_NAME).exists()
    check_not_driven(tmp_path)
    RunFolder(tmp_path).close()


def test_a_run_to_be_repeated_is_cleared_but_not_under_its_driver(tmp_path: Path) -> None:
    driver = RunFolder(tmp_path)
    (tmp_path / "run.mcap").write_bytes(b"half a run")
    with pytest.raises(RecordingError, match="another agribot"):
        clear_run(tmp_path)
    driver.close()
    (tmp_path / "notes.txt").write_bytes(b"of a person")
    clear_run(tmp_path)
    assert contents(tmp_path) == {"notes.txt": b"of a person"}
