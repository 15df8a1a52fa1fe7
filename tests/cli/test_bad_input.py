"""Wrong input ends with status 2 and one message that says what to do; nothing has moved."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.sim.platform import SimPlatform


@pytest.fixture(autouse=True)
def robot_must_not_move(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The program turns an exception into a status: what was commanded is kept and looked at."""
    commands: list[object] = []
    monkeypatch.setattr(SimPlatform, "write", lambda _, command: commands.append(command))
    yield
    assert commands == []


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Run the program, expect status 2 and return its one line of complaint."""
    try:
        status = main(arguments)
    except SystemExit as stop:  # argparse
        status = int(stop.code or 0)
    printed = capsys.readouterr()
    assert status == 2
    assert "Traceback" not in printed.err
    complaint = printed.err.strip().splitlines()[-1]
    assert complaint.startswith("agribot")
    return complaint


# What is wrong -> arguments, and words of the complaint; {folder} holds FILES.
WRONG: dict[str, tuple[str, tuple[str, ...]]] = {
    "a profile": ("fram", ("fram", "did you mean 'farm'")),
    "a key": ("farm --set mission.sped_mps=0.4", ("mission.sped_mps", "speed_mps")),
    "a value": ("farm --set mission.speed_mps=9", ("mission.speed_mps", "2.0")),
    "sensors": ("farm --sensors rtx", ("rtx", "m8n")),
    "a xacro": ("farm --robot {folder}/broken.xacro", ("broken.xacro", "line 4")),
    "a world without ground": ("farm --world {folder}/void.world", ("void", "ground")),
    "a world": ("farm --world Fram", ("Fram", "Farm")),
    "weights": (
        "farm --set perception.model={folder}/nowhere.onnx",
        ("nowhere.onnx", "agribot train"),
    ),
    "an output folder": ("farm --out {folder}/far.csv/run", ("{folder}/far.csv", "--out")),
    "a waypoint 10 km away": ("farm --waypoints {folder}/far.csv", ("1000", "far.csv")),
    "no speed": ("farm --speed=0", ("0", "max")),
    "a speed backwards": ("farm --speed=-1", ("-1", "max")),
    "a speed without a number": ("farm --speed=nan", ("nan", "max")),
    "a speed in words": ("farm --speed=fast", ("fast", "max")),
}
FILES = {
    "broken.xacro": '<?xml version="1.0"?>\n<robot name="r">\n  <link name="a">\n</robot>\n',
    "void.world": '<?xml version="1.0"?>\n<sdf version="1.9"><world name="void"></world></sdf>\n',
    "far.csv": "lat,lon\n21.161289,72.787022\n21.251289,72.787022\n",
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_named_with_what_would_be_right(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, what: str
) -> None:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    arguments, words = WRONG[what]
    named = ("--out", str(tmp_path / "run"), *arguments.format(folder=tmp_path).split())
    complaint = refused(capsys, "run", *named)
    for word in words:
        assert word.format(folder=tmp_path) in complaint
