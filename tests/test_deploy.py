"""The script, the unit and the rules that make a computer the computer of a robot."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from agribot.app.service_manager import SIGNS_OF_LIFE
from agribot.cli.run.sensor_sources import read_source_settings
from agribot.core import config
from agribot.drivers.line.schemes import read_sources
from agribot.drivers.probe.found_devices import RECEIVERS, SERIAL_MAKERS
from tests import machine
from tests.cli.parser_tree import every_parser

DEPLOY = Path(__file__).parents[1] / "deploy"
UNIT = DEPLOY / "agribot.service"
INSTALLED = (
    "etc/agribot/agribot.env",
    "etc/systemd/system/agribot.service",
    "etc/udev/rules.d/70-agribot.rules",
)
# Stands for every program that would change the machine; each call is a line of the log.
STUB = """#!/bin/sh
echo "$(basename "$0") $*" >>"$LOG"
case "$(basename "$0") $*" in
  "uname -m") echo "${MACHINE:-aarch64}" ;;
  "id -u") echo 0 ;;
  "id -nG agribot") echo "agribot dialout video input" ;;
  "id agribot") [ -e "$LOG.user" ] ;;
  useradd*) touch "$LOG.user" ;;
  apt-get*) touch "$LOG.apt" ;;
  apt-cache*) [ -n "$ARCHIVE" ] && [ "$2" = "$ARCHIVE" ] ;;
  python*"version_info <"*)
    case "$(basename "$0")" in
      python3) [ -z "$OLD" ] ;;
      python3.11) [ -e "$LOG.apt" ] ;;
      *) false ;;
    esac ;;
  python*"-m venv"*) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" ;;
