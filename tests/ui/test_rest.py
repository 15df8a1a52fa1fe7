from __future__ import annotations

import io
import json
import sqlite3
import zipfile
from pathlib import Path
from typing import Any

import msgspec
import pytest
import shapefile
from shapely import wkb
from shapely.geometry import Polygon

from agribot.app.simulated_run import simulate
from agribot.cli.main import main
from agribot.core import config
from agribot.core.geo import MapFrame
from agribot.core.home import find_home
from agribot.core.messages import ChangeSetting
from agribot.gis.mbtiles import import_mbtiles
from agribot.ui import wire
from agribot.ui.address import Address
from agribot.ui.panels import Panels
from agribot.ui.robot_side.operator_page import OperatorPage
from agribot.ui.server.answers import Unusable
from agribot.ui.server.field_routes import find_file_in_form
from tests.ui.client import Browser, Page
from tests.ui.conftest import Robot
from tests.ui.messages import make_weed
from tests.waiting import wait_for

RING = [
    [72.787, 21.161],
    [72.7875, 21.161],
    [72.7875, 21.1615],
    [72.787, 21.1615],
    [72.787, 21.161],
]


FORM = 'multipart/form-data; boundary="b"'
PART = b'--b\r\nContent-Disposition: form-data; name="f"; filename="a.kml"\r\n\r\n%s\r\n--b--\r\n'


def test_the_file_in_a_form_is_taken_byte_by_byte() -> None:
    data = b"\x00\r\n\r\n--\n\xff--b"
    assert find_file_in_form(FORM, PART % data) == ("a.kml", data)


@pytest.mark.parametrize(
    ("form", "data"),
    [
        ("multipart/form-data", PART % b"x"),
        (FORM, b""),
        (FORM, (PART % b"x").replace(b"filename", b"other")),
        (FORM, b"--b\r\nContent-Type: multipart/mixed; boundary=c\r\n\r\n"
               + (PART % b"x").replace(b"--b", b"--c") + b"\r\n--b--"),
    ],
    ids=["no boundary", "nothing", "no file", "a file in a form in the form"],
)  # fmt: skip
def test_a_form_without_a_file_of_its_own_is_refused(form: str, data: bytes) -> None:
    with pytest.raises(Unusable, match="the form"):
        find_file_in_form(form, data)


@pytest.fixture
def browser(robot: Robot) -> Browser:
    return Browser(robot.port)


