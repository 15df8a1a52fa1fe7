"""`agribot bench missions`: what it drives, in which order, and what it calls too little."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.lab.bench import missions

SHORT = ("duration_s=2", "record.enabled=false", "perception.enabled=false")


def test_every_profile_meets_its_receivers_and_the_first_seeds_come_first() -> None:
    jobs = missions.list_jobs(["farm", "rows-10x12", "hills", "beet"], None)
    assert len({job.name for job in jobs}) == len(jobs) == 20 + 3 * 10 + 20 + 2 * 10 + 5 + 10
    seeds = [job.seed for job in jobs]
    assert seeds == sorted(seeds)
    farm = {job.config().sim.sensors for job in jobs if job.profile == "farm" and job.seed == 10}
    assert farm == {"legacy", "seed", "m8n", "rtk"}
    assert not any(job.config().record.enabled for job in jobs)
    assert {job.config().sim.preset for job in jobs} == {"field"}
    kind = missions.list_jobs(["beet"], None, "kind")
    assert {job.config().sim.preset for job in kind} == {"kind"}


def test_a_series_is_driven_shown_as_a_table_and_goes_on_where_it_was(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(missions, "FIXED", SHORT)
    monkeypatch.setattr(missions, "CASES", (missions.Case("farm", ("rtk", "ideal"), (1, 2)),))
    out = tmp_path / "out"
    words = ["bench", "missions", "--profiles", "farm", "--workers", "1", "--out", str(out)]
    assert main([*words, "--json"]) == 1  # two seconds do no rows
    shown = capsys.readouterr()
    result = json.loads(shown.out.splitlines()[-1])
    assert (result["runs_done"], result["runs_ok"], result["short"]) == (4, 0, [])
    assert "| farm | sim.sensors=ideal | 0 of 2 | 0 of 12 |" in shown.err
    kept = {path: path.stat().st_mtime_ns for path in out.glob("results/*.json")}
    assert main(words) == 1
    assert {path: path.stat().st_mtime_ns for path in out.glob("results/*.json")} == kept


def test_a_cross_track_error_above_the_limit_is_named() -> None:
    entry = {
        "profile": "rows-10x12",
        "settings": {"sim.sensors": "m8n"},
        "mean": {"tracking.xte_rms_m": 0.05},
        "std": {"tracking.xte_rms_m": None},
        "count": {"tracking.xte_rms_m": 1},
    }
    assert missions.find_shortfalls([entry]) == [
        "rows-10x12 sim.sensors=m8n: cross-track RMS 5.0 cm > 2.5 cm"
    ]
    assert missions.find_shortfalls([{**entry, "profile": "farm"}]) == []


def test_weeding_below_the_limits_is_named_part_by_part() -> None:
    good = {
        "weeds.crop_recall": 0.9, "weeds.truth": 90.0, "weeds.treated_true": 60.0,
        "weeds.spray_area_ratio": 0.05,
    }  # fmt: skip
    entry = {
        "profile": "beet", "settings": {"sim.sensors": "m8n"}, "mean": good, "std": {}, "count": {},
        "max": {"weeds.crops_hit": 0.0},
    }  # fmt: skip
    assert missions.find_shortfalls([entry]) == []
    assert missions.find_shortfalls([{**entry, "mean": {}, "max": {}}]) == []  # nothing was judged
    bad = {
        "weeds.crop_recall": 0.5, "weeds.truth": 90.0, "weeds.treated_true": 9.0,
        "weeds.spray_area_ratio": 0.25,
    }  # fmt: skip
    short = missions.find_shortfalls([{**entry, "mean": bad, "max": {"weeds.crops_hit": 2.0}}])
    assert short == [
        "beet sim.sensors=m8n: 0.50 of the crops mapped < 0.75",
        "beet sim.sensors=m8n: 0.10 of the weeds treated < 0.5",
        "beet sim.sensors=m8n: 2 crops hit in one mission > 0",
        "beet sim.sensors=m8n: 0.25 of the ground sprayed > 0.1",
    ]
    rtk = {**entry, "settings": {"sim.sensors": "rtk"}, "mean": bad}
    assert missions.find_shortfalls([rtk]) == []


def test_an_unknown_profile_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "missions", "--profiles", "farm,moon"]) == 2
    assert "moon" in capsys.readouterr().err
    assert main(["bench", "missions", "--preset", "moon"]) == 2
    assert "unknown preset 'moon'" in capsys.readouterr().err
