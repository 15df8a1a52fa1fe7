from __future__ import annotations

import io
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType

from agribot.app.whole_job import series_of
from agribot.cli.main import main
from agribot.core.errors import RecordingError
from agribot.record.bag.info import read_info
from agribot.record.bag.opening import open_bag
from agribot.record.bag.track import read_track
from agribot.record.damage import Damage, DamagedRecording, collect_damage
from agribot.record.mcap_file import check_whole, find_damage
from agribot.record.mcap_parsing import read_bytes
from agribot.record.mcap_records import McapRecords
from agribot.record.recovery import recover
from agribot.record.replay import read_ticks
from agribot.record.report import RunOfJob
from agribot.record.series import collect
from agribot.ui.server.replay import Replay
from tests import nightly
from tests.record import damaged_files
from tests.record import record_samples as samples
from tests.record.bag.bag_samples import write_run
from tests.record.damaged_files import KINDS, Kind
from tests.record.test_crash_safety import record_run

SEEDS = range(25)


def _read(path: Path) -> tuple[set[tuple[int, bytes]], list[Damage]]:
    with collect_damage() as found, open_bag(path) as bag:
        return {(message.log_ns, message.data) for message in bag.messages()}, found


@nightly.all_or_first("seeds", SEEDS, in_suite=8)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("compression", list(CompressionType))
def test_all_messages_outside_of_damaged_chunks_are_read_and_the_gap_is_named(
    tmp_path: Path, compression: CompressionType, kind: Kind, seeds: Sequence[int]
) -> None:
    path = tmp_path / "run.mcap"
    damaged_files.write_mcap(path, compression)
    sound, chunks = path.read_bytes(), damaged_files.list_chunks(path)
    all_messages = {message for chunk in chunks for message in chunk.messages}
    for seed in seeds:
        data, start, end = damaged_files.damage(sound, kind, np.random.default_rng(seed))
        path.write_bytes(data)
        kept = {
            message
            for chunk in chunks
            if chunk.end <= start or chunk.start >= end
            for message in chunk.messages
        }
        read, damages = _read(path)
        assert kept <= read <= all_messages, seed
        for t_ns, _ in all_messages - read:
            assert any(_covers(damage, t_ns) for damage in damages), (seed, t_ns)


def _covers(damage: Damage, t_ns: int) -> bool:
    after_ns = -1 if damage.after_ns is None else damage.after_ns
    before_ns = 2**64 if damage.before_ns is None else damage.before_ns
    return damage.lost_messages != 0 and after_ns <= t_ns <= before_ns