def field(ring: list[list[float]], *more: dict[str, Any]) -> dict[str, Any]:
    boundary = {
        "type": "Feature",
        "properties": {"kind": "boundary"},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    return {"type": "FeatureCollection", "features": [boundary, *more]}


def test_a_page_learns_what_it_needs_to_draw_the_robot(browser: Browser) -> None:
    status, robot = browser.ask("GET", "/api/v1/robot")
    assert status == 200
    assert len(robot["wheel_joints"]) == 4
    assert len(robot["camera"]["body_from_camera"]) == 16
    xs = [x for x, _ in robot["footprint_body_m"]]
    assert 0.4 < max(xs) - min(xs) < 1.5
    status, urdf = browser.ask("GET", robot["urdf_url"])
    assert status == 200
    text = urdf.decode()
    assert "package://" not in text
    for joint in robot["wheel_joints"]:
        assert f'name="{joint}"' in text
    mesh = text.partition('mesh filename="')[2].partition('"')[0]
    status, data = browser.ask("GET", f"/robot/{mesh}")
    assert status == 200
    assert len(data) > 1000


def test_the_session_says_what_this_page_may_do(browser: Browser) -> None:
    status, session = browser.ask("GET", "/api/v1/session")
    assert status == 200
    assert (session["role"], session["source"], session["camera"]) == ("operator", "sim", True)
    _, shown = browser.ask("GET", "/api/v1/field")
    assert len(shown["rows"]) == 6


def test_the_weed_map_downloads_as_geojson_and_csv(robot: Robot, browser: Browser) -> None:
    robot.say(wire.WeedChanges(set=[make_weed(1, 3.0, 4.0)]))
    features = wait_for(
        lambda: browser.ask("GET", "/api/v1/weeds.geojson")[1]["features"], "the weed"
    )
    lon_deg, lat_deg = features[0]["geometry"]["coordinates"]
    frame = MapFrame(config.load("farm").field.datum)
    assert frame.map_from_geodetic(lat_deg, lon_deg, 0.0)[:2] == pytest.approx((3.0, 4.0), abs=1e-3)
    assert features[0]["properties"]["class"] == "weed"
    status, text = browser.ask("GET", "/api/v1/weeds.csv")
    assert status == 200
    assert text.decode().splitlines()[1].startswith("1,weed,3.0,4.0,")


def test_a_good_field_is_kept_and_a_bad_one_never_replaces_it(browser: Browser) -> None:
    path = "/api/v1/fields/north%20field"
    status, verdict = browser.ask("PUT", path, field(RING))
    assert status == 200
    assert verdict["area_m2"] == pytest.approx(51.96 * 55.37, rel=0.01)
    crossed = [RING[0], RING[2], RING[1], RING[3], RING[0]]
    status, verdict = browser.ask("PUT", path, field(crossed))
    assert status == 422
    assert "self-intersection" in verdict["error"]
    assert verdict["reasons"][0]["at_map_m"] is not None
    assert browser.ask("GET", path)[1] == field(RING)
    assert browser.ask("GET", "/api/v1/fields")[1] == ["north field"]
    assert browser.ask("DELETE", path)[0] == 204
    assert browser.ask("GET", path)[0] == 404


def test_a_drawn_field_is_planned_with_a_certificate(browser: Browser) -> None:
    ring = [[72.7871, 21.1611], [72.7872, 21.1611], [72.7872, 21.1612], [72.7871, 21.1612]]
    drawn = field([*ring, ring[0]])
    request = {"field": drawn, "implement_width_m": 1.0, "headland_passes": 1}
    status, plan = browser.ask("POST", "/api/v1/plan", request)
    assert (status, plan["ok"]) == (200, True), plan
    assert plan["certificate"]["ok"]
    assert plan["length_m"] > 50.0
    assert all(72.787 < lon < 72.7873 and 21.161 < lat < 21.1613 for lon, lat in plan["path"])
    assert not plan["warnings"]
    _, own = browser.ask("POST", "/api/v1/plan", {"field": drawn, "headland_passes": 1})
    assert own["ok"] and not own["warnings"]
    assert own["length_m"] < plan["length_m"], "the robot's own tool is wider"
    _, wide = browser.ask("POST", "/api/v1/plan", {**request, "implement_width_m": 1.5})
    assert wide["ok"] and "stay unworked" in wide["warnings"][0]
    assert wide["area_m2"] < 0.8 * own["area_m2"]
    crossed = field([ring[0], ring[2], ring[1], ring[3], ring[0]])
    _, refusal = browser.ask("POST", "/api/v1/plan", {**request, "field": crossed})
    assert not refusal["ok"]
    assert refusal["reasons"][0]["text"]
    assert browser.ask("POST", "/api/v1/plan", {"field": 3})[0] == 422
    assert browser.ask("POST", "/api/v1/plan/apply", request)[0] == 409, "without the seat"


def feature(kind: str, shape: str, coordinates: Any) -> dict[str, Any]:
    geometry = {"type": shape, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"kind": kind}, "geometry": geometry}


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (feature("row", "LineString", [[72.7871, 21.1611], [72.789, 21.1611]]), "outside"),
        (feature("waypoint", "Point", [10.0, 50.0]), "farther than"),
        (feature("hedge", "Point", [72.7871, 21.1611]), "kind is unknown; give one of"),
        (feature("row", "Point", [72.7871, 21.1611]), "a Point; draw a LineString"),
        (feature("row", "LineString", [[72.7871, 21.1611]]), "feature 2"),
        (feature("waypoint", "Point", ["x", None]), "feature 2"),
        (feature("waypoint", "Point", [72.7871, 10**400]), "feature 2"),
    ],
)
def test_a_field_is_refused_with_the_reason(
    browser: Browser, more: dict[str, Any], words: str
) -> None:
    status, verdict = browser.ask("PUT", "/api/v1/fields/x", field(RING, more))
    assert status == 422
    assert words in json.dumps(verdict)


def kml() -> bytes:
    points = " ".join(f"{lon},{lat},0" for lon, lat in RING)
    return f"""<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>
<name>north</name><Polygon><outerBoundaryIs><LinearRing><coordinates>{points}</coordinates>
</LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>""".encode()


