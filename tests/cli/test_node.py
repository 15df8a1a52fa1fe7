"""`agribot node`: what it refuses before it touches a network, and the files of `plot`."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.cli.main import main
from agribot.core import topics
from agribot.record.drive_figure import write_drive_files
from agribot.ros.messages import rosmsg
from agribot.ros.nodes.plot import Plot


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("gps-converter", "--origin", "91,0"), "--origin 91,0: not a place; give LAT,LON"),
        (("gps-converter", "--origin", "here"), "--origin here"),
        (("autonomous-drive-action",), "no goal to go to"),
        (("autonomous-drive-action", "--goal=nan,3"), "--goal nan,3"),
        (("autonomous-drive-action", "--goals", "no-such-file"), "cannot read goals"),
        (("autonomous-drive", "--arrive", "0"), "give 0.05 to 100 m"),
        (("autonomous-drive", "--drive-speed", "nan"), "give more than 0 and at most 2"),
        (("data-manipulation", "--compass-std", "-1"), "--compass-std -1"),
        (("plot", "--for", "0"), "--for 0: out of range"),
        (("plot", "--ros-domain", "233"), "give 0 to 232"),
    ],
)
def test_bad_input_is_refused_with_one_clear_line(
    capsys: pytest.CaptureFixture[str], words: tuple[str, ...], complaint: str
) -> None:
    assert main(["node", *words, "--ros2"]) == 2
    captured = capsys.readouterr().err
    assert complaint in captured
    assert len(captured.splitlines()) == 1


def test_plot_writes_what_it_heard_as_a_table_and_a_picture(tmp_path: Path) -> None:
    plot = Plot()
    for index in range(50):
        t_s = 100.0 + 0.1 * index
        plot.receive(topics.DISTANCE, rosmsg.make_float64(5.0 - 0.04 * index), t_s)
        heading_deg = float("nan") if index == 3 else 359.5
        plot.receive(topics.HEADING_FILTERED, rosmsg.make_float64(heading_deg), t_s)
        plot.receive(topics.CMD_VEL, rosmsg.make_twist(0.4, -0.1), t_s)
    picture, table = write_drive_files(tmp_path / "new", plot.series)
    with table.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    distances = [float(row["value"]) for row in rows if row["name"] == "distance_m"]
    np.testing.assert_allclose(distances, 5.0 - 0.04 * np.arange(50))
    assert sum(row["name"] == "heading_filtered_deg" for row in rows) == 49
    assert [row["t_s"] for row in rows if row["name"] == "v_mps"][-1] == "4.900"
    with Image.open(picture) as image:
        assert len(np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0)) > 50
