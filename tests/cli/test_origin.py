from __future__ import annotations

import argparse
import datetime as dt
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.cli.run import bridging, origin
from agribot.cli.run.run_settings import add_setting_arguments, read_settings
from agribot.core import config
from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError, PlatformError
from agribot.core.geo import Datum
from agribot.core.messages import GnssFix, GnssQuality
from agribot.drivers.gnss.nmea import write_sentence
from agribot.record.replay import read_config, read_ticks
from agribot.ros.messages import rosmsg
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.ros2 import wire
from agribot.ui.ground import field_of
from tests.drivers import receiver_bytes
from tests.drivers.lines import Line, Opened
from tests.ros.live import free_port, zenoh_peer

HOME = Datum(lat_deg=48.125, lon_deg=11.5, alt_m=510.0)
LIST = """
[home]
lat_deg = 48.125
lon_deg = 11.5
alt_m = 510.0

[hill]
lat_deg = 48.2
lon_deg = 11.6
"""


@pytest.fixture(autouse=True)
def _known_origins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path))
    path = tmp_path / origin.FILE_NAME
    path.write_text(LIST)
    return path


def settings(*words: str) -> RunConfig:
    parser = argparse.ArgumentParser()
    add_setting_arguments(parser)
    bridging.add_arguments(parser)
    return read_settings(parser.parse_args(["farm", *words]))


def fix(place: Datum, quality: GnssQuality = GnssQuality.SINGLE) -> str:
    sample = GnssFix(
        t_s=7.0, lat_deg=place.lat_deg, lon_deg=place.lon_deg, alt_m=place.alt_m, pos_std_m=2.0,
        quality=quality,
    )  # fmt: skip
    return rosmsg.to_cdr(rosmsg.make_fix(sample, "gps")).hex()


def test_the_origin_is_a_named_place_numbers_or_what_the_settings_say() -> None:
    named = settings("--origin", "home").field
    assert (named.datum, named.datum_source) == (HOME, "home")
    told = settings("--origin=-33.5,151.25,12").field
    assert told.datum == Datum(lat_deg=-33.5, lon_deg=151.25, alt_m=12.0)
    assert settings().field == config.load("farm").field


def test_an_option_of_its_own_counts_more_than_the_settings_datum() -> None:
    elsewhere = "field.datum={lat_deg = 1.0, lon_deg = 2.0}"
    assert settings("--set", elsewhere, "--origin", "home").field.datum == HOME
    farm = config.load("farm").field.datum
    latched = settings("--set", elsewhere, "--origin", "auto").field
    assert (latched.datum, latched.datum_source) == (farm, "the place of world Farm")


def test_a_run_at_a_named_origin_has_its_fixes_its_map_and_its_page_there(
    tmp_path: Path,
) -> None:
    out = tmp_path / "run"
    words = ["--origin", "home", "--for", "2", "--set", "perception.enabled=false"]
    main(["run", "farm", *words, "--out", str(out)])
    *_, last = ticks = list(read_ticks(out / "run.mcap"))
    fixes = [sample for tick in ticks for sample in tick.batch.gnss]
    assert fixes
    for sample in fixes:
        assert sample.lat_deg == pytest.approx(HOME.lat_deg, abs=1e-4)  # 11 m
        assert sample.lon_deg == pytest.approx(HOME.lon_deg, abs=1e-4)
        assert sample.alt_m == pytest.approx(HOME.alt_m, abs=2.0)
    assert (last.estimate.x_map_m, last.estimate.y_map_m) == pytest.approx((-2.0, 0.3), abs=0.6)
    kept = read_config(out / "run.mcap")
    assert kept.field.datum == HOME
    shown = field_of(kept, ())
    assert (shown.datum.lat_deg, shown.datum.lon_deg) == (HOME.lat_deg, HOME.lon_deg)
    assert shown.datum_source == "home"


