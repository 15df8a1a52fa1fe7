from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from agribot import topics
from agribot.cli import main
from agribot.record.bag.convert import ConvertOptions, convert
from agribot.record.foreign import read_foreign
from tests.record.bag import bag_samples as samples


def test_a_bag_with_fixes_only_shows_its_track_and_says_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    samples.write_ros1(tmp_path / "field.bag")
    out = tmp_path / "report"
    assert main(["report", str(tmp_path / "field.bag"), "-o", str(out), "--json"]) == 0
    said = capsys.readouterr()
    result = json.loads(said.out.splitlines()[-1])
    assert result["track"] == {"/fix": 50}
    assert result["distance"] == {"driven, by /fix": 50}
    assert any("raw heading" in word for word in result["missing"])
    assert any("speed" in word for word in result["missing"])
    assert "missing: speed" in said.err
    names = {p.name for p in out.iterdir()}
    assert names == {"report.html", "report.json", "track.png", "distance.png"}
    page = (out / "report.html").read_text()
    assert "What is missing" in page
    assert "/fix" in page


def test_values_of_a_foreign_bag_are_those_that_were_driven(tmp_path: Path) -> None:
    samples.write_run(tmp_path / "run.mcap")
    wanted = (topics.ODOMETRY.name, topics.FIX.name, topics.HEADING_RAW.name, topics.IMU.name)
    convert(tmp_path / "run.mcap", tmp_path / "a.bag", ConvertOptions(topics=wanted))
    data = read_foreign(tmp_path / "a.bag")
    assert data.missing == ()
    (speed,) = data.speed
    assert speed.points[:, 1] == pytest.approx(0.4)
    (heading,) = data.heading_filtered  # the IMU of ours measures no orientation
    assert all(abs(math.remainder(value, 360.0)) < 5.0 for value in heading.points[:, 1])
    tracks = {line.label: line.points for line in data.tracks}
    assert tracks[topics.FIX.name][0].tolist() == [0.0, 0.0]
    assert tracks[topics.ODOMETRY.name][-1] == pytest.approx([1.0, 2.0 + 0.4 * 3.0], abs=0.1)


def test_odometry_before_its_first_fix_is_no_part_of_the_track(tmp_path: Path) -> None:
    samples.write_run(tmp_path / "run.mcap", unplaced=50)
    convert(
        tmp_path / "run.mcap", tmp_path / "a.bag", ConvertOptions(topics=(topics.ODOMETRY.name,))
    )
    data = read_foreign(tmp_path / "a.bag")
    (track,) = data.tracks
    assert track.points[0] == pytest.approx([1.0, 2.0 + 0.4 * 1.0], abs=0.1)
    (driven,) = (line for line in data.distance if line.label.startswith("driven"))
    assert driven.points[0] == pytest.approx([1.0, 0.0], abs=0.05)
    assert driven.points[-1, 0] == pytest.approx(3.0, abs=0.05)
    assert driven.points[-1, 1] < 5.0
    (heading,) = data.heading_filtered
    assert all(abs(math.remainder(value, 360.0)) < 5.0 for value in heading.points[:, 1])


def test_a_run_that_was_killed_still_gets_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    samples.write_run(tmp_path / "run.mcap")
    whole = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    assert main(["report", str(tmp_path / "cut.mcap"), "-o", str(tmp_path / "out")]) == 0
    assert "ends in the middle" in capsys.readouterr().err
    assert (tmp_path / "out" / "heading.png").exists()


def test_a_bag_with_nothing_to_plot_says_so(tmp_path: Path) -> None:
    samples.write_ros1(tmp_path / "a.bag")
    convert(tmp_path / "a.bag", tmp_path / "b.bag", ConvertOptions(topics=("/text",)))
    assert main(["report", str(tmp_path / "b.bag"), "-o", str(tmp_path / "out")]) == 1
    missing = json.loads((tmp_path / "out" / "report.json").read_text())["missing"]
    assert len(missing) == 5
