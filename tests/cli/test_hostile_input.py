"""Whatever a file or an option holds: status 2, one line that names it, no traceback, no flood."""

from __future__ import annotations

import io
import json
import math
import os
import sqlite3
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from agribot.cli.fields.plan import FARTHEST_AB_M, SHORTEST_AB_M
from agribot.cli.main import main
from agribot.core.fact_text import render
from agribot.core.facts import AbLineUnfit

XACRO = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{}</robot>'
DIGITS = "9" * 5000
DEEP = "[" * 100_000
FIELD = ["plan", "--implement-width", "1", "--field"]
ROBOT = ["describe", "--robot"]


def geojson_of(outline: str) -> str:
    return f'{{"type": "Polygon", "coordinates": [[{outline}]]}}'


def many_obstacles(count: int) -> str:
    """Square metres in a row in a long field."""
    step_deg = 4e-5
    rings = [
        (-step_deg, -step_deg, count * step_deg, 2 * step_deg),
        *(
            (k * step_deg, 0.25 * step_deg, (k + 0.25) * step_deg, 0.5 * step_deg)
            for k in range(count)
        ),
    ]
    features = [
        {
            "type": "Feature",
            "properties": {},
            "geometry": {"type": "Polygon", "coordinates": [corners(*ring)]},
        }
        for ring in rings
    ]
    return json.dumps({"type": "FeatureCollection", "features": features})


def corners(west: float, south: float, east: float, north: float) -> list[list[float]]:
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


def endless_tiles() -> bytes:
    with sqlite3.connect(":memory:") as database:
        database.executescript(
            "CREATE TABLE metadata (name TEXT, value TEXT); CREATE VIEW tiles AS "
            "WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n) "
            "SELECT 1 AS zoom_level, k AS tile_column, 1 AS tile_row, x'00' AS tile_data FROM n;"
        )
        return database.serialize()


def geopackage_with_an_open_ring() -> bytes:
    ring = b"\x01\x03\x00\x00\x00\x01\x00\x00\x00\x02\x00\x00\x00" + b"\x00" * 16 + b"\x01" * 16
    with sqlite3.connect(":memory:") as database:
        database.executescript(
            "CREATE TABLE gpkg_geometry_columns (table_name, column_name, srs_id);"
            "INSERT INTO gpkg_geometry_columns VALUES ('areas', 'geom', 4326);"
            "CREATE TABLE areas (geom);"
        )
        head = b"GP\x00\x01" + (4326).to_bytes(4, "little")
        database.execute("INSERT INTO areas VALUES (?)", (head + ring,))
        database.commit()
        return database.serialize()


def packed(name: str, data: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, data)
    return buffer.getvalue()


def corrupt_kmz() -> bytes:
    data = bytearray(packed("doc.kml", b"<kml>" + bytes(range(256)) * 64 + b"</kml>"))
    data[60:90] = bytes(30)
    return bytes(data)


def large_picture() -> bytes:
    buffer = io.BytesIO()
    Image.new("1", (12_000, 12_000)).save(buffer, "PNG")
    return buffer.getvalue()


