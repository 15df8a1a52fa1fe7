"""A disk that is really full: files may grow to a limit, and every byte more is an error."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from agribot.app.simulated_run import simulate
from agribot.core import config
from agribot.core.errors import RecordingError
from agribot.record.events import Event, EventLog, read_events
from agribot.record.recorder import RunRecorder
from agribot.record.replay import read_ticks
from agribot.record.report import Report, read_report
from agribot.record.run_files import write_run_files
from agribot.record.series import RunData, SeriesTap
from tests.record import record_samples as samples

pytestmark = pytest.mark.figures
resource = pytest.importorskip("resource")


@pytest.fixture
def limit_files() -> Iterator[Callable[[int | None], None]]:
    """Limit the size of files, in bytes; None: no limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def limit(size_bytes: int | None) -> None:
        wanted = soft if size_bytes is None else size_bytes
        resource.setrlimit(resource.RLIMIT_FSIZE, (wanted, hard))

    yield limit
    limit(None)


def test_a_write_error_ends_the_recording_and_what_was_written_stays(
    tmp_path: Path, limit_files: Callable[[int | None], None]
) -> None:
    path, records = tmp_path / "run.mcap", samples.ticks(600, seed=4)
    recorder = RunRecorder(
        path, config.load("farm"), samples.robot(), samples.URDF, samples.plan()
    )  # fmt: skip
    limit_files(200_000)
    for record in records:
        recorder(record)  # raises nothing
    assert "File too large" in recorder.ended_because
    recorder.attach("report.json", "application/json", b"{}")
    recorder.close()
    recorder.close()
    kept = list(read_ticks(path))
    assert 0 < len(kept) < len(records)
    assert kept == records[: len(kept)]


def test_events_wait_for_the_disk_and_the_file_holds_whole_lines(
    tmp_path: Path, limit_files: Callable[[int | None], None]
) -> None:
    said: list[str] = []
    log = EventLog(tmp_path / "events.jsonl", said.append)
    events = [Event(t_s=float(t), kind="mark", reason=f"mark {t}") for t in range(40)]
    limit_files(1000)
    for event in events:
        log.add(event)
    on_disk = read_events(tmp_path / "events.jsonl")
    assert 0 < len(on_disk) < len(events)
    assert on_disk == tuple(events[: len(on_disk)])
    assert log.events == tuple(events)
    assert len(said) == 1
    assert "cannot write" in said[0]
    limit_files(None)
    log.close()
    assert read_events(tmp_path / "events.jsonl") == tuple(events)


def test_the_files_that_fit_are_written_and_older_ones_stay_whole(
    tmp_path: Path, limit_files: Callable[[int | None], None]
) -> None:
    (tmp_path / "report.html").write_bytes(b"older")
    settings = config.load("farm")
    tap = SeriesTap()
    for record in samples.ticks(50):
        tap(record)
    report = Report(profile="farm", seed=0, sensors="rtk", version="0", ok=True, reason="")
    data = RunData(config=settings, series=tap.series(), rows=samples.rows())
    limit_files(20_000)
    with pytest.raises(RecordingError, match=r"weeds|report\.html|map\.png"):
        write_run_files(tmp_path, report, data)
    assert read_report(tmp_path / "report.json") == report
    assert (tmp_path / "config.toml").exists()
    assert (tmp_path / "report.html").read_bytes() == b"older"
    assert not list(tmp_path.glob("*.new"))


def test_the_robot_drives_on_and_it_is_said_at_once(
    tmp_path: Path, limit_files: Callable[[int | None], None]
) -> None:
    settings = ["perception.enabled=false", "record.min_free_mb=0", "duration_s=9"]
    said: list[tuple[float, str]] = []
    with simulate(config.load("farm", settings), tmp_path / "run") as session:
        session.trouble_taps.append(lambda text: said.append((now_s, text)))
        limit_files((tmp_path / "run" / "run.mcap").stat().st_size + 150_000)
        now_s = 0.0
        for record in session.ticks():
            now_s = record.batch.t_s
        limit_files(None)
        assert session.last is not None
        assert session.last.estimate.v_mps > 0.2
        report = session.finish()
    (told,) = said
    assert 0.5 < told[0] < 8.0
    assert "recording ended early" in told[1]
    assert "the robot drives on" in told[1]
    (fault,) = [f for f in report.safety.noticed if "recording" in f.reason]
    assert fault.t_s == pytest.approx(told[0], abs=0.05)
    assert report.reason == "stopped after 9 s, as asked"
    assert read_report(tmp_path / "run" / "report.json") == report
    assert list(read_ticks(tmp_path / "run" / "run.mcap"))
