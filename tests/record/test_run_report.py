from __future__ import annotations

import io
import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from matplotlib.patches import Circle
from PIL import Image

from agribot.core.config import load
from agribot.core.errors import RecordingError
from agribot.core.extras import format_install
from agribot.core.implement.row_shares import TreatedShare
from agribot.core.messages import PlantClass
from agribot.record.drawing import encode_png, thin
from agribot.record.events import Event
from agribot.record.map_figure import draw_map
from agribot.record.page import render_report
from agribot.record.plots import true_cross_track_m
from agribot.record.report import (
    MissionReport,
    Report,
    SafetyEvent,
    SafetyReport,
    TimeReport,
    WeedReport,
    read_report,
    to_json,
    write_report,
)
from agribot.record.row_table import summarise_rows
from agribot.record.run_figures import explain_absence
from agribot.record.run_files import write_run_files
from agribot.record.series import RunData, SeriesTap, collect
from tests.record import record_samples as samples

pytestmark = pytest.mark.figures
CONTRACT: dict[str, Any] = {
    "profile": None, "seed": None, "sensors": None, "version": None, "ok": None, "reason": None,
    "time": ["sim_s", "wall_s", "cpu_s", "rtf_cpu"],
    "mission": [
        "success", "rows_total", "rows_done", "waypoints_total", "waypoints_reached", "distance_m",
        "area_m2", "h_per_ha", "coverage_ratio", "rows_unproven",
    ],
    "tracking": [
        "xte_rms_m", "xte_p95_m", "xte_max_m", "heading_rms_rad", "plants_total", "plants_crushed",
        "plants_crushed_by", "plants_brushed",
    ],
    "estimate": ["pos_rms_m", "yaw_rms_rad", "nees_mean"],
    "perception": ["frames", "fps_cpu", "latency_p95_s", "to_tool_p95_s", "iou", "miou"],
    "weeds": [
        "truth", "mapped", "matched", "precision", "recall", "f1", "pos_error_median_m", "treated",
        "treated_true", "crops_hit", "spray_area_ratio", "crops_truth", "crops_mapped",
        "crop_recall", "stem_error_p95_m", "placement_p90_m", "left",
        "crop_leaves_wet_ratio", "tool_offset_p50_m", "tool_offset_p90_m",
        "in_row", "between_rows", "untreated",
    ],
    "safety": [
        "stops", "noticed", "faults", "outside_m_max", "stop_distance_m_max",
        "crushed_after_fault", "person_distance_min_m", "gate", "checks",
        "stop_allowed_m", "stops_too_long", "crushes",
        "interventions", "km_per_intervention", "dropouts",
        "waits_for_obstacles", "visits", "over_level_ratio",
    ],
    "marks": None,
    "job": None,
    "implement": None,
    "preset": None,
    "conditions": None,
    "beliefs": None,
    "found_rows": None,
}  # fmt: skip
NASTY = '<script>alert("x")</script> & more'


def _report(**changes: Any) -> Report:
    base = Report(
        profile="farm", seed=3, sensors="rtk", version="0.1.0", ok=True, reason="all rows done"
    )
    return msgspec.structs.replace(base, **changes)


def _data(count: int = 500, truth: bool = True) -> RunData:
    tap = SeriesTap()
    for record in samples.ticks(count, seed=2):
        tap(record)
        if truth:  # 3 cm left of the row, which is driven North
            t_s = record.batch.t_s
            tap.truth(t_s, (0.97, 2.0 + samples.SPEED_MPS * t_s, math.pi / 2))
    plants = (
        samples.plant(1), samples.plant(2, treated_s=6.0), samples.plant(3, PlantClass.CROP),
    )  # fmt: skip
    return RunData(
        config=load("farm"), series=tap.series(), rows=samples.rows(), plan=samples.plan(),
        goals_map_m=((1.0, 2.0), (1.0, 12.0)), plants=plants,
        events=(Event(t_s=4.0, kind="stop", reason=NASTY),),
    )  # fmt: skip