# What is tried -> (command, file name, content, words of the answer).
FILES: dict[str, tuple[list[str], str, Callable[[], bytes | str], str]] = {
    "TOML in UTF-16 without its mark": (
        ["run"], "mine.toml", lambda: "seed = 1\n".encode("utf-16-le"), "UTF-8",
    ),
    "TOML number": (["run"], "mine.toml", lambda: f"seed = {DIGITS}", "not valid TOML"),
    "TOML depth": (["run"], "mine.toml", lambda: f"seed = {DEEP}", "nested too deeply"),
    "field plan": (
        ["world", "generate", "-o", "x.world"], "f.toml", lambda: b"name = '\0'", "UTF-8",
    ),
    "GeoJSON number": (FIELD, "f.geojson", lambda: geojson_of(f"[{DIGITS}, 1]"), "not valid JSON"),
    "GeoJSON depth": (FIELD, "f.geojson", lambda: DEEP, "not valid JSON"),
    "many obstacles": (FIELD, "f.geojson", lambda: many_obstacles(201), "201"),
    "KML encoding": (
        FIELD, "f.kml", lambda: '<?xml version="1.0" encoding="none"?><kml/>', "unknown encoding",
    ),
    "open ring": (FIELD, "f.gpkg", geopackage_with_an_open_ring, "f.gpkg"),
    "empty GeoPackage": (FIELD, "f.gpkg", bytes, "f.gpkg"),
    "corrupt KMZ": (FIELD, "f.kmz", corrupt_kmz, "f.kmz"),
    "junk Shapefile": (FIELD, "f.zip", lambda: packed("a.shp", b"junk"), "f.zip"),
    "endless MBTiles": (["map", "import"], "m.mbtiles", endless_tiles, "takes too long"),
    "empty PMTiles": (["map", "import"], "m.pmtiles", bytes, "no PMTiles"),
    "tower of powers": (ROBOT, "r.xacro", lambda: XACRO.format('<link n="${9**9**9}"/>'), "bits"),
    "tower in eval": (
        ROBOT, "r.xacro", lambda: XACRO.format('<link name="$(eval 9**9**9)"/>'), "exponent",
    ),
    "long list": (
        ROBOT, "r.xacro", lambda: XACRO.format('<link name="${len([0] * 10**9)}"/>'), "items",
    ),
    "xacro circle": (
        ROBOT, "r.xacro", lambda: XACRO.format('<xacro:include filename="r.xacro"/>'), "itself",
    ),
    "xacro property": (
        ROBOT, "r.xacro", lambda: XACRO.format('<xacro:property value="1"/>'), "name",
    ),
    "SDF include": (
        ["world", "check"], "w.world",
        lambda: '<sdf version="1.9"><world name="w"><include><uri>model://'
        f'{"a" * 300}</uri></include></world></sdf>', "no ground",
    ),
    "waypoints": (
        ["run", "--waypoints"], "w.csv", lambda: "lat,lon\n" + "21,72\n" * 10_001, "10000",
    ),
    "picture": (["predict", "-o", "seen"], "p.png", large_picture, "limit of 64 million"),
}  # fmt: skip