@nightly.all_or_first("seeds", SEEDS, in_suite=8)
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_without_chunks_loses_no_more_than_the_damaged_messages(
    kind: Kind, seeds: Sequence[int], tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    damaged_files.write_mcap(path, use_chunking=False)
    sound, (whole, _) = path.read_bytes(), _read(path)
    for seed in seeds:
        data, start, end = damaged_files.damage(sound, kind, np.random.default_rng(seed))
        path.write_bytes(data)
        read, damages = _read(path)
        if kind != "cut":
            assert len(whole - read) <= 2 + (end - start) // 60, seed
        assert read == whole or any(damage.lost_messages != 0 for damage in damages), seed


@pytest.mark.parametrize("kind", KINDS)
def test_a_recovered_file_holds_what_could_be_read_of_the_damaged_one(
    kind: Kind, tmp_path: Path
) -> None:
    path, target = tmp_path / "run.mcap", tmp_path / "saved.mcap"
    damaged_files.write_mcap(path)
    sound = path.read_bytes()
    for seed in SEEDS[:10]:
        data, *_ = damaged_files.damage(sound, kind, np.random.default_rng(seed))
        path.write_bytes(data)
        saved = recover(path, target)
        read, damages = _read(path)
        again, repeated = _read(target)
        assert (again, saved.messages) == (read, len(read)), seed
        assert saved.has_gaps == any(damage.is_gap for damage in damages) == bool(repeated)
        target.unlink()


@pytest.fixture(scope="module")
def damaged_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Damage the third chunk of a run of ours, from 0.54 to 1.02 s."""
    path = tmp_path_factory.mktemp("damaged") / "run.mcap"
    write_run(path)
    damaged_files.flip_in_chunk(path, 2)
    return path


def _find_lost(path: Path) -> str:
    (damage,) = find_damage(path)
    assert damage.after_ns is not None and damage.before_ns is not None
    assert 0.5e9 < damage.after_ns < damage.before_ns < 1.1e9
    assert damage.lost_messages is not None and damage.lost_messages > 100
    return damage.describe()


def test_the_ticks_behind_a_damaged_chunk_are_read_with_a_warning(damaged_run: Path) -> None:
    with pytest.warns(DamagedRecording, match="messages from 0.50 to 1.00 s are missing"):
        times_s = [record.batch.t_s for record in read_ticks(damaged_run)]
    lost_s = {round(0.02 * (1 + index), 2) for index in range(150)} - {
        round(t_s, 2) for t_s in times_s
    }
    assert (min(lost_s), max(lost_s)) == (0.54, 1.02)
    assert times_s[-1] == pytest.approx(3.0)


@pytest.mark.parametrize(
    "command",
    [
        ["bag", "csv", "RUN", "/agribot/fix", "-o", "OUT.csv"],
        ["bag", "track", "RUN", "-o", "OUT.gpx"],
        ["bag", "convert", "RUN", "OUT.bag"],
        ["bag", "convert", "RUN", "OUT.mcap"],
        ["bag", "info", "RUN"],
        ["record", "recover", "RUN", "-o", "OUT.mcap"],
        ["report", "RUN", "-o", "OUT"],
    ],
    ids=lambda command: " ".join(command[:2] + command[-1:]),
)
def test_a_command_goes_on_behind_damage_and_says_what_is_missing(
    command: list[str], damaged_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = {"RUN": str(damaged_run), "OUT": str(tmp_path / "out")}
    words = [places.get(word, word.replace("OUT", places["OUT"])) for word in command]
    assert main(words) == 1
    said = capsys.readouterr()
    assert (said.out + said.err).count(f"note: {_find_lost(damaged_run)}") == 1


def test_a_recording_that_lacks_a_part_cannot_be_checked_nor_can_copies_of_it(
    damaged_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recovered, converted = tmp_path / "recovered.mcap", tmp_path / "converted.mcap"
    assert main(["record", "recover", str(damaged_run), "-o", str(recovered)]) == 1
    assert main(["bag", "convert", str(damaged_run), str(converted)]) == 1
    for path in (damaged_run, recovered, converted):
        assert main(["replay", "--check", str(path), "--json"]) == 2
        (result,) = json.loads(capsys.readouterr().out.splitlines()[-1])["recordings"]
        assert result["identical"] is None
        assert "s are missing" in result["error"]


def test_a_recording_that_ends_in_the_middle_cannot_be_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mcap"
    write_run(path)
    path.write_bytes(path.read_bytes()[: damaged_files.list_chunks(path)[4].start + 40])
    assert main(["replay", "--check", str(path)]) == 2
    assert "the file ends in the middle" in capsys.readouterr().out
    assert main(["bag", "track", str(path), "-o", str(tmp_path / "out.gpx")]) == 0
    assert "the file ends in the middle" in capsys.readouterr().err


def test_the_page_shows_when_a_recording_is_damaged(damaged_run: Path) -> None:
    replay = Replay.load(damaged_run, "run")
    (event,) = [event for event in replay.recorded_events if event.kind == "lost"]
    assert event.t_s == pytest.approx(0.54, abs=0.03)
    assert event.reason == _find_lost(damaged_run)


def test_the_page_shows_where_a_recording_was_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_run(path)
    path.write_bytes(path.read_bytes()[: damaged_files.list_chunks(path)[4].start + 40])
    (event,) = [e for e in Replay.load(path, "run").recorded_events if e.kind == "lost"]
    assert event.t_s == pytest.approx(1.52, abs=0.03)
    assert "the file ends in the middle" in event.reason


@pytest.mark.parametrize("kind", KINDS)
def test_every_reader_of_a_run_gives_the_ticks_of_sound_chunks_or_a_reason(
    kind: Kind, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    write_run(path)
    sound, chunks = path.read_bytes(), damaged_files.list_chunks(path)
    for seed in range(3):
        data, start, end = damaged_files.damage(sound, kind, np.random.default_rng(seed))
        path.write_bytes(data)
        kept = sum(chunk.end <= start or chunk.start >= end for chunk in chunks)
        ticks = [record.batch.t_s for record in read_ticks(path)]
        assert len(ticks) >= 24 * (kept - 1), seed
        assert read_info(path).messages > 0
        assert len(read_track(path, "/agribot/fix").points) >= 4 * (kept - 1)
        for read in (lambda: Replay.load(path, "run"), lambda: check_whole(path)):
            try:
                read()
            except RecordingError as error:
                assert "damaged" in str(error) or "cannot be checked" in str(error), seed
        if len(ticks) < 150:
            with pytest.raises(RecordingError, match="cannot be checked"):
                check_whole(path)


def test_the_report_of_a_job_says_what_the_recording_of_an_earlier_run_lacks(
    damaged_run: Path,
) -> None:
    own = collect(())
    earlier = [RunOfJob(folder=str(damaged_run.parent), run_s=3.0)]
    series, lost = series_of(earlier, own, damaged_run.parent)
    assert lost == [f"plots and table of rows: {_find_lost(damaged_run)}"]
    assert len(series.t_s) == 150 - 25


def test_damage_of_the_index_alone_loses_nothing(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    damaged_files.write_mcap(path)
    sound, _ = _read(path)
    data = bytearray(path.read_bytes())
    data[-100] ^= 1
    path.write_bytes(data)
    read, (damage,) = _read(path)
    assert read == sound
    assert damage.describe() == "run.mcap: its index is damaged; no message is missing"


def test_bytes_that_are_missing_between_two_records_are_noticed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    damaged_files.write_mcap(path)
    data, pieces = path.read_bytes(), damaged_files.list_chunks(path)
    path.write_bytes(data[: pieces[3].start] + data[pieces[4].start :])
    read, (damage,) = _read(path)
    assert len(read) == 400 - len(pieces[3].messages)
    assert damage.is_gap and "bytes were lost or added" in damage.describe()


def test_a_lost_definition_of_a_topic_is_told_with_its_messages(tmp_path: Path) -> None:
    """The first chunk defines the topic, and the copy at the end was cut off."""
    path = tmp_path / "run.mcap"
    damaged_files.write_mcap(path)
    pieces = damaged_files.list_chunks(path)
    data = bytearray(path.read_bytes()[: pieces[20].end])
    data[pieces[0].start + 60] ^= 1
    path.write_bytes(data)
    found = McapRecords(path).find_damage()
    lost = sum(len(piece.messages) for piece in pieces[1:21])
    assert f"{lost} messages are missing" in found[-1].describe()


def test_a_missing_file_of_a_long_recording_is_a_gap(tmp_path: Path) -> None:
    records = samples.ticks(400, seed=4)
    record_run(tmp_path / "run.mcap", ["record.max_file_mb=0.2"], records)
    (tmp_path / "run-0001.mcap").unlink()
    (damage,) = find_damage(tmp_path / "run.mcap")
    assert damage.is_gap and "run-0002.mcap is there" in damage.what
    times_s = [record.batch.t_s for record in read_ticks(tmp_path / "run.mcap")]
    assert times_s[-1] == records[-1].batch.t_s and len(times_s) < len(records)
    shutil.copy(tmp_path / "run.mcap", tmp_path / "run-2026.mcap")  # no part of it
    assert len(find_damage(tmp_path / "run.mcap")) == 1


class _BadDisk(io.BytesIO):
    """A file with some bytes that the disk cannot read."""

    def __init__(self, data: bytes, bad: range) -> None:
        super().__init__(data)
        self._bad = bad

    def read(self, size: int | None = -1, /) -> bytes:
        at = self.tell()
        data = super().read(size)
        if at < self._bad.stop and at + len(data) > self._bad.start:
            raise OSError(5, "Input/output error")
        return data


def test_sectors_that_a_disk_cannot_read_are_zeros_and_all_others_are_read() -> None:
    data = np.random.default_rng(1).bytes(64 * 1024)
    bad = range(20 * 1024, 21 * 1024)
    read = read_bytes(_BadDisk(data, bad), 0, len(data))
    assert read == data[: bad.start] + bytes(len(bad)) + data[bad.stop :]
