"""Places in latitude and longitude instead of rows."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.core.geo import Datum, MapFrame

FARM = MapFrame(Datum(lat_deg=21.161289, lon_deg=72.787022))
PLACES_MAP_M = ((-2.0, 3.0), (-3.0, 4.0), (-4.0, 1.0), (-3.0, -2.0))  # the last one lies South


def waypoint_file(folder: Path) -> Path:
    lines = ["lat,lon"]
    for east_m, north_m in PLACES_MAP_M:
        lat_deg, lon_deg, _ = FARM.geodetic_from_map(east_m, north_m)
        lines.append(f"{lat_deg:.9f},{lon_deg:.9f}")
    path = folder / "places.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.figures
def test_all_waypoints_are_truly_reached_and_the_replay_needs_no_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places, out = waypoint_file(tmp_path), tmp_path / "run"
    arguments = ["run", "farm", "--waypoints", str(places), "--out", str(out), "--json"]
    assert main([*arguments, "--set", "perception.enabled=false"]) == 0
    mission = json.loads(capsys.readouterr().out.splitlines()[-1])["mission"]
    assert mission["waypoints_reached"] == mission["waypoints_total"] == len(PLACES_MAP_M)
    assert mission["rows_total"] is None
    places.unlink()
    assert main(["replay", str(out / "run.mcap")]) == 0


def test_a_receiver_with_five_metres_of_drift_does_not_claim_the_waypoints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unmarked = ["--set", "field.start_std_m=20", "--set", "safety.max_pos_std_m=20"]
    arguments = ["run", "farm", "--sensors", "seed", *unmarked, "--json"]
    places = ["--waypoints", str(waypoint_file(tmp_path)), "--out", str(tmp_path / "run")]
    status = main([*arguments, *places, "--set", "perception.enabled=false"])
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert status == 1
    assert report["ok"] is False
    assert report["mission"]["waypoints_reached"] < len(PLACES_MAP_M)
