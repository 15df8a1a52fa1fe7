"""A file that keeps the tokens: links and open pages of yesterday's run still work."""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("starlette")
from agribot.cli.run.page import add_address_arguments, choose_address
from agribot.core.errors import ConfigError
from agribot.ui.address import Address
from agribot.ui.robot_side.token_file import read_or_make_tokens
from agribot.ui.server import access
from agribot.ui.server.access import Access, Caller


def started(*words: str) -> Address:
    parser = argparse.ArgumentParser()
    add_address_arguments(parser)
    return choose_address(parser.parse_args([*words, "--host", "0.0.0.0"]))


def access_of(address: Address) -> Access:
    return Access(
        ("robot",), 8080, address.operator_token, address.viewer_token, address.session_key,
        is_local=False,
    )  # fmt: skip


def test_the_next_start_knows_the_links_and_the_browsers_of_the_last(tmp_path: Path) -> None:
    words = ("--token-file", str(tmp_path / "own" / "tokens.json"))
    first, second = started(*words), started(*words)
    assert first.url(8080) == second.url(8080)
    cookie = access_of(first).login(first.operator_token, "10.0.0.1")
    access = access_of(second)
    headers = {"host": "robot:8080", "cookie": f"{access.cookie}={cookie}"}
    assert isinstance(access.check("http", "GET", "/api/v1/field", headers), Caller)
    assert started().operator_token != started().operator_token


def test_a_session_ends_with_the_start_of_the_machine_however_long_the_next_one_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock by which it grows old begins anew, and comes to its time once more."""
    boot = tmp_path / "boot_id"
    monkeypatch.setattr(access, "BOOT_ID", boot)
    address = started("--token-file", str(tmp_path / "tokens.json"))

    def set_uptime(uptime_s: float) -> None:
        monkeypatch.setattr(access, "time", SimpleNamespace(monotonic=lambda: uptime_s))

    def is_known_at(uptime_s: float, cookie: str) -> bool:
        set_uptime(uptime_s)
        door = access_of(address)
        headers = {"host": "robot:8080", "cookie": f"{door.cookie}={cookie}"}
        return isinstance(door.check("http", "GET", "/api/v1/field", headers), Caller)

    boot.write_text("first\n")
    set_uptime(5000.0)
    cookie = access_of(address).login(address.operator_token, "10.0.0.1")
    assert isinstance(cookie, str)
    assert is_known_at(6000.0, cookie)
    boot.write_text("second\n")
    assert not is_known_at(600.0, cookie)
    assert not is_known_at(6000.0, cookie)


def test_the_file_is_for_its_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "tokens.json"
    tokens = read_or_make_tokens(path)
    assert path.stat().st_mode & 0o777 == 0o600
    assert tokens.operator != tokens.viewer
    path.chmod(0o644)
    with pytest.raises(ConfigError, match="chmod 600"):
        read_or_make_tokens(path)


@pytest.mark.parametrize(
    "text", ["", "{}", '{"operator": "x", "viewer": "y", "sessions": "z"}', "[" * 2000, "\ufffe"]
)
def test_a_file_without_good_tokens_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "tokens.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match="holds no tokens"):
        read_or_make_tokens(path)
    with pytest.raises(ConfigError, match="name a file"):
        read_or_make_tokens(tmp_path)
