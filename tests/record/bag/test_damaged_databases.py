"""rosbag2 databases with damaged pages, cut off, or with a log beside them."""

from __future__ import annotations

import re
import shutil
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from rosbags import rosbag2
from rosbags.rosbag2 import StoragePlugin

from agribot.cli.main import main
from agribot.record.bag.definitions import ros2_store
from agribot.record.bag.info import read_info
from agribot.record.bag.opening import open_bag
from agribot.record.damage import Damage, collect_damage
from tests import nightly
from tests.record import damaged_files
from tests.record.bag import bag_samples as samples

PAGE_BYTES = 4096


def _read(path: Path) -> tuple[set[tuple[int, bytes]], list[Damage]]:
    with collect_damage() as found, open_bag(path) as bag:
        return {(message.log_ns, message.data) for message in bag.messages()}, found


def _write(folder: Path, count: int = 2000) -> Path:
    samples.write_rosbag2(folder, count=count)
    return folder / f"{folder.name}.db3"


def _list_leaves(path: Path) -> list[int]:
    """List the offsets of the pages that hold messages, by their ids."""
    data = path.read_bytes()
    with closing(sqlite3.connect(path)) as database:
        (root,) = database.execute(
            "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        ).fetchone()
    at = (root - 1) * PAGE_BYTES
    assert data[at] == 5, "an interior page"
    cells = int.from_bytes(data[at + 3 : at + 5], "big")
    pointers = [int.from_bytes(data[at + 12 + 2 * i :][:2], "big") for i in range(cells)]
    children = [int.from_bytes(data[at + pointer :][:4], "big") for pointer in pointers]
    last = int.from_bytes(data[at + 8 : at + 12], "big")
    return [(page - 1) * PAGE_BYTES for page in (*children, last)]


@pytest.mark.parametrize("number", [0, 3, -2, -1])
def test_the_messages_behind_a_page_of_zeros_are_read_and_those_in_it_counted(
    number: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = _write(tmp_path / "bag")
    whole, _ = _read(path)
    data, at = bytearray(path.read_bytes()), _list_leaves(path)[number]
    data[at : at + PAGE_BYTES] = bytes(PAGE_BYTES)
    path.write_bytes(data)
    read, (damage,) = _read(path)
    lost = whole - read
    assert read < whole and 5 < len(lost) < 60
    assert damage.lost_messages == (None if number == -1 else len(lost))
    times_ns = [t_ns for t_ns, _ in lost]
    assert damage.after_ns is None or damage.after_ns < min(times_ns)
    assert damage.before_ns is None or damage.before_ns > max(times_ns)
    assert main(["bag", "csv", str(path), "/fix", "-o", str(tmp_path / "fix.csv")]) == 1
    assert f"note: {damage.describe()}" in capsys.readouterr().err


def test_damaged_indexes_cost_no_message(tmp_path: Path) -> None:
    path = _write(tmp_path / "bag")
    whole, _ = _read(path)
    with closing(sqlite3.connect(path)) as database:
        (root,) = database.execute(
            "SELECT rootpage FROM sqlite_master WHERE name = 'timestamp_idx'"
        ).fetchone()
    data = bytearray(path.read_bytes())
    data[(root - 1) * PAGE_BYTES : root * PAGE_BYTES] = bytes(PAGE_BYTES)
    path.write_bytes(data)
    read, (damage,) = _read(path)
    assert read == whole
    assert damage.describe() == "bag.db3: the database is damaged; no message is missing"


def test_bytes_that_change_anywhere_give_all_sound_messages_or_a_refusal(tmp_path: Path) -> None:
    path = _write(tmp_path / "bag", count=400)
    sound, (whole, _) = path.read_bytes(), _read(path)
    for seed in range(30):
        rng = np.random.default_rng(seed)
        start = int(rng.integers(3 * PAGE_BYTES, len(sound) - 512))
        path.write_bytes(sound[:start] + rng.bytes(512) + sound[start + 512 :])
        read, damages = _read(path)
        assert len(read & whole) > 300, seed
        assert damages or len(read) == len(whole), seed


@nightly.all_or_first("seeds", (15, 14, 13, 16), in_suite=1)  # pages of 15 lead in circles
def test_many_damaged_places_end_no_reader_and_nothing_is_lost_in_silence(
    tmp_path: Path, seeds: Sequence[int]
) -> None:
    path = _write(tmp_path / "bag", count=300)
    sound = path.read_bytes()
    kinds: tuple[damaged_files.Kind, ...] = ("flip", "zero", "random")
    for seed in seeds:
        rng, data = np.random.default_rng(seed), sound
        for _ in range(4):
            tail, _, _ = damaged_files.damage(data[3 * PAGE_BYTES :], kinds[rng.integers(3)], rng)
            data = data[: 3 * PAGE_BYTES] + tail
        path.write_bytes(data)
        read, damages = _read(path)
        assert len(read) == 300 or damages, seed
        assert read_info(path).messages >= len(read), seed


def test_a_database_that_was_cut_off_is_read_up_to_the_cut(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = _write(tmp_path / "bag")
    whole, _ = _read(path)
    path.write_bytes(path.read_bytes()[: _list_leaves(path)[-8]])
    read, (damage,) = _read(path)
    assert read < whole and len(read) > 0.5 * len(whole)
    assert damage.is_end and damage.after_ns == max(t_ns for t_ns, _ in read)
    assert main(["bag", "info", str(path)]) == 0
    assert "its end is cut off; messages after" in capsys.readouterr().out


@pytest.mark.parametrize("is_folder", [True, False])
def test_messages_in_the_log_of_a_recorder_that_died_are_read(
    is_folder: bool, tmp_path: Path
) -> None:
    path = _write(tmp_path / "bag", count=50)
    whole, _ = _read(path)
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute(
            "INSERT INTO messages (topic_id, timestamp, data)"
            " SELECT topic_id, timestamp + 1000000000000, data FROM messages"
        )
        database.commit()
        left = tmp_path / "left"
        left.mkdir()
        for file in path.parent.iterdir():
            if not file.name.endswith("-shm"):
                shutil.copy(file, left)
    before = sorted(left.iterdir())
    read, damages = _read(left if is_folder else left / path.name)
    assert (len(read), damages) == (2 * len(whole), [])
    assert read_info(left / path.name).messages == 2 * len(whole)
    assert sorted(left.iterdir()) == before


@pytest.mark.parametrize("state", ["gone", "empty", "garbage"])
def test_a_folder_is_read_without_a_file_that_is_gone_or_cannot_be_read(
    state: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, store = tmp_path / "drive", ros2_store()
    with rosbag2.Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        fix = writer.add_connection("/fix", "sensor_msgs/msg/NavSatFix", typestore=store)
        for index in range(50):
            t_ns = samples.START_NS + index * samples.STEP_NS
            data = store.serialize_cdr(samples.nav_sat_fix(store, t_ns), fix.msgtype)
            writer.write(fix, t_ns, data)
    shutil.copy(folder / "drive.mcap", folder / "drive_1.mcap")
    about = folder / "metadata.yaml"
    both = r"\1drive.mcap\n\1drive_1.mcap"
    text = re.sub(r"(?m)^( *- )drive\.mcap$", both, about.read_text(), count=1)
    about.write_text(text.replace("message_count: 50", "message_count: 100"))
    assert (read_info(folder).messages, read_info(folder).damage) == (100, ())
    part = folder / "drive_1.mcap"
    if state == "gone":
        part.unlink()
    else:
        part.write_bytes(b"" if state == "empty" else b"garbage" * 100)
    assert main(["bag", "info", str(folder)]) == 1
    said = capsys.readouterr().out
    assert "50 messages in" in said and "drive_1.mcap" in said
    assert ("50 messages are missing" in said) == (state == "gone")


def test_a_folder_that_holds_fewer_messages_than_its_description_says_is_damaged(
    tmp_path: Path,
) -> None:
    samples.write_rosbag2(tmp_path / "bag")
    with closing(sqlite3.connect(tmp_path / "bag" / "bag.db3")) as database:
        database.execute("DELETE FROM messages WHERE id > 40")
        database.commit()
    (said,) = read_info(tmp_path / "bag").damage
    assert said == "bag: metadata.yaml names 50 messages, 40 are there; 10 messages are missing"
