"""A file that keeps the tokens: links and open pages of yesterday's run still work."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

pytest.importorskip("starlette")
from agribot.commands.page import add_address_arguments, address_of
from agribot.errors import ConfigError
from agribot.ui.access import Access, Caller
from agribot.ui.address import Address
from agribot.ui.token_file import read_or_make_tokens


def started(*words: str) -> Address:
    parser = argparse.ArgumentParser()
    add_address_arguments(parser)
    return address_of(parser.parse_args([*words, "--host", "0.0.0.0"]))


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
