"""Files of the page on their way: compressed, cached, in parts, and with their licences."""

from __future__ import annotations

import asyncio
import gzip
import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette")
from starlette.requests import Request
from starlette.types import Message

from agribot.ui.robot_side.about_run import PAGE_DIR
from agribot.ui.server.page_files import page_file

ROOT = Path(__file__).parents[2]
SCRIPT = b"const words = 'again and again'\n" * 200
Answer = tuple[int, dict[str, str], bytes]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "main.js").write_bytes(SCRIPT)
    (tmp_path / "main.js.gz").write_bytes(gzip.compress(SCRIPT))
    (tmp_path / "icon.svg").write_bytes(b"<svg/>")
    return tmp_path


def ask(folder: Path, name: str, **headers: str) -> Answer:
    named = [(key.replace("_", "-").encode(), value.encode()) for key, value in headers.items()]
    scope: dict[str, Any] = {"type": "http", "method": "GET", "path": f"/{name}", "headers": named}
    sent: list[Message] = []

    async def receive() -> Message:
        await asyncio.get_running_loop().create_future()
        raise AssertionError

    async def send(message: Message) -> None:
        sent.append(message)

    async def answer() -> None:
        await page_file(Request(scope), folder, name, "no-cache")(scope, receive, send)

    asyncio.run(answer())
    found = {key.decode(): value.decode() for key, value in sent[0]["headers"]}
    return sent[0]["status"], found, b"".join(message.get("body", b"") for message in sent[1:])


def test_a_browser_that_can_gets_the_compressed_copy_and_others_the_file(folder: Path) -> None:
    status, headers, body = ask(folder, "main.js", accept_encoding="deflate, gzip;q=0.5")
    assert (status, headers["content-encoding"]) == (200, "gzip")
    assert "javascript" in headers["content-type"]
    assert int(headers["content-length"]) == len(body) < len(SCRIPT) / 10
    assert gzip.decompress(body) == SCRIPT
    for accepted in ("", "br", "gzip;q=0", "identity"):
        _, plain, body = ask(folder, "main.js", accept_encoding=accepted)
        assert body == SCRIPT
        assert "content-encoding" not in plain
        assert plain["vary"] == headers["vary"] == "accept-encoding"
        assert plain["etag"] != headers["etag"]
    assert ask(folder, "icon.svg", accept_encoding="gzip")[2] == b"<svg/>"


def test_what_a_browser_has_is_not_sent_again(folder: Path) -> None:
    etag = ask(folder, "main.js", accept_encoding="gzip")[1]["etag"]
    known = f'"other", W/{etag}'
    status, headers, body = ask(folder, "main.js", accept_encoding="gzip", if_none_match=known)
    assert (status, body, headers["etag"]) == (304, b"", etag)
    assert ask(folder, "main.js", accept_encoding="br", if_none_match=known)[0] == 200


def test_a_part_is_one_of_the_file_itself(folder: Path) -> None:
    status, headers, body = ask(folder, "main.js", accept_encoding="gzip", range="bytes=6-10")
    assert (status, body) == (206, b"words")
    assert headers["content-range"] == f"bytes 6-10/{len(SCRIPT)}"
    assert "content-encoding" not in headers


def test_no_name_leads_out_of_the_folder(folder: Path) -> None:
    assert ask(folder / "sub", "../main.js", accept_encoding="gzip")[0] == 404


def built() -> Path:
    if not (PAGE_DIR / "index.html").is_file():
        pytest.fail("The page is not built: run `pip install -e .` or `npm run build` in web/.")
    return PAGE_DIR


def test_every_large_file_of_the_page_has_a_compressed_copy() -> None:
    large = [path for path in built().rglob("*.*") if path.stat().st_size > 1000]
    plain = [path for path in large if path.suffix != ".gz"]
    assert any(path.suffix == ".js" for path in plain)
    for path in plain:
        assert gzip.decompress(Path(f"{path}.gz").read_bytes()) == path.read_bytes(), path.name


def test_the_way_to_the_map_stays_light() -> None:
    names = ("index", "view", "maplibre-gl")
    files = [path for name in names for path in (built() / "assets").glob(f"{name}*.gz")]
    assert len(files) >= 6
    assert sum(path.stat().st_size for path in files) < 650_000


def test_every_package_in_the_page_has_its_licence_beside_it() -> None:
    text = (built() / "licences.txt").read_text(encoding="utf-8")
    lock = json.loads((ROOT / "web" / "package-lock.json").read_text(encoding="utf-8"))
    sections = {part.split("\n")[1]: part for part in f"\n{text}".split(f"\n{'-' * 78}")[1:]}
    runs = {
        name.rpartition("node_modules/")[2]: about
        for name, about in lock["packages"].items()
        if name and not about.get("dev") and "@types/" not in name
    }
    assert len(runs) > 10
    for name, about in runs.items():
        section = sections[f"{name} {about['version']} ({about['license']})"]
        assert "copyright" in section.lower(), name
        assert len(section) > 500, name