class _Links(HTMLParser):
    """Every attribute value that makes a browser load something."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.loaded += [v or "" for k, v in attrs if k in {"src", "href", "data", "xlink:href"}]


def test_keys_and_their_order_are_those_of_the_contract() -> None:
    found = json.loads(to_json(_report()))
    assert list(found) == list(CONTRACT)
    for group, keys in CONTRACT.items():
        if keys is not None:
            assert list(found[group]) == keys
    assert list(found["perception"]["iou"]) == ["weed", "crop", "soil"]


def test_what_nobody_measured_is_null() -> None:
    report = _report(time=TimeReport(sim_s=12.0, rtf_cpu=math.nan))
    found = json.loads(to_json(report))
    assert found["time"] == {"sim_s": 12.0, "wall_s": None, "cpu_s": None, "rtf_cpu": None}
    assert set(found["weeds"].values()) == {None}
    assert found["safety"] == {
        "stops": [], "noticed": [], "faults": [], "outside_m_max": None,
        "stop_distance_m_max": None, "crushed_after_fault": None,
        "person_distance_min_m": None, "gate": [], "checks": [],
        "stop_allowed_m": None, "stops_too_long": None, "crushes": [],
        "interventions": [], "km_per_intervention": None, "dropouts": None,
        "waits_for_obstacles": 0, "visits": [], "over_level_ratio": None,
    }  # fmt: skip


def test_a_report_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    stop = SafetyEvent(t_s=3.0, reason="emergency stop pressed")
    report = _report(
        ok=False, mission=MissionReport(success=False, rows_done=2, rows_total=6),
        safety=SafetyReport(stops=(stop,)), weeds=WeedReport(mapped=3, precision=0.5),
    )  # fmt: skip
    write_report(tmp_path / "deep" / "report.json", report)
    assert read_report(tmp_path / "deep" / "report.json") == report


def test_an_unwritable_report_says_where(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(RecordingError, match=r"report\.json"):
        write_report(tmp_path / "file" / "report.json", _report())


@pytest.fixture(scope="module")
def page() -> str:
    """The page of a failed run, which was given markup for text."""
    weeds = WeedReport(
        truth=9, mapped=7, precision=0.875, recall=0.75, treated=5, crops_hit=0, crops_truth=40,
        crops_mapped=38, crop_recall=0.925, stem_error_p95_m=0.0312,
        in_row=TreatedShare(of=4, treated=1, share=0.25),
        between_rows=TreatedShare(of=5, treated=4, share=0.8),
        untreated={"called crop": 3, "leaf of crop": 1}, left={"leaf of crop": 2},
    )  # fmt: skip
    return render_report(_report(ok=False, reason=NASTY, profile="<b>farm", weeds=weeds), _data())


def test_the_page_loads_nothing_from_anywhere(page: str) -> None:
    assert not re.search(r"https?:|//[a-z]+\.", page)
    assert "@import" not in page
    links = _Links()
    links.feed(page)
    assert all(link.startswith(("#", "data:")) for link in links.loaded)
    assert not links.tags & {"script", "link", "iframe", "object", "img"}
    assert page.count("<svg ") == 9


def test_the_page_escapes_what_it_was_given(page: str) -> None:
    assert "<script" not in page
    assert "<b>farm" not in page
    assert page.count("&lt;script&gt;") >= 2


def test_the_page_shows_the_numbers_and_the_settings(page: str) -> None:
    assert "0.88 / 0.75" in page
    assert "of 9 true ones" in page
    assert "of 40 true ones, recall 0.93; stems, 95 % within 3.1 cm" in page
    assert "row_pitch_m = 1.0" in page
    assert "prefers-color-scheme: dark" in page


def test_the_page_counts_weeds_in_the_row_apart_and_lists_why_weeds_were_left(page: str) -> None:
    assert "<dt>Weeds treated in the row</dt><dd>1</dd><small>of 4, 25 %</small>" in page
    assert "<dt>Weeds treated between the rows</dt><dd>4</dd><small>of 5, 80 %</small>" in page
    assert "<td class=left>called crop</td><td>3</td><td>0</td>" in page
    assert "<td class=left>leaf of crop</td><td>1</td><td>2</td>" in page


def test_a_failed_run_is_not_dressed_as_good(page: str) -> None:
    assert "Not good" in page
    assert 'class="verdict ok"' not in page


def test_a_run_that_ended_at_once_still_gets_its_files(tmp_path: Path) -> None:
    nothing = RunData(config=load("farm"), series=SeriesTap().series())
    write_run_files(tmp_path, _report(ok=False, reason="refused"), nothing)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"report.json", "report.html", "map.png", "weeds.geojson", "config.toml"}


def test_the_map_is_1200_pixels_wide_and_shows_path_and_weeds() -> None:
    image = Image.open(io.BytesIO(encode_png(draw_map(_data())))).convert("RGB")
    assert image.width == 1200
    pixels = np.asarray(image).astype(int)
    red = (pixels[..., 0] > 180) & (pixels[..., 1] < 90) & (pixels[..., 2] < 90)
    blue = (pixels[..., 2] > 190) & (pixels[..., 0] < 90)
    assert red.sum() > 100
    assert blue.sum() > 500


def test_crops_and_weeds_on_the_map_differ_by_shape() -> None:
    (axes,) = draw_map(_data()).axes
    markers = {str(line.get_label()): line.get_marker() for line in axes.lines}
    crops = {marker for label, marker in markers.items() if label.endswith(" crop")}
    weeds = {marker for label, marker in markers.items() if label.endswith(" weed")}
    assert crops == {"^"} and weeds and not crops & weeds


def test_what_stands_in_the_field_is_a_circle_on_the_map() -> None:
    data = _data()
    field = msgspec.structs.replace(data.config.field, obstacles_map_m=((-4.0, 2.0, 0.3),))
    config = msgspec.structs.replace(data.config, field=field)
    figure = draw_map(msgspec.structs.replace(data, config=config))
    (axes,) = figure.axes
    (post,) = axes.patches
    assert isinstance(post, Circle)
    assert tuple(np.ravel(post.get_center())) == (-4.0, 2.0)
    assert post.get_radius() == 0.3
    assert axes.get_xlim()[0] < -4.3


def test_both_axes_of_the_map_have_the_same_scale() -> None:
    figure = draw_map(_data())
    encode_png(figure)
    (axes,) = figure.axes
    box = axes.get_window_extent()
    x_scale = box.width / np.ptp(axes.get_xlim())
    y_scale = box.height / np.ptp(axes.get_ylim())
    assert x_scale == pytest.approx(y_scale, rel=1e-6)


def test_left_of_the_row_is_positive_whichever_way_it_is_driven() -> None:
    data = _data()
    inside = np.isfinite(true_cross_track_m(data.series, data.rows))
    assert inside.mean() > 0.95
    assert true_cross_track_m(data.series, data.rows)[inside] == pytest.approx(0.03)
    southward = msgspec.structs.replace(
        data.series, compass_deg=np.full_like(data.series.compass_deg, 180.0)
    )
    assert true_cross_track_m(southward, data.rows)[inside] == pytest.approx(-0.03)


def test_rows_sum_up_their_own_ticks_and_weeds() -> None:
    summaries = summarise_rows(_data())
    first, rest = summaries[0], summaries[1:]
    assert first.distance_m == pytest.approx(500 * 0.02 * samples.SPEED_MPS, rel=0.01)
    assert first.cross_track_rms_m == pytest.approx(0.03)
    assert (first.weeds_mapped, first.weeds_treated) == (2, 1)
    assert all(row.distance_m == 0.0 and row.speed_mps is None for row in rest)


def test_a_visit_of_places_has_weeds_and_no_rows(tmp_path: Path) -> None:
    data = msgspec.structs.replace(_data(), rows=())
    assert data.plants and summarise_rows(data) == ()
    write_run_files(tmp_path, _report(), data)
    assert (tmp_path / "report.html").is_file()


def test_without_truth_the_rows_use_what_the_robot_believes() -> None:
    first = summarise_rows(_data(truth=False))[0]
    assert first.cross_track_rms_m == pytest.approx(0.01, rel=0.2)


def test_series_of_a_live_run_and_of_its_recording_are_equal() -> None:
    records = samples.ticks(50, seed=4)
    tap = SeriesTap()
    for record in records:
        tap(record)
    live, later = tap.series(), collect(iter(records))
    for field in msgspec.structs.fields(live):
        one, other = getattr(live, field.name), getattr(later, field.name)
        assert np.array_equal(one, other, equal_nan=True), field.name


def test_the_table_of_rows_tells_over_how_much_of_a_row_its_crop_was_seen() -> None:
    data = _data()
    assert summarise_rows(data)[0].seen_m is None  # no camera looked
    seen = np.where(data.series.t_s < 6.0, 1.0, 0.0)
    looked = msgspec.structs.replace(data.series, row_seen=seen)
    first = summarise_rows(msgspec.structs.replace(data, series=looked))[0]
    assert first.seen_m == pytest.approx(0.6 * first.distance_m, abs=0.05)


def test_thinning_keeps_the_peaks_and_the_gaps() -> None:
    x = np.arange(100_000.0)
    y = np.zeros_like(x)
    y[54_321], y[77_777] = 9.0, -9.0
    y[20_000:30_000] = np.nan
    few_x, few_y = thin(x, y, 1000)
    assert len(few_x) < 1100
    assert np.nanmax(few_y) == 9.0
    assert np.nanmin(few_y) == -9.0
    assert np.isnan(few_y[(few_x >= 20_000) & (few_x < 30_000)]).any()
    assert np.all(np.diff(few_x) > 0)


def test_where_nothing_draws_figures_the_numbers_are_written_and_the_rest_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing = RunData(config=load("farm"), series=SeriesTap().series())
    monkeypatch.setattr("agribot.core.extras.has", lambda extra: extra != "report")
    write_run_files(tmp_path, _report(ok=True, reason="done"), nothing)
    assert {path.name for path in tmp_path.iterdir()} == {
        "report.json", "config.toml", "weeds.geojson"
    }  # fmt: skip
    assert format_install("report") in explain_absence()
    monkeypatch.undo()
    write_run_files(tmp_path, _report(ok=True, reason="done"), nothing)
    assert explain_absence() == ""
    assert (tmp_path / "map.png").exists()