def geopackage(tmp_path: Path) -> bytes:
    path = tmp_path / "x.gpkg"
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE gpkg_geometry_columns (table_name, column_name, srs_id)")
    database.execute("INSERT INTO gpkg_geometry_columns VALUES ('f', 'geom', 4326)")
    database.execute("CREATE TABLE f (id INTEGER, geom BLOB, name TEXT)")
    head = b"GP\x00\x01" + (4326).to_bytes(4, "little")
    blob = head + wkb.dumps(Polygon(RING))
    database.execute("INSERT INTO f VALUES (1, ?, 'north')", (blob,))
    database.commit()
    database.close()
    return path.read_bytes()


def shapes(tmp_path: Path) -> bytes:
    with shapefile.Writer(str(tmp_path / "field")) as writer:
        writer.field("name", "C")
        writer.poly([RING[::-1]])
        writer.record("north")
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for suffix in ("shp", "shx", "dbf"):
            archive.write(tmp_path / f"field.{suffix}", f"field.{suffix}")
    return buffer.getvalue()


def test_field_files_of_other_programs_keep_every_vertex(browser: Browser, tmp_path: Path) -> None:
    files = {
        "a.kml": kml(),
        "a.geojson": json.dumps(field(RING)["features"][0]["geometry"]).encode(),
        "a.gpkg": geopackage(tmp_path),
        "a.zip": shapes(tmp_path),
    }
    for name, data in files.items():
        status, read = browser.ask("POST", f"/api/v1/fields/import?filename={name}", data)
        assert status == 200, (name, read)
        [only] = read["features"]
        assert only["properties"]["kind"] == "boundary"
        corners = {(lon, lat) for lon, lat in only["geometry"]["coordinates"][0]}
        assert corners == {(lon, lat) for lon, lat in RING}, name


def test_one_of_several_fields_in_a_file_is_opened_by_its_name(browser: Browser) -> None:
    """They were all drawn, and none of them could be planned."""
    east = [[lon + 0.01, lat] for lon, lat in RING]
    features = []
    for name, ring in (("West", RING), ("East", east)):
        feature = field(ring)["features"][0]
        features.append({**feature, "properties": {"kind": "boundary", "name": name}})
    row = {"type": "LineString", "coordinates": [east[0], east[2]]}
    features.append({"type": "Feature", "properties": {"kind": "row"}, "geometry": row})
    data = json.dumps({"type": "FeatureCollection", "features": features}).encode()
    path = "/api/v1/fields/import?filename=farm.geojson"
    status, read = browser.ask("POST", path, data)
    assert (status, read["fields"], len(read["features"])) == (200, ["West", "East"], 3)
    status, read = browser.ask("POST", f"{path}&field=East", data)
    assert status == 200
    assert [f["properties"]["kind"] for f in read["features"]] == ["boundary", "row"]
    assert read["features"][0]["geometry"]["coordinates"][0][0] == pytest.approx(east[0])
    status, answer = browser.ask("POST", f"{path}&field=North", data)
    assert status == 422
    assert all(name in answer["error"] for name in ("farm.geojson", "North", "West", "East"))


def test_a_field_is_exported_in_the_format_that_is_asked_for(browser: Browser) -> None:
    for ending, start in (
        (".gpkg", b"SQLite format 3"),
        (".isoxml.zip", b"PK"),
        (".gpx", b"<?xml"),
    ):
        path = f"/api/v1/fields/export?format={ending}"
        status, data = browser.ask("POST", path, field(RING))
        assert (status, data[: len(start)]) == (200, start)
        name = f"/api/v1/fields/import?filename=back{ending}"
        assert browser.ask("POST", name, data)[1]["features"][0]["properties"]["kind"] == "boundary"
    assert browser.ask("POST", "/api/v1/fields/export?format=.dwg", field(RING))[0] == 422
    assert browser.ask("POST", "/api/v1/fields/export?format=.gpx", {"type": "?"})[0] == 422


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.exe", b"x"),
        ("a.kml", b"<kml"),
        ("a.kml", b'<!DOCTYPE x [<!ENTITY a "b">]><kml/>'),
        ("a.geojson", b"{}"),
        ("a.geojson", b'{"type":"Point","coordinates":[]}'),
        ("a.gpkg", b"no database"),
        ("a.zip", b"no archive"),
        ("", b""),
    ],
)
def test_broken_field_files_are_refused_in_one_sentence(
    browser: Browser, name: str, data: bytes
) -> None:
    status, answer = browser.ask("POST", f"/api/v1/fields/import?filename={name}", data)
    assert status in {415, 422}
    assert answer["error"]


