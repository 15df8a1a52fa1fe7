"""What a path leads to is written, and nothing that others put there is replaced by the way."""

from __future__ import annotations

import errno
import os
import stat
import threading
from pathlib import Path

import pytest

from agribot.core.errors import RecordingError
from agribot.core.whole_file import make_at_once, write_at_once
from agribot.record.report import write_file


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_link_stays_a_link_and_its_target_is_written(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    target, link = tmp_path / "disk" / "plan.geojson", tmp_path / "latest.geojson"
    target.write_bytes(b"older")
    link.symlink_to(target)
    write_file(link, b"newer")
    assert link.is_symlink()
    assert target.read_bytes() == b"newer"
    assert names(tmp_path / "disk") == ["plan.geojson"]
    assert names(tmp_path) == ["disk", "latest.geojson"]


def test_a_link_to_what_is_not_there_yet_makes_it(tmp_path: Path) -> None:
    link = tmp_path / "latest.geojson"
    link.symlink_to("plan.geojson")
    write_file(link, b"new")
    assert link.is_symlink()
    assert (tmp_path / "plan.geojson").read_bytes() == b"new"


def test_the_reader_of_a_pipe_gets_it_and_the_pipe_stays(tmp_path: Path) -> None:
    pipe = tmp_path / "plan.geojson"
    os.mkfifo(pipe)
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()), daemon=True)
    reader.start()
    write_file(pipe, b"the plan")
    reader.join(60.0)
    assert got == [b"the plan"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert names(tmp_path) == ["plan.geojson"]


def test_a_device_takes_it_and_stays_a_device() -> None:
    write_file(Path(os.devnull), b"discarded")
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_an_older_file_keeps_its_permissions(mode: int, tmp_path: Path) -> None:
    path = tmp_path / "plan.geojson"
    path.write_bytes(b"older")
    path.chmod(mode)
    write_file(path, b"newer")
    assert path.read_bytes() == b"newer"
    assert stat.S_IMODE(path.stat().st_mode) == mode


def test_a_new_file_has_the_permissions_that_any_program_gives(tmp_path: Path) -> None:
    write_file(tmp_path / "ours", b"")
    (tmp_path / "any").write_bytes(b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "any").stat().st_mode


def test_other_files_beside_it_are_not_touched(tmp_path: Path) -> None:
    others = ("plan.geojson.new", "plan.new", "plan.geojson.part")
    for name in others:
        (tmp_path / name).write_bytes(b"of a person")
    write_file(tmp_path / "plan.geojson", b"the plan")
    assert [(tmp_path / name).read_bytes() for name in others] == [b"of a person"] * 3
    assert names(tmp_path) == sorted((*others, "plan.geojson"))


@pytest.mark.parametrize("refusal", [errno.EACCES, errno.EROFS])
def test_a_file_in_a_folder_that_takes_no_other_one_is_written(
    refusal: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "plan.geojson"
    path.write_bytes(b"older")

    def refuse(*_: object) -> None:
        raise OSError(refusal, os.strerror(refusal))

    monkeypatch.setattr("agribot.core.whole_file._write_new", refuse)
    write_file(path, b"newer")
    assert path.read_bytes() == b"newer"
    with pytest.raises(RecordingError, match=r"cannot write .*another\.geojson"):
        write_file(tmp_path / "another.geojson", b"new")


def test_a_file_that_cannot_be_finished_leaves_the_older_one_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "plan.geojson"
    path.write_bytes(b"older")

    def fail(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(OSError, match="No space left"):
        write_at_once(path, b"newer", is_synced=True)
    assert path.read_bytes() == b"older"
    assert names(tmp_path) == ["plan.geojson"]


def test_a_name_as_long_as_names_may_be_is_written(tmp_path: Path) -> None:
    path = tmp_path / ("é" * 120 + ".geojson")
    write_file(path, b"the plan")
    assert path.read_bytes() == b"the plan"


def test_a_file_made_by_a_library_takes_the_place_of_the_older_one_when_it_is_whole(
    tmp_path: Path,
) -> None:
    path = tmp_path / "farm.mbtiles"
    path.write_bytes(b"older")

    def make(beside: Path) -> None:
        beside.write_bytes(b"half")
        assert path.read_bytes() == b"older"
        beside.write_bytes(b"whole")

    make_at_once(path, make)
    assert path.read_bytes() == b"whole"
    assert names(tmp_path) == ["farm.mbtiles"]


def test_a_long_file_goes_through_links_and_pipes_and_keeps_permissions(tmp_path: Path) -> None:
    target, link, pipe = tmp_path / "fix.csv", tmp_path / "latest.csv", tmp_path / "pipe.csv"
    target.write_bytes(b"older")
    target.chmod(0o600)
    link.symlink_to(target)
    make_at_once(link, lambda beside: beside.write_bytes(b"newer"))
    assert link.is_symlink()
    assert target.read_bytes() == b"newer"
    assert stat.S_IMODE(target.stat().st_mode) == 0o600
    os.mkfifo(pipe)
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()), daemon=True)
    reader.start()
    make_at_once(pipe, lambda beside: beside.write_bytes(b"rows"))
    reader.join(60.0)
    assert got == [b"rows"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_file_that_a_library_cannot_make_leaves_the_older_one_and_nothing_else(
    tmp_path: Path,
) -> None:
    path = tmp_path / "farm.mbtiles"
    path.write_bytes(b"older")

    def fail(beside: Path) -> None:
        beside.write_bytes(b"half")
        raise ValueError("not a map")

    with pytest.raises(ValueError, match="not a map"):
        make_at_once(path, fail)
    assert path.read_bytes() == b"older"
    assert names(tmp_path) == ["farm.mbtiles"]


def test_what_a_killed_program_left_beside_a_file_is_gone_after_the_next_try(
    tmp_path: Path,
) -> None:
    path = tmp_path / "farm.mbtiles"

    def make(beside: Path) -> None:
        assert not beside.exists()
        beside.write_bytes(b"whole")

    (tmp_path / ".farm.mbtiles.new").write_bytes(b"half")
    make_at_once(path, make)
    assert names(tmp_path) == ["farm.mbtiles"]
