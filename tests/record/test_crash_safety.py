from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from agribot.cli.main import main
from agribot.core import topics
from agribot.core.config import RecordConfig, load
from agribot.core.messages import TickRecord
from agribot.record.bag.info import read_info
from agribot.record.mcap_records import read_part_number
from agribot.record.recorder import RunRecorder
from agribot.record.recovery import recover
from agribot.record.replay import read_config, read_ticks, read_weed_map
from tests import nightly
from tests.record import record_samples as samples
from tests.record.bag.bag_samples import write_run
from tests.record.killed_run import kill_a_run

ROOT = Path(__file__).parents[2]
KILLS = int(os.environ.get("AGRIBOT_KILLS", "5"))
# Ticks after which the recorder is killed; each of them at another place of its second.
MOMENTS = sorted(np.random.default_rng(11).integers(1, 1500, size=KILLS).tolist())


def _kill_after(ticks: int, path: Path) -> float:
    """Kill a recorder without warning and return the time of the last tick it had taken."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.record.killed_recorder", str(path)],
        stdout=subprocess.PIPE, cwd=ROOT, env={**os.environ, "PYTHONPATH": f"{ROOT / 'src'}"},
    )  # fmt: skip
    assert process.stdout is not None
    with process, process.stdout as said:
        lines = [said.readline() for _ in range(ticks)]
        process.kill()
        lines += said.readlines()
    whole = [line for line in lines if line.endswith(b"\n")]
    return float(whole[-1])


@nightly.one_by_one("ticks", MOMENTS, in_suite=2)
def test_a_killed_recorder_leaves_a_file_that_opens_and_lacks_at_most_a_second(
    ticks: int, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    last_s = _kill_after(ticks, path)
    kept = list(read_ticks(path))
    # The recorder may have taken one tick more than it could say.
    assert last_s - (kept[-1].batch.t_s if kept else 0.0) <= 1.0 + 0.02
    assert read_config(path) == load("farm")
    saved = recover(path, tmp_path / "saved.mcap")
    assert list(read_ticks(tmp_path / "saved.mcap")) == kept
    with (tmp_path / "saved.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_summary() is not None
        imu = sum(1 for _ in reader.iter_decoded_messages([topics.IMU.name]))
    assert imu == 4 * len(kept)
    assert saved.messages == read_info(tmp_path / "saved.mcap").messages


@nightly.by_day("test_a_killed_recorder_leaves_a_file_that_opens_and_lacks_at_most_a_second")
@pytest.mark.parametrize("after_s", np.random.default_rng(12).uniform(0.1, 4.0, 3).tolist())
def test_a_whole_run_that_is_killed_leaves_files_that_open_and_lacks_at_most_a_second(
    after_s: float, tmp_path: Path
) -> None:
    killed = kill_a_run(tmp_path, after_s)
    assert killed.lost_s <= 1.0 + 0.02
    assert killed.recovered > 0
    assert killed.notes == ()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    write_run(path)
    return path


def test_a_cut_file_is_recovered_up_to_the_cut(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.mcap"
    whole = run.read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    kept = [samples.without_frames(tick) for tick in read_ticks(cut)]
    assert any("ends in the middle" in note for note in read_info(cut).damage)
    assert main(["record", "recover", str(cut), "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert not result["was_whole"]
    assert result["lost_bytes"] > 0
    saved = tmp_path / "cut-recovered.mcap"
    assert [samples.without_frames(tick) for tick in read_ticks(saved)] == kept
    info = read_info(saved)
    assert (info.notes, info.damage) == ((), ())
    assert main(["record", "recover", str(cut)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_whole_file_stays_what_it_is(run: Path, tmp_path: Path) -> None:
    saved = recover(run, tmp_path / "again.mcap")
    assert saved.was_whole
    assert saved.lost_bytes == 0
    assert saved.messages == read_info(run).messages
    assert read_weed_map(tmp_path / "again.mcap") == read_weed_map(run)


@pytest.mark.parametrize("kept", ["magic", "header"])
def test_nothing_is_recovered_from_nothing(
    kept: str, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = run.read_bytes()
    after_header = 8 + 9 + int.from_bytes(whole[9:17], "little")
    end = 8 if kept == "magic" else after_header
    (tmp_path / "stub.mcap").write_bytes(whole[:end] + b"\x06 then garbage")
    assert main(["record", "recover", str(tmp_path / "stub.mcap")]) == 2
    said = capsys.readouterr().err
    assert f"nothing can be recovered: the first {end} of its {end + 14} bytes are sound" in said
    assert [p.name for p in tmp_path.iterdir()] == ["stub.mcap"]


def test_a_recording_without_a_sound_message_counts_as_not_recovered(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.mcap"
    whole = run.read_bytes()
    first_chunk = whole.index(b"zstd" if b"zstd" in whole else b"lz4")
    cut.write_bytes(whole[:first_chunk])
    assert main(["record", "recover", str(cut)]) == 1
    said = capsys.readouterr()
    assert "no message of it was sound" in said.err
    assert "cut-recovered.mcap: 0 messages" in said.out


def record_run(path: Path, limits: list[str], records: list[TickRecord]) -> RunRecorder:
    config = load("farm", limits)
    recorder = RunRecorder(path, config, samples.robot(), samples.URDF, samples.plan())
    for record in records:
        recorder(record)
    recorder.close()
    return recorder


def test_a_long_recording_goes_on_in_further_files(tmp_path: Path) -> None:
    records = samples.ticks(400, seed=4)
    record_run(tmp_path / "run.mcap", ["record.max_file_mb=0.2"], records)
    parts = sorted(tmp_path.iterdir())
    assert len(parts) >= 3
    assert [
        read_part_number(part) for part in sorted(parts, key=lambda p: (len(p.name), p.name))
    ] == [*range(len(parts))]
    assert list(read_ticks(tmp_path / "run.mcap")) == records
    for part in parts:
        counts = {topic.name: topic.count for topic in read_info(part).topics}
        assert counts[topics.ROBOT_DESCRIPTION.name] == counts[topics.TF_STATIC.name] == 1
        assert counts[topics.PATH.name] == 1
        assert read_config(part).profile == "farm"
        assert part.stat().st_size < 0.4e6


def test_the_oldest_files_go_when_the_recording_grows_too_large(tmp_path: Path) -> None:
    records = samples.ticks(600, seed=4)
    recorder = record_run(
        tmp_path / "run.mcap", ["record.max_file_mb=0.1", "record.max_total_mb=0.4"], records
    )
    assert recorder.ended_because == ""
    parts = sorted(tmp_path.iterdir())
    assert not (tmp_path / "run.mcap").exists()
    assert sum(part.stat().st_size for part in parts) < 0.6e6
    kept = list(read_ticks(parts[0]))
    assert kept == records[-len(kept) :]
    assert len(kept) > 50


def test_a_full_disk_ends_the_recording_but_not_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free_mb = iter([500, 400, 300, 199, 100])

    def shrinking(_: Path) -> SimpleNamespace:
        return SimpleNamespace(free=next(free_mb) * 1_000_000)

    monkeypatch.setattr("agribot.record.parts.shutil.disk_usage", shrinking)
    records = samples.ticks(300, seed=4)
    recorder = record_run(tmp_path / "run.mcap", [], records)
    assert "only 199 MB are left on the disk" in recorder.ended_because
    kept = list(read_ticks(tmp_path / "run.mcap"))
    assert 0 < len(kept) < len(records)
    assert read_info(tmp_path / "run.mcap").notes == ()  # closed properly


def test_parts_of_an_earlier_run_are_not_taken_for_those_of_this_one(tmp_path: Path) -> None:
    record_run(tmp_path / "run.mcap", ["record.max_file_mb=0.1"], samples.ticks(300, seed=4))
    again = samples.ticks(60, seed=5)
    record_run(tmp_path / "run.mcap", [], again)
    assert list(read_ticks(tmp_path / "run.mcap")) == again


def test_without_limits_there_is_one_file() -> None:
    assert (RecordConfig().max_file_mb, RecordConfig().max_total_mb) == (0.0, 0.0)