def test_views_are_kept_by_name(browser: Browser) -> None:
    view = {"layers": ["weeds", "path"], "zoom": 19}
    assert browser.ask("PUT", "/api/v1/views/mine", view)[0] == 204
    assert browser.ask("GET", "/api/v1/views/mine")[1] == view
    assert browser.ask("GET", "/api/v1/views")[1] == ["mine"]
    assert browser.ask("PUT", "/api/v1/views/.hidden", view)[0] == 400
    assert browser.ask("PUT", "/api/v1/views/x", b"[1]")[0] == 400


def mbtiles(path: Path) -> Path:
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
    database.execute("INSERT INTO metadata VALUES ('bounds', '91,-80,92,-79')")
    database.execute("CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)")
    database.execute("INSERT INTO tiles VALUES (2, 3, 0, ?)", (b"\x89PNG south-east",))
    database.commit()
    database.close()
    return path


def test_a_map_is_imported_and_its_tiles_are_where_they_belong(
    browser: Browser, tmp_path: Path
) -> None:
    import_mbtiles(mbtiles(tmp_path / "farm.mbtiles"), find_home() / "maps", "farm")
    shown = next(one for one in browser.ask("GET", "/api/v1/maps")[1] if one["name"] == "farm")
    assert (shown["name"], shown["minzoom"], shown["bounds"]) == ("farm", 2, [91, -80, 92, -79])
    assert browser.ask("GET", "/tiles/farm/2/3/3") == (200, b"\x89PNG south-east")
    assert browser.ask("GET", "/tiles/farm/2/3/0")[0] == 204
    assert browser.ask("GET", "/tiles/farm/99/3/0")[0] == 204
    assert browser.ask("GET", "/tiles/other/2/3/3")[0] == 404


def test_agribot_map_imports_lists_and_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["map", "import", str(mbtiles(tmp_path / "field.mbtiles"))]) == 0
    assert main(["map", "--json", "list"]) == 0
    listed = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert "field" in {one["name"] for one in listed}
    (tmp_path / "x.mbtiles").write_text("none", encoding="utf-8")
    assert main(["map", "import", str(tmp_path / "x.mbtiles")]) == 2
    assert main(["map", "import", str(tmp_path / "x.tif")]) == 2
    assert "does not exist" in capsys.readouterr().err
    assert main(["map", "import", str(tmp_path / "x.mbtiles"), "--name", "../x"]) == 2
    assert main(["map", "remove", "field"]) == 0
    assert main(["map", "remove", "field"]) == 2


def test_recordings_are_listed_with_their_result_and_can_be_downloaded(
    robot: Robot, browser: Browser
) -> None:
    run = robot.home / "runs" / "first"
    run.mkdir(parents=True)
    (run / "run.mcap").write_bytes(b"data")
    report = {"ok": False, "reason": "too dark", "profile": "farm", "time": {"sim_s": 12.0}}
    (run / "report.json").write_text(json.dumps(report), encoding="utf-8")
    _, listed = browser.ask("GET", "/api/v1/recordings")
    [first] = listed["recordings"]
    assert (first["name"], first["ok"], first["reason"]) == ("first", False, "too dark")
    assert first["duration_s"] == 12.0
    assert listed["disk_free_bytes"] > 0
    assert browser.ask("GET", "/api/v1/recordings/first/run.mcap") == (200, b"data")


def test_settings_are_shown_with_range_and_unit_and_say_when_they_count(
    robot: Robot, browser: Browser
) -> None:
    _, answer = browser.ask("GET", "/api/v1/settings")
    keys = {key["key"]: key for group in answer["groups"] for key in group["keys"]}
    speed = keys["mission.speed_mps"]
    assert (speed["type"], speed["min"], speed["max"], speed["unit"]) == ("number", 0, 2.0, "m/s")
    assert keys["treatment.enabled"]["type"] == "boolean"
    assert keys["sim.actuation"]["choices"] == ["effort", "servo"]
    assert browser.ask("PATCH", "/api/v1/settings", {"mission.speed_mps": 0.5})[0] == 409
    with Page(robot.port, tab="s", additional_headers={"Cookie": browser.cookie}) as page:
        page.take_seat()
        change = {"mission.speed_mps": 0.5, "treatment.enabled": False}
        wrong = {"no.such": 1, "seed": 3, "mission.headland_m": 2.0}
        status, answer = browser.ask("PATCH", "/api/v1/settings", {**change, **wrong})
        assert status == 200
        assert answer["applied"] == change
        assert set(answer["refused"]) == set(wrong)
        order = robot.wait_for_request("set", lambda set: set.setting == "mission.speed_mps")
        assert order.request == ChangeSetting(setting="mission.speed_mps", value=0.5)
        for value in (5.0, -1, "fast", None, True):
            _, answer = browser.ask("PATCH", "/api/v1/settings", {"mission.speed_mps": value})
            assert answer["applied"] == {}, value