esac
"""
PYTHONS = ("python3", "python3.11", "python3.12", "python3.13", "python3.14")
STUBS = (
    "uname", "id", "useradd", "usermod", "apt-get", "apt-cache", "systemctl", "udevadm", *PYTHONS
)  # fmt: skip


class Computer:
    """A folder that stands for /, with programs that only say that they were called."""

    def __init__(self, folder: Path) -> None:
        for name in ("cmp", "grep"):
            machine.require(name)  # the script calls them
        self.root, self._log, self._programs = folder / "root", folder / "log", folder / "bin"
        for place in (self.root / "etc", self._programs):
            place.mkdir(parents=True)
        (self.root / "etc/os-release").write_text('PRETTY_NAME="Ubuntu 22.04"\n')
        for name in STUBS:
            (self._programs / name).write_text(STUB)
            (self._programs / name).chmod(0o755)

    def install(
        self, *options: str, settings: Mapping[str, str] | None = None
    ) -> tuple[int, str, list[str]]:
        """Run the script; returns its status, what it said, and which programs it called."""
        self._log.write_text("")
        done = subprocess.run(
            ["bash", DEPLOY / "install.sh", *options],
            env={"PATH": f"{self._programs}:{os.environ['PATH']}", "LOG": str(self._log),
                 "DESTDIR": str(self.root), **(settings or {})},
            capture_output=True, text=True, check=False, timeout=60,
        )  # fmt: skip
        return done.returncode, done.stdout + done.stderr, self._log.read_text().splitlines()

    def files(self) -> dict[str, str]:
        return {
            str(path.relative_to(self.root)): path.read_text()
            for path in self.root.rglob("*")
            if path.is_file()
        }


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    return Computer(tmp_path)


CHANGING = ("useradd", "usermod", "apt-get", "systemctl", "udevadm")


def changes(calls: list[str]) -> list[str]:
    return [call for call in calls if call.startswith(CHANGING) or "-m venv" in call]


def test_a_dry_run_says_everything_and_changes_nothing(computer: Computer) -> None:
    before = computer.files()
    status, said, calls = computer.install("--dry-run")
    assert status == 0, said
    assert computer.files() == before
    assert changes(calls) == []
    for words in ("useradd", "-m venv", "agribot.service", "70-agribot.rules", "systemctl enable"):
        assert re.search(f"would run: .*{words}", said), words


def test_an_installation_puts_every_file_in_its_place_and_starts_nothing(
    computer: Computer,
) -> None:
    status, said, calls = computer.install()
    assert status == 0, said
    for name in INSTALLED:
        assert (computer.root / name).read_text() == (DEPLOY / Path(name).name).read_text()
    assert any("-m pip install" in call and "[hardware,ui]" in call for call in calls)
    assert "systemctl enable agribot.service" in calls
    assert not any("start" in call for call in calls)


def test_a_second_time_only_the_package_is_brought_up_to_date(computer: Computer) -> None:
    computer.install()
    mine = computer.root / "etc/agribot/agribot.env"
    mine.write_text("AGRIBOT_RUN=hardware\n")
    before = computer.files()
    status, said, calls = computer.install()
    assert status == 0, said
    assert computer.files() == before
    assert changes(calls) == []
    assert any("-m pip install" in call for call in calls)


def test_a_unit_that_has_changed_is_replaced_and_read_again(computer: Computer) -> None:
    computer.install()
    (computer.root / "etc/systemd/system/agribot.service").write_text("[Unit]\n")
    assert "systemctl daemon-reload" in computer.install()[2]
    assert computer.files()["etc/systemd/system/agribot.service"] == UNIT.read_text()


def test_on_a_jetson_python_3_11_is_taken_from_its_archive(computer: Computer) -> None:
    settings = {"OLD": "yes", "ARCHIVE": "python3.11-venv"}
    status, said, calls = computer.install(settings=settings)
    assert status == 0, said
    assert any(re.match("apt-get install.* python3.11 python3.11-venv", call) for call in calls)
    assert any(call.startswith("python3.11 -m venv") for call in calls)


def test_where_no_new_python_is_to_be_had_it_says_what_to_do(computer: Computer) -> None:
    status, said, calls = computer.install(settings={"OLD": "yes"})
    assert status == 2
    assert "JetPack 6" in said
    assert "--python" in said
    assert changes(calls) == []


def test_a_32_bit_system_is_refused(computer: Computer) -> None:
    status, said, calls = computer.install(settings={"MACHINE": "armv7l"})
    assert (status, changes(calls)) == (2, [])
    assert "64-bit" in said


@machine.needs("shellcheck")
def test_the_script_is_clean() -> None:
    done = subprocess.run(
        ["shellcheck", DEPLOY / "install.sh"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


@machine.needs("systemd-analyze")
def test_systemd_takes_the_unit_as_it_is(tmp_path: Path) -> None:
    unit = tmp_path / UNIT.name  # whose program is there
    unit.write_text(UNIT.read_text().replace("/opt/agribot/bin/agribot", "/bin/true"))
    done = subprocess.run(
        ["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def settings_of(unit: str) -> dict[str, str]:
    return dict(line.split("=", 1) for line in unit.splitlines() if re.match("[A-Z]\\w+=", line))


def test_a_loop_that_hangs_is_started_again_and_a_mission_that_is_done_is_not() -> None:
    settings = settings_of(UNIT.read_text())
    assert (settings["Type"], settings["Restart"]) == ("notify", "on-failure")
    limit_s = float(settings["WatchdogSec"])
    assert limit_s / SIGNS_OF_LIFE >= 10 * 0.02  # some ticks may be late


def test_the_service_starts_with_options_that_there_are() -> None:
    text = (DEPLOY / "agribot.env").read_text()
    (line,) = (one for one in text.splitlines() if one.startswith("AGRIBOT_RUN="))
    actions = every_parser()["run",]._actions
    known = {option for action in actions for option in action.option_strings}
    used = {word for word in line.split() if word.startswith("--")}
    assert used <= known


def test_a_word_with_spaces_in_the_services_options_is_one_source() -> None:
    """In quotes: systemd.service(5) splits $AGRIBOT_RUN as a shell does."""
    text = (DEPLOY / "agribot.env").read_text()
    (example,) = (line for line in text.splitlines() if line.startswith("#   --source"))
    options = every_parser()["run",].parse_args(shlex.split(example.removeprefix("#")))
    settings = config.load("hardware", read_source_settings(options))
    assert read_sources(settings.sources)["camera"].path.startswith("ffmpeg -v error -f v4l2 ")


def rules() -> Iterator[tuple[str, str, str]]:
    """Vendor, product and name of each rule that names a device."""
    for line in (DEPLOY / "70-agribot.rules").read_text().splitlines():
        if "SYMLINK" in line:
            found = dict(re.findall(r'(\w+(?:\{\w+\})?)[=+]=?"([^"]*)"', line))
            product = found.get("ATTRS{idProduct}", "")
            yield found["ATTRS{idVendor}"], product, found["SYMLINK"]


def test_rules_and_doctor_know_the_same_devices() -> None:
    named = list(rules())
    assert len(named) == len(set(named)) > 5
    for vendor, product, name in named:
        maker = SERIAL_MAKERS.get((vendor, product)) or SERIAL_MAKERS[vendor, ""]
        assert name == ("agribot-gnss" if maker in RECEIVERS else "agribot-base")
