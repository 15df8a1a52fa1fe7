"""Settings: what a user may write, and the message for what he may not."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from agribot.core.config import RunConfig, list_profiles, load, to_toml
from agribot.core.errors import ConfigError


def refusal(*settings: str, profile: str = "farm") -> str:
    with pytest.raises(ConfigError) as caught:
        load(profile, settings)
    return str(caught.value)


def write(folder: Path, text: str) -> str:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_there_is_a_farm_profile_and_every_profile_loads_under_its_own_name() -> None:
    assert "farm" in list_profiles()
    for name in list_profiles():
        assert load(name).profile == name


@pytest.mark.parametrize("name", list_profiles())
def test_the_resolved_settings_of_a_run_reload_equal(name: str, tmp_path: Path) -> None:
    config = load(name, ["seed=7", "mission.speed_mps=0.55", "sim.weed_density_per_m2=3.5"])
    assert load(write(tmp_path, to_toml(config))) == config


def test_what_is_not_set_stays_not_set_through_a_file(tmp_path: Path) -> None:
    config = load("farm")
    assert config.duration_s is None
    text = to_toml(config)
    assert "duration_s" not in text
    assert load(write(tmp_path, text)).duration_s is None


def test_a_file_needs_to_name_only_what_it_changes(tmp_path: Path) -> None:
    config = load(write(tmp_path, "[mission]\nspeed_mps = 0.7\n"))
    assert config.mission.speed_mps == 0.7
    assert config.mission.headland_m == RunConfig().mission.headland_m
    assert config.estimate == RunConfig().estimate


def test_a_file_with_the_mark_and_line_ends_of_windows_is_read(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_bytes("\ufeffseed = 3\r\n[mission]\r\nspeed_mps = 0.3\r\n".encode())
    config = load(str(path))
    assert (config.seed, config.mission.speed_mps) == (3, 0.3)


def test_settings_of_a_file_are_called_by_its_name_unless_it_says_another(tmp_path: Path) -> None:
    assert load(write(tmp_path, "seed = 3\n")).profile == "mine"
    assert load(write(tmp_path, 'profile = "east field"\n')).profile == "east field"


def test_every_default_lies_in_its_own_range() -> None:
    """Struct defaults are not validated when the struct is made; a round trip does it."""
    assert msgspec.convert(msgspec.to_builtins(RunConfig()), RunConfig) == RunConfig()


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("seed=12", 12),
        ("mission.speed_mps=0.6", 0.6),
        ("mission.speed_mps=1", 1.0),
        ("perception.enabled=false", False),
        ("world=Orchard", "Orchard"),
        ('world="Orchard 2"', "Orchard 2"),
        ("waypoints=some/file.csv", "some/file.csv"),
        ("sim.weed_density_per_m2=2.5", 2.5),
        ("field.first_row_start_map_m=[3.0, -1.5]", (3.0, -1.5)),
        ("field.datum.lat_deg=-33.9", -33.9),
        (" seed = 3 ", 3),
    ],
)
def test_a_setting_of_any_kind_arrives(setting: str, value: object) -> None:
    found: object = load("farm", [setting])
    for name in setting.partition("=")[0].strip().split("."):
        found = getattr(found, name)
    assert found == value
    assert type(found) is type(value)


def test_later_settings_win_and_neighbours_stay() -> None:
    config = load("farm", ["field.row_count=3", "field.row_count=4", "field.row_pitch_m=0.75"])
    assert (config.field.row_count, config.field.row_pitch_m) == (4, 0.75)
    assert config.field.row_length_m == load("farm").field.row_length_m


def test_a_whole_group_can_be_set_as_an_inline_table() -> None:
    config = load("farm", ["field.datum={lat_deg=52.0, lon_deg=5.0}"])
    assert (config.field.datum.lat_deg, config.field.datum.lon_deg) == (52.0, 5.0)


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("mission.sped_mps=1", "unknown setting 'mission.sped_mps'; did you mean 'speed_mps'?"),
        ("mision.speed_mps=1", "unknown setting 'mision'; did you mean 'mission'?"),
        ("field.datum.lat=3", "unknown setting 'field.datum.lat'; did you mean 'lat_deg'?"),
        ("qqqq=1", "unknown setting 'qqqq'; known here: profile, seed,"),
        ("mission.speed_mps=fast", "mission.speed_mps = 'fast': expected `float`, got `str`"),
        ("seed=1.5", "seed = 1.5: expected `int`, got `float`"),
        ("perception.enabled=1", "perception.enabled = 1: expected `bool`, got `int`"),
        ("mission=3", "mission = 3: expected `object`, got `int`"),
        ("mission.speed_mps=9", "mission.speed_mps = 9: expected `float` <= 2.0"),
        ("mission.speed_mps=0", "mission.speed_mps = 0: expected `float` > 0.0"),
        ("weeds.min_sightings=0", "weeds.min_sightings = 0: expected `int` >= 1"),
        ("sim.weed_density_per_m2=-1", "sim.weed_density_per_m2 = -1: expected `float` >= 0.0"),
        ("field.datum.lat_deg=91", "field.datum.lat_deg = 91: expected `float` <= 90.0"),
        ("field.first_row_start_map_m=[1]", "expected `array` of length 2, got 1"),
        ("field.first_row_start_map_m=[1,true]", "expected `float`, got `bool` at [1]"),
        ("mission.headland_m=inf", "mission.headland_m = inf: not finite"),
        ("field.first_row_start_map_m=[1,nan]", "map_m[1] = nan: not finite"),
        ("mission.speed_mps", "write it as key.subkey=value"),
        ("=3", "write it as key.subkey=value"),
        ("seed.low=3", "'seed' is a value, not a group"),
        (
            'safety.must_report=["redbutton"]',
            "did you mean 'red button'?; known: red button, bumper",
        ),
        ('safety.must_report="red button"', "expected `array | null`, got `str`"),
        ("profile=beet", "a name and no setting; begin with that profile instead"),
    ],
)
def test_a_bad_setting_is_refused_with_key_value_and_limit(setting: str, told: str) -> None:
    profile_first = ("seed=1",) if setting.startswith("seed.") else ()
    message = refusal(*profile_first, setting)
    assert told in message
    assert f"--set {setting}" in message


def test_an_unknown_key_in_a_file_names_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, "[treatment]\nmargin = 0.1\n")
    message = refusal(profile=path)
    assert path in message
    assert "unknown setting 'treatment.margin'; did you mean 'margin_m'?" in message


def test_a_file_that_is_not_toml_names_the_file_and_the_place(tmp_path: Path) -> None:
    path = write(tmp_path, "seed = \n")
    message = refusal(profile=path)
    assert f"{path} is not valid TOML" in message
    assert "line 1" in message


def test_an_unknown_profile_is_answered_with_the_known_ones() -> None:
    message = refusal(profile="fram")
    assert "unknown profile 'fram'; did you mean 'farm'?" in message
    assert "path to a .toml file" in message


def test_a_missing_file_is_said_to_be_missing(tmp_path: Path) -> None:
    assert "does not exist" in refusal(profile=str(tmp_path / "none.toml"))


def test_settings_cannot_be_changed_after_loading() -> None:
    config = load("farm")
    with pytest.raises(AttributeError):
        config.mission.speed_mps = 2.0  # type: ignore[misc]