@pytest.mark.parametrize("what", FILES)
def test_a_hostile_file_is_refused_in_one_line_that_names_it(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command, name, content, words = FILES[what]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path))
    monkeypatch.setattr("agribot.gis.mbtiles.MAX_STEPS", 2_000_000)
    data = content()
    path = tmp_path / name
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    status = main([*command, str(path)])
    said = capsys.readouterr().err.strip().splitlines()
    refusal = next(line for line in said if words in line)
    assert status == (1 if what == "picture" else 2), said
    assert "internal error" not in refusal
    if what != "many obstacles":  # those are counted in the field, whatever file it came from
        assert name in refusal


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("train --out x --minutes nan", "finite number"),
        ("train --out x --minutes 1e999", "finite number"),
        ("train --out x --size x", "write width and height"),
        ("train --out x --fold 7", "--folds"),
        ("live sim --seconds nan", "finite number"),
        ("run --for inf", "finite number"),
        (f"run --seed {'7' * 400}", "77...: not accepted; give a whole number"),
        (f"run --set seed={DIGITS}", "seed"),
        ("run --platform banana", "platform = 'banana'; known: sim"),
        ("run --set platform=banana", "platform = 'banana'; known: sim"),
        ("run --foxglove --foxglove-port 99999", "from 0 to 65535"),
        ("view rviz x.mcap --ros-master junk", "http://HOST:PORT"),
        ("node plot --ros1 --ros-master junk", "http://HOST:PORT"),
        ("predict x --threads 0 -o y", "from 1 to 1024"),
        ("bench ui --seconds nan", "finite number"),
        ("bag csv x.mcap /fix -o y.xlsx", "-o y.xlsx: what is written is a table in CSV"),
        ("record recover x.mcap -o y.bag", "-o y.bag: what is written is an MCAP recording"),
        ("view rerun x.mcap -o y.mcap", "give a name that ends with .rrd"),
        ("view foxglove -o y.xml", "give a name that ends with .json"),
        ("dataset split x -o y.csv", "give a name that ends with .json"),
        ("plan --field x --png y.jpg", "what is written is a PNG picture"),
    ],
)
def test_an_impossible_option_is_refused_before_any_work(
    line: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.mcap").write_bytes(b"")
    try:
        status = main(line.split())
    except SystemExit as stop:
        status = int(stop.code or 0)
    assert status == 2
    assert words in capsys.readouterr().err.strip().splitlines()[-1]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.mcap"]


@pytest.mark.parametrize("line", ["0,0,0,0", "72.78,21.16,72.78,21.16", "10,50,11,51"])
def test_an_ab_line_without_direction_or_far_away_is_refused(
    line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    field = str(Path(__file__).parents[2] / "examples" / "field.geojson")
    assert main([*FIELD, field, "--ab-line", line]) == 2
    assert render(AbLineUnfit(line, SHORTEST_AB_M, FARTHEST_AB_M)) in capsys.readouterr().err


def test_a_folder_that_cannot_be_written_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture, taken = tmp_path / "p.png", tmp_path / "taken"
    Image.new("RGB", (32, 32)).save(picture)
    taken.write_text("a file, no folder")
    assert main(["predict", str(picture), "-o", str(taken / "seen")]) == 2
    said = capsys.readouterr().err
    assert str(taken / "seen") in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("kind", [AssertionError, ValueError, OverflowError, ZeroDivisionError])
def test_what_nobody_foresaw_is_called_an_internal_error_and_can_be_found(
    kind: type[Exception], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: object) -> int:
        raise kind("the sum of two\nis three")

    monkeypatch.setattr("agribot.cli.fields.world.run", fail)
    assert main(["world", "list"]) == 2
    assert capsys.readouterr().err == (
        f"agribot world: internal error: {kind.__name__}: the sum of two is three "
        "(set AGRIBOT_TRACEBACK=1 for the details)\n"
    )
    monkeypatch.setenv("AGRIBOT_TRACEBACK", "1")
    assert main(["world", "list"]) == 2
    said = capsys.readouterr().err
    assert "Traceback" in said
    assert 'raise kind("the sum' in said


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (PermissionError(13, "Permission denied", "/a/b"), "/a/b: Permission denied"),
        (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"), "not text in UTF-8"),
        (MemoryError(), "not enough memory"),
        (RecursionError("deep"), "nested too deeply"),
        (EOFError(), "ends too early"),
        (ConnectionResetError("reset by peer"), "another program is not there, or has gone"),
    ],
)
def test_errors_of_the_machine_and_of_inputs_are_told_in_words(
    error: Exception, words: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def fail(_: object) -> int:
        raise error

    monkeypatch.setattr("agribot.cli.fields.world.run", fail)
    assert main(["world", "list"]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert "internal" not in said
    assert said.count("\n") == 1


def run_unread(line: str, closed: str, **more: str) -> tuple[int, bytes]:
    """The status of a command whose `closed` stream has lost its reader, and all that it says."""
    reader, writer = os.pipe()
    os.close(reader)
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, closed: writer}
    command = [sys.executable, "-m", "agribot.cli", *line.split()]
    environment = {**os.environ, **more}
    with subprocess.Popen(
        command, stdout=streams["stdout"], stderr=streams["stderr"], env=environment
    ) as process:
        os.close(writer)
        out, err = process.communicate(timeout=120)
    return process.returncode, (out or b"") + (err or b"")


@pytest.mark.parametrize("line", ["describe --urdf", "world list"])
def test_output_that_nobody_reads_any_more_ends_the_command_silently(line: str) -> None:
    """As `| head` does: long output is noticed at once, short output at the end."""
    assert run_unread(line, "stdout") == (141, b"")
    assert run_unread(line, "stdout", AGRIBOT_TRACEBACK="1") == (141, b"")


@pytest.mark.parametrize("line", ["--help", "world list --help"])
def test_help_that_nobody_reads_any_more_is_no_trouble(line: str) -> None:
    status, said = run_unread(line, "stdout")
    assert status in {0, 141}
    assert said == b""


def test_a_refusal_that_nobody_hears_keeps_its_status() -> None:
    assert run_unread("run nonsense", "stderr") == (2, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_output_that_finds_no_room_is_told_in_one_line() -> None:
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "agribot.cli", "world", "list"],
            check=False, timeout=120, stdout=full, stderr=subprocess.PIPE,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith(b"agribot world: No space left on device")
    assert done.stderr.count(b"\n") == 1


def test_another_pipe_that_breaks_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: object) -> int:
        raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr("agribot.cli.fields.world.run", fail)
    assert main(["world", "list"]) == 2
    assert "another program is not there, or has gone" in capsys.readouterr().err


def test_an_interruption_stays_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr("agribot.cli.fields.world.run", interrupt)
    assert main(["world", "list"]) == 130
    assert capsys.readouterr().err == "agribot world: interrupted\n"


def test_powers_that_a_robot_needs_are_computed() -> None:
    from agribot.description.xacro_arithmetic import evaluate

    assert evaluate("r**2 * 3 + 2**10 + (1 << 4)", {"r": 0.5}) == pytest.approx(1040.75)
    assert evaluate("2**n", {"n": -1}) == 0.5
    assert math.isclose(evaluate("[k**2 for k in points][-1]", {"points": [1.0, 3.0]}), 9.0)
