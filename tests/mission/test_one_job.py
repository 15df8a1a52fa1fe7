"""A job that is cut off twice: the last report covers all of it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest

from agribot.app.mission_file import continue_config, read_mission
from agribot.app.rerun import compare_passes, read_pass, rerun
from agribot.app.simulated_run import simulate
from agribot.app.whole_job import FILE_NAME, read_job
from agribot.autonomy.weeds.track import Track
from agribot.cli.main import main
from agribot.core import config
from agribot.record.report import Report, read_report
from agribot.sim.underside import Part

pytestmark = pytest.mark.figures
SETTINGS = ["perception.enabled=false", 'sim.sensors="rtk"', "seed=1",
            "field.row_count=2", "field.row_length_m=3"]  # fmt: skip
CRUSHED = 3


class Job(NamedTuple):
    """Folders a, b and c of one job, and `whole` of the same without interruption."""

    folder: Path
    whole: Report
    last: Report


def weed(number: int, x_m: float, y_m: float, treated_s: float | None) -> Track:
    return Track(
        id=number, x_map_m=x_m, y_map_m=y_m, own_var_m2=1e-4, xx_m2=1e-4, xy_m2=0.0, yy_m2=1e-4,
        weed_logit=5.0, exists_logit=5.0, area_m2=2e-3, sightings=9, first_seen_s=10.0,
        last_seen_s=12.0, treated_s=treated_s, is_confirmed=True,
    )  # fmt: skip


def go_on(folder: Path, first: str, second: str, until_s: float = 1e9) -> Report | None:
    saved = read_mission(folder / first)
    settings = continue_config(config.load(str(folder / first / "config.toml")), saved)
    with simulate(settings, folder / second, saved, read_job(folder / first, saved)) as session:
        for record in session.ticks():
            if record.batch.t_s > until_s:
                return None  # no finish: the computer lost its power
        return session.finish()


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Job:
    folder = tmp_path_factory.mktemp("job")
    with simulate(config.load("farm", SETTINGS), folder / "whole") as session:
        for _ in session.ticks():
            pass
        whole = session.finish()
    with simulate(config.load("farm", SETTINGS), folder / "a") as session:
        for record in session.ticks():
            if round(record.batch.t_s, 2) == 13.0:
                seen = (weed(4, -5.0, 3.0, None), weed(9, 0.8, 2.5, 12.5))
                session.weed_map.restore(seen)
                session.simulator.plants.crush(CRUSHED, 13.0, Part.WHEEL, 0.0)
            if record.batch.t_s > 16.0:
                break
    go_on(folder, "a", "b", until_s=12.0)
    last = go_on(folder, "b", "c")
    assert last is not None
    return Job(folder, whole, last)


def test_time_distance_rows_and_errors_are_those_of_the_whole_job(job: Job) -> None:
    whole, last = job.whole, job.last
    assert (whole.mission.rows_done, last.mission.rows_done) == (2, 2)
    assert last.mission.area_m2 == whole.mission.area_m2 == pytest.approx(6.0)
    assert last.mission.coverage_ratio == pytest.approx(1.0)
    assert last.mission.distance_m == pytest.approx(whole.mission.distance_m, rel=0.03)
    assert last.time.sim_s is not None and whole.time.sim_s is not None
    assert last.time.sim_s == pytest.approx(whole.time.sim_s + 6.0, abs=4.0)  # stood twice
    hours, area_ha = last.time.sim_s / 3600.0, 6e-4
    assert last.mission.h_per_ha == pytest.approx(hours / area_ha)
    assert last.tracking.xte_max_m is not None and last.tracking.xte_max_m < 0.05
    assert last.tracking.xte_p95_m is not None and last.tracking.xte_rms_m is not None
    assert last.tracking.xte_rms_m < last.tracking.xte_p95_m < last.tracking.xte_max_m
    assert last.estimate.nees_mean is not None


def test_what_happened_in_the_first_run_counts_in_the_last(job: Job) -> None:
    assert job.last.tracking.plants_crushed == 1
    assert not job.last.ok
    assert "1 crop plants were crushed by wheels" in job.last.reason
    first, second, third = job.last.job.runs if job.last.job else ()
    assert [Path(run.folder).name for run in (first, second, third)] == ["a", "b", "c"]
    assert first.run_s == pytest.approx(16.0, abs=1.1)
    assert job.last.job is not None and job.last.job.lacks == ()
    assert read_report(job.folder / "c" / "report.json") == job.last


def test_the_weed_map_has_the_plants_of_the_first_run_on_the_clock_of_the_job(job: Job) -> None:
    data = msgspec.json.decode((job.folder / "c" / "weeds.geojson").read_bytes())
    plants = {f["id"]: f["properties"] for f in data["features"]}
    assert set(plants) == {4, 9}
    assert plants[9]["treated"] and not plants[4]["treated"]
    assert plants[4]["first_seen_s"] == pytest.approx(10.0)
    assert plants[9]["treated_s"] == pytest.approx(12.5)


def test_page_and_rows_show_the_whole_job(job: Job) -> None:
    page = (job.folder / "c" / "report.html").read_text()
    assert "One job in 3 runs" in page
    rows = page[page.index("<h2>Rows</h2>") : page.index("<h2>Plots</h2>")]
    driven_m = [float(cells.split("</td><td>")[1]) for cells in rows.split("<tr>")[2:]]
    assert driven_m == pytest.approx([3.0, 3.0], abs=0.2)


def test_a_run_that_went_on_replays_bit_by_bit_with_the_map_it_took_over(job: Job) -> None:
    path = job.folder / "c" / "run.mcap"
    before = read_pass(path)
    again, plants = rerun(path, config.load(str(job.folder / "c" / "config.toml")))
    assert compare_passes(before, again).first is None
    assert {plant.id for plant in plants} == {4, 9}


def test_the_report_of_the_last_recording_shows_all_of_them(job: Job, tmp_path: Path) -> None:
    assert main(["report", str(job.folder / "c" / "run.mcap"), "-o", str(tmp_path)]) == 0
    assert "One job in 3 runs" in (tmp_path / "report.html").read_text()
    assert (tmp_path / "report.json").read_bytes() == (
        job.folder / "c" / "report.json"
    ).read_bytes()


@pytest.mark.parametrize(
    ("content", "why"),
    [(None, "No such file"), (b"\x00\xff half", "broken"), (b"{}", "broken"), (b"", "broken")],
)
def test_a_broken_account_of_the_first_run_is_told_and_no_crash(
    job: Job, content: bytes | None, why: str, tmp_path: Path
) -> None:
    (tmp_path / "a").mkdir()
    for name in ("mission.json", "config.toml", "events.jsonl", "run.mcap"):
        (tmp_path / "a" / name).write_bytes((job.folder / "a" / name).read_bytes())
    if content is not None:
        (tmp_path / "a" / FILE_NAME).write_bytes(content)
    saved = read_mission(tmp_path / "a")
    job_so_far = read_job(tmp_path / "a", saved)
    (lacks,) = job_so_far.lacks
    assert why in lacks
    assert [Path(run.folder).name for run in job_so_far.runs] == ["a"]


def test_a_mission_without_any_account_of_the_run_before_says_so(job: Job, tmp_path: Path) -> None:
    saved = read_mission(job.folder / "a")
    settings = continue_config(config.load(str(job.folder / "a" / "config.toml")), saved)
    with simulate(settings, tmp_path / "b", saved) as session:
        next(session.ticks())
        report = session.finish("interrupted")
    assert report.job is not None and "no account" in report.job.lacks[0]
    assert "no account" in report.reason


def test_a_lost_first_run_is_told_in_the_report(job: Job, tmp_path: Path) -> None:
    """Of `a` only mission and settings are left: its account and its recording are gone."""
    (tmp_path / "a").mkdir()
    for name in ("mission.json", "config.toml"):
        (tmp_path / "a" / name).write_bytes((job.folder / "a" / name).read_bytes())
    saved = read_mission(tmp_path / "a")
    settings = continue_config(config.load(str(tmp_path / "a" / "config.toml")), saved)
    with simulate(settings, tmp_path / "b", saved, read_job(tmp_path / "a", saved)) as session:
        next(session.ticks())
        report = session.finish("interrupted")
    assert report.job is not None
    told = " ".join(report.job.lacks)
    assert "what was measured before" in told and "plots" in told and "events" in told
    assert "lacks" in report.reason and FILE_NAME in report.reason
    assert report.mission.distance_m == pytest.approx(0.0, abs=0.05)  # what it has seen itself