def test_health_names_the_slow_sensor_and_what_to_do(robot: Robot, browser: Browser) -> None:
    rates = {"wheels": 100, "imu": 200, "mag": 20, "gnss": 0, "frames": 10}
    for second in range(3):
        samples = {name: rate * second for name, rate in rates.items()}
        clocks = {"wall_s": second, "t_s": second, "cpu_s": 0.1 * second}
        robot.say(wire.TickCounts(**clocks, samples=samples))

    def health_with_gnss() -> Any:
        health = browser.ask("GET", "/api/v1/health")[1]
        slow = [check for check in health["checks"] if check["name"] == "gnss"]
        return slow and (health, slow)

    health, slow = wait_for(health_with_gnss, "the GNSS receiver's health")
    assert slow[0]["state"] == "fault"
    assert slow[0]["advice"] == "check its cable and power"
    german = browser.ask("GET", "/api/v1/health", language="de-AT,en;q=0.5")[1]["checks"]
    advice = {check["name"]: check["advice"] for check in german}
    assert advice["gnss"] == "Kabel und Strom prüfen"
    assert health["memory_bytes"] > 1e6
    assert health["cpu_ratio"] >= 0.1


def test_the_support_bundle_holds_no_token(robot: Robot, browser: Browser) -> None:
    status, data = browser.ask("GET", "/api/v1/support.zip")
    assert status == 200
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert {"versions.txt", "health.json", "settings.json"} <= set(archive.namelist())
        everything = b"".join(archive.read(name) for name in archive.namelist())
    assert robot.address.operator_token.encode() not in everything


class Rate(msgspec.Struct):
    litres_per_ha: float
    note: str = ""


def test_a_program_adds_panels_without_javascript(tmp_path: Path) -> None:
    panels = Panels()
    given: list[Any] = []
    panels.layer("Hedges", {"type": "FeatureCollection", "features": []}, {"color": "#080"})
    panels.form(Rate, given.append, title="Rate")
    panels.image("Sky", lambda: b"\x89PNG sky")
    panels.button("Beep", lambda: "beeped", needs_seat=False)
    panels.button("Break", lambda: 1 / 0, needs_seat=False)
    panels.plot("Speeds", ["v_mps"])
    panels.listen("route", lambda stops: f"{len(stops)} stops")
    settings = config.load("farm", ["perception.enabled=false", "record.enabled=false"])
    with (
        simulate(settings, tmp_path / "run") as session,
        OperatorPage(session, Address(port=0), panels) as page,
    ):
        browser = Browser(page.server.port)
        _, listed = browser.ask("GET", "/api/v1/panels")
        assert [one["kind"] for one in listed] == [
            "layer", "form", "image", "button", "button", "plot", "listener"
        ]  # fmt: skip
        assert browser.ask("GET", "/api/v1/panels/image-sky") == (200, b"\x89PNG sky")
        assert browser.ask("GET", "/api/v1/panels/layer-hedges")[1]["features"] == []
        assert browser.ask("POST", "/api/v1/panels/button-beep", {})[1]["text"] == "beeped"
        status, answer = browser.ask("POST", "/api/v1/panels/button-break", {})
        assert (status, "ZeroDivisionError" in answer["error"]) == (422, True)
        assert browser.ask("POST", "/api/v1/panels/form-rate", {"litres_per_ha": 1})[0] == 409
        cookie = {"Cookie": browser.cookie}
        with Page(page.server.port, tab="f", additional_headers=cookie) as operator:
            operator.take_seat()
            wrong = browser.ask("POST", "/api/v1/panels/form-rate", {"litres_per_ha": "many"})
            assert wrong[0] == 422
            assert browser.ask("POST", "/api/v1/panels/form-rate", {"litres_per_ha": 120})[0] == 200
            stops = {"points": [[0, 0], [1.5, 2]]}
            heard = browser.ask("POST", "/api/v1/panels/listener-route", stops)[1]
            assert heard["text"] == "2 stops"
    assert given == [Rate(litres_per_ha=120.0)]