@pytest.mark.parametrize("is_auto", [True, False], ids=["auto", "named topic"])
def test_the_first_valid_fix_of_a_receiver_becomes_the_origin(*, is_auto: bool) -> None:
    locator = f"tcp/127.0.0.1:{free_port()}"
    words = ["--ros-router", locator, "--origin", "auto" if is_auto else "ros2:/pole/fix"]
    if is_auto:
        words += ["--set", 'sources.gnss="ros2:/pole/fix"']
    found: list[RunConfig] = []
    waiting = threading.Thread(target=lambda: found.append(settings(*words)), daemon=True)
    waiting.start()
    name, kind = "/pole/fix", "sensor_msgs/msg/NavSatFix"
    key = wire.make_topic_key(0, name, kind, load_types().hash_rihs01(kind))
    mark = wire.pack_attachment(1, 0, b"g" * 16).hex()
    no_fix = fix(Datum(lat_deg=0.0, lon_deg=0.0), GnssQuality.NONE)
    with zenoh_peer(locator) as talk:
        for _ in range(600):
            talk("put", key, no_fix, mark, 1, 0.0)
            talk("put", key, fix(HOME), mark, 1, 0.0)
            waiting.join(0.1)
            if not waiting.is_alive():
                break
    (latched,) = found
    assert latched.field.datum == HOME
    assert latched.field.datum_source == "first fix of ros2:/pole/fix"


@contextmanager
def speaking(folder: Path, make: Callable[[dt.datetime], bytes]) -> Iterator[Line]:
    """Open a serial line whose receiver speaks ten times a second."""
    line, ended = Line(folder, "ttyGNSS"), threading.Event()

    def speak() -> None:
        tick = 0
        while not ended.wait(0.01):
            line.blurt(make(receiver_bytes.EPOCH + tick * dt.timedelta(milliseconds=100)))
            tick += 1

    speaker = threading.Thread(target=speak)
    speaker.start()
    yield line
    ended.set()
    speaker.join()
    line.unplug()


@pytest.fixture
def receiver(tmp_path: Path) -> Iterator[Line]:
    """A serial receiver that says its place ten times a second, and once that it has none."""
    first = [receiver_bytes.make_ubx_searching()]

    def make(at: dt.datetime) -> bytes:
        said = receiver_bytes.make_ubx_pvt(at, HOME.lat_deg, HOME.lon_deg, carrier=2)
        return (first.pop() if first else b"") + said

    with speaking(tmp_path, make) as line:
        yield line


def real_robot(*words: str) -> RunConfig:
    """The settings of a robot whose profile states no origin."""
    parser = argparse.ArgumentParser()
    add_setting_arguments(parser)
    bridging.add_arguments(parser)
    return read_settings(parser.parse_args(["hardware", *words]))


def is_home(datum: Datum) -> bool:
    place = (datum.lat_deg, datum.lon_deg)
    return place == pytest.approx((HOME.lat_deg, HOME.lon_deg), abs=1e-6)


def test_a_serial_receiver_that_gave_the_origin_can_be_opened_by_the_run(receiver: Line) -> None:
    uri = f"serial:{receiver.path}"
    field = settings("--set", f"sources.gnss={uri}", "--origin", "auto").field
    assert is_home(field.datum)
    assert field.datum_source == f"first fix of {uri}"
    opened = Opened()
    try:
        assert opened.wait_for(opened.open("gnss", uri))
    finally:
        opened.close()


