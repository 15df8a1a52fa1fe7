"""What a person at a terminal is told while something takes its time."""

from __future__ import annotations

import pytest

from agribot.cli.progress import explain_wait
from tests.waiting import wait_for


def test_only_what_takes_long_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    with explain_wait("compiling", after_s=3600.0):
        pass
    assert capsys.readouterr().err == ""
    with explain_wait("compiling", after_s=0.0):
        wait_for(lambda: capsys.readouterr().err == "compiling\n", "the explanation")
