"""A recorded drive under other settings, and recorded drives as regression tests."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.record.bag.convert import ConvertOptions, convert
from agribot.record.replay import read_ticks


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("drive")
    settings = ["--set", "perception.enabled=false", "--for", "10", "--seed", "3"]
    main(["run", "farm", *settings, "--out", str(out)])
    return out / "run.mcap"


def replayed(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, object]:
    capsys.readouterr()
    assert main(["replay", *arguments, "--json"]) == 0
    result: dict[str, object] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return result


def test_a_run_that_went_through_a_ros_1_bag_replays_bit_by_bit(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    convert(run, tmp_path / "run.bag")
    convert(tmp_path / "run.bag", tmp_path / "back.mcap")
    result = replayed(capsys, str(tmp_path / "back.mcap"))
    assert result == {**result, "identical": True, "ticks": len(list(read_ticks(run)))}


def test_a_slower_mission_is_commanded_slower(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = replayed(capsys, str(run), "--with", "mission.speed_mps=0.2")
    old, new, apart = result["recorded"], result["replayed"], result["difference"]
    assert isinstance(old, dict)
    assert isinstance(new, dict)
    assert isinstance(apart, dict)
    assert result["repeatable"] is True
    assert new["commanded_mean_mps"] < old["commanded_mean_mps"] - 0.05
    assert new["distance_m"] == old["distance_m"]  # the recorded wheels turned as they did
    assert apart["speed_max_mps"] == pytest.approx(0.2, abs=0.02)
    assert apart["position_rms_m"] == 0.0


def test_another_belief_about_sensors_moves_the_estimate(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = replayed(capsys, str(run), "--with", "estimate.wheel_scale_std_ratio=0.3")
    apart = result["difference"]
    assert isinstance(apart, dict)
    assert 0.0 < apart["position_rms_m"] < 0.2


def test_the_same_settings_change_nothing(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = replayed(capsys, str(run), "--with", "seed=9")
    apart = result["difference"]
    assert isinstance(apart, dict)
    assert (apart["first"], apart["ticks"]) == (None, 0)
    assert result["notes"] == [
        "seed=9 has no effect here: the recording was made with the old value"
    ]


def test_the_table_names_what_changed(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["replay", str(run), "--with", "mission.speed_mps=0.2"]) == 0
    text = capsys.readouterr().out
    assert "commanded_mean_mps" in text
    assert "commands differ in" in text


def test_a_log_that_this_version_drives_otherwise_fails_the_check(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["replay", "--check", str(run), str(run)]) == 0
    assert capsys.readouterr().out.count("every command is identical") == 2
    monkeypatch.setattr("agribot.autonomy.control.follower.Follower.__init__", _softer_follower())
    assert main(["replay", "--check", str(run)]) == 1
    assert "commands differ from tick" in capsys.readouterr().out


def test_a_recording_that_cannot_be_checked_keeps_no_other_from_its_check(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    no_ticks, absent = tmp_path / "no-ticks.mcap", tmp_path / "absent.mcap"
    convert(run, no_ticks, ConvertOptions(topics=("/agribot/fix",)))
    capsys.readouterr()
    assert main(["replay", "--check", str(no_ticks), str(absent), str(run)]) == 2
    first, second, third = capsys.readouterr().out.splitlines()
    assert f"not checked: {no_ticks} holds no ticks" in first
    assert f"{absent}: not checked: " in second
    assert "every command is identical" in third
    assert main(["replay", str(no_ticks), str(run), "--json"]) == 2
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["identical"] is False
    assert [one["identical"] for one in result["recordings"]] == [None, True]


def test_wrong_settings_are_refused(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["replay", str(run), "--with", "mission.sped_mps=0.2"]) == 2
    assert "did you mean 'speed_mps'" in capsys.readouterr().err
    assert main(["replay", str(run), str(run), "--with", "mission.speed_mps=0.2"]) == 2
    assert "--with compares one recording" in capsys.readouterr().err


def _softer_follower() -> object:
    """A code change as it may happen: the follower takes errors out over twice the distance."""
    import msgspec

    from agribot.autonomy.control.follower import Follower

    original = Follower.__init__

    def changed(self: Follower, config: object, *arguments: object) -> None:
        softer = msgspec.structs.replace(config, length_m=0.8)  # type: ignore[type-var]
        original(self, softer, *arguments)  # type: ignore[arg-type]

    return changed