def test_a_real_robot_without_an_origin_takes_its_first_good_fix_and_keeps_it(
    receiver: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = ["--set", f"sources.gnss=serial:{receiver.path}"]
    assert is_home(real_robot(*source).field.datum)
    assert "kept in" in capsys.readouterr().err
    again = real_robot("--set", "sources.gnss=serial:/dev/none").field
    assert is_home(again.datum)
    assert again.datum_source == f"first fix, from {tmp_path / origin.FIRST_FIX_FILE_NAME}"
    assert "--origin auto takes a new one" in capsys.readouterr().err


def test_a_real_robot_that_is_taken_elsewhere_keeps_the_fix_that_its_person_asks_for(
    receiver: Line, tmp_path: Path
) -> None:
    (tmp_path / origin.FIRST_FIX_FILE_NAME).write_text("lat_deg = 1.0\nlon_deg = 2.0\n")
    real_robot("--set", f"sources.gnss=serial:{receiver.path}", "--origin", "auto")
    assert is_home(real_robot().field.datum)


def test_an_origin_that_is_stated_counts_more_than_one_that_is_kept(tmp_path: Path) -> None:
    (tmp_path / origin.FIRST_FIX_FILE_NAME).write_text("lat_deg = 1.0\nlon_deg = 2.0\n")
    stated = "field.datum={lat_deg = 3.0, lon_deg = 4.0}"
    assert real_robot("--set", stated).field.datum == Datum(lat_deg=3.0, lon_deg=4.0)
    assert real_robot("--origin", "home").field.datum == HOME
    assert settings().field == config.load("farm").field
    assert real_robot().field.datum == Datum(lat_deg=1.0, lon_deg=2.0)


@pytest.mark.parametrize(
    "said", [b"", receiver_bytes.make_ubx_pvt(h_acc_m=200.0)], ids=["nothing", "a rough place"]
)
def test_a_real_robot_without_a_good_fix_starts_without_an_origin_and_keeps_none(
    said: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(origin, "UNASKED_PATIENCE_S", 0.2)
    line = Line(tmp_path, "ttyGNSS")
    line.say(said)
    assert real_robot("--set", f"sources.gnss=serial:{line.path}").field.datum_source == ""
    line.unplug()
    assert "no good fix" in capsys.readouterr().err
    assert not (tmp_path / origin.FIRST_FIX_FILE_NAME).exists()


def test_a_receiver_that_states_no_altitude_gives_an_origin_on_the_ellipsoid(
    tmp_path: Path,
) -> None:
    def make(at: dt.datetime) -> bytes:
        time = f"{at:%H%M%S}.{at.microsecond // 10_000:02d}"
        return write_sentence(f"GNRMC,{time},A,4807.50000,N,01130.00000,E,0.0,,040526,,,D")

    with speaking(tmp_path, make) as line:
        datum = real_robot("--set", f"sources.gnss=serial:{line.path}").field.datum
    assert (datum.lat_deg, datum.lon_deg, datum.alt_m) == pytest.approx((48.125, 11.5, 0.0))


def test_a_real_robot_without_a_receiver_cannot_ask_it_for_the_origin() -> None:
    with pytest.raises(ConfigError, match="no receiver; name one with --source gnss="):
        real_robot("--origin", "auto")


def test_a_receiver_without_a_fix_is_waited_for_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(origin, "PATIENCE_S", 0.2)
    locator = f"tcp/127.0.0.1:{free_port()}"
    with pytest.raises(PlatformError, match=r"no good fix .* of ros2:/fix within"):
        settings("--ros-router", locator, "--origin", "ros2:/fix")


@pytest.mark.parametrize(
    ("wanted", "why"),
    [
        ("homme", "did you mean 'home'"),
        ("48.1,", "LAT,LON"),
        ("91,0", "LAT,LON"),
        ("nan,0", "finite"),
        ("1,2,3,4", "LAT,LON"),
        ("usb:/dev/ttyUSB0", "write ros2:/topic"),
    ],
)
def test_an_origin_that_is_none_is_refused(wanted: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        settings("--origin", wanted)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[home", "not valid TOML"),
        ("[home]\nlat_deg = 1.0", "missing required field `lon_deg`"),
        ("[home]\nlat_deg = 1.0\nlon_deg = 2.0\nhight = 3", "unknown field `hight`"),
        ("[home]\nlat_deg = 1.0\nlon_deg = 2.0\nheading_deg = 30.0", "must be 0"),
        ("[home]\nlat_deg = 100.0\nlon_deg = 2.0", "<= 90"),
    ],
)
def test_a_list_of_origins_that_is_wrong_is_refused_by_its_place(
    text: str, why: str, _known_origins: Path
) -> None:
    _known_origins.write_text(text)
    with pytest.raises(ConfigError, match=why) as refusal:
        settings("--origin", "home")
    assert origin.FILE_NAME in str(refusal.value)


def test_a_run_that_goes_on_keeps_its_origin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "--resume", str(tmp_path), "--origin", "home"]) == 2
    assert "keeps its map" in capsys.readouterr().err
