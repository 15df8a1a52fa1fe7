"""What the documents name exists: files, headings, commands with their options."""

from __future__ import annotations

import csv
import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from agribot.autonomy.estimate import verdicts
from agribot.autonomy.estimate.filter import ekf
from agribot.autonomy.implements.crop_guard import find_most_keep_off_m
from agribot.core import platform
from agribot.core.config import EstimateConfig, MissionConfig, TreatmentConfig
from agribot.core.version import __version__
from tests.cli.parser_tree import Words, every_parser

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("ros?/*.md")])
OF_TODAY = [page for page in DOCUMENTS if page.name != "CHANGELOG.md"]  # that one is history
TOP_PACKAGES = "app|autonomy|cli|core|description|drivers|gis|lab|record|ros|sim|ui"

_LINK = re.compile(r"\]\(([^)\s]+)\)")
_FILE = re.compile(r"\b((?:src|tests|docs|examples|web|scripts|benchmarks)/[\w./-]*\w)")
_MODULE = re.compile(rf"\bagribot\.(?:{TOP_PACKAGES})(?:\.\w+)+")
_CODE = re.compile(r"`(agribot [^`]+)`")
_FENCE = re.compile(r"^```[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_PARSERS = every_parser()
# Words of commands that are not the program's: a placeholder, and a page's own example.
NOT_OURS = ("COMMAND", "rows", "beacons")


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def anchors_of(path: Path) -> set[str]:
    """The headings of a document as GitHub links to them, and those that its old links name."""
    heads = re.findall(r"^#+ (.+)$", text_of(path), re.MULTILINE)
    named = set(re.findall(r'<a id="([\w-]+)"></a>', text_of(path)))
    return named | {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


def list_missing_links(page: Path) -> Iterator[str]:
    for link in _LINK.findall(text_of(page)):
        if "://" in link:
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name) if name else page
        if not target.exists() or (anchor and anchor not in anchors_of(target.resolve())):
            yield link


@pytest.mark.parametrize("page", DOCUMENTS, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page: Path) -> None:
    assert not [*list_missing_links(page)]


@pytest.mark.parametrize("page", OF_TODAY, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_file_and_module_that_is_named_exists(page: Path) -> None:
    text = text_of(page)
    missing = [name for name in _FILE.findall(text) if not (ROOT / name).exists()]
    assert not [name for name in missing if not is_made(name)]
    modules = (name.split(".") for name in _MODULE.findall(text))
    assert not [".".join(name) for name in modules if not has_module(name)]


def is_made(name: str) -> bool:
    """Whether a build makes it, or it is a pattern of names."""
    return name.startswith(("src/agribot/ui/page", "web/node_modules", "web/.test-build"))


def has_module(name: list[str]) -> bool:
    """Whether a dotted name begins with a module, down to a class or function in it."""
    for length in (len(name), len(name) - 1, len(name) - 2):
        path = (ROOT / "src").joinpath(*name[:length])
        if length > 1 and path.with_suffix(".py").is_file():
            return all(word in text_of(path.with_suffix(".py")) for word in name[length:])
        if length > 1 and (path / "__init__.py").is_file():
            return all(word in text_of(path / "__init__.py") for word in name[length:])
    return False


def whole_commands_of(page: Path) -> Iterator[str]:
    """Every line of a block that begins with `agribot`, up to where the shell goes on."""
    for block in _FENCE.findall(text_of(page)):
        for line in block.replace("\\\n", " ").splitlines():
            if line.startswith("agribot "):
                yield re.split(r"; | [>|&] ", line)[0]


def split_command(text: str) -> tuple[Words, list[str]]:
    """The words of a command and what follows them. Raises: LookupError: no such command."""
    words = shlex.split(text, comments=True)[1:]
    known = [key for key in _PARSERS if (*words,)[: len(key)] == key]
    if not known:
        raise LookupError(text)
    command = max(known, key=len)
    return command, words[len(command) :]


def parse(text: str) -> None:
    """Let the command's own parser read all of it. Raises: SystemExit: it does not."""
    command, words = split_command(text)
    if words and "--help" not in words:
        _PARSERS[command].parse_args(words)


@pytest.mark.parametrize("page", OF_TODAY, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_line_is_one_that_the_program_takes(
    page: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    commands = [*whole_commands_of(page)]
    if page.name == "coming-from-the-original.md":  # whose commands in the text are whole, too
        commands += _CODE.findall(text_of(page))
    wrong = []
    for command in commands:
        try:
            parse(command)
        except (SystemExit, LookupError):
            wrong.append(f"{command}: {capsys.readouterr().err.splitlines()[-1:]}")
    assert not wrong, "\n".join(wrong)


def test_every_command_for_a_real_robot_names_its_board_and_lets_a_person_arm_it() -> None:
    every = (line for page in OF_TODAY for line in whole_commands_of(page))
    real = [
        line for line in every if re.match("agribot run (hardware|.*--platform hardware)", line)
    ]
    assert real
    lacking = [
        line for line in real if "base=" not in line or not {"--ui", "--arm"} & {*line.split()}
    ]
    assert not lacking


@pytest.mark.parametrize("page", OF_TODAY, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_in_the_text_exists_with_its_options(page: Path) -> None:
    wrong = []
    for text in _CODE.findall(text_of(page)):
        if text.split()[1] in NOT_OURS:
            continue
        command, words = split_command(text)
        known = _PARSERS[command]._option_string_actions
        options = [word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)]
        wrong += [f"{text}: {option}" for option in options if option not in known]
    assert not wrong


def test_every_type_in_the_glossary_is_one_of_the_code() -> None:
    types = set(re.findall(r"`([A-Z]\w+)`", text_of(ROOT / "docs" / "glossary.md")))
    code = "".join(text_of(path) for path in (ROOT / "src").rglob("*.py"))
    assert types and not {
        name for name in types if not re.search(rf"^class {name}\b|^{name} = ", code, re.M)
    }


def test_the_citation_is_of_the_version_in_the_changelog() -> None:
    cited = re.search(r"^version: (.+)$", text_of(ROOT / "CITATION.cff"), re.MULTILINE)
    dated = re.search(r"^date-released: (.+)$", text_of(ROOT / "CITATION.cff"), re.MULTILINE)
    assert cited and dated
    assert f"## {cited[1]}, {dated[1]}" in text_of(ROOT / "CHANGELOG.md")


@pytest.mark.parametrize(
    ("file", "line"),
    [
        ("CITATION.cff", "version: {}"),
        ("web/package.json", '"version": "{}"'),
        ("web/package-lock.json", '"version": "{}"'),
        ("ros1/agribot_description/package.xml", "<version>{}</version>"),
        ("ros2/agribot_description/package.xml", "<version>{}</version>"),
        ("ros2/agribot_description/setup.py", 'version="{}"'),
    ],
)
def test_a_version_in_a_file_is_that_of_the_program(file: str, line: str) -> None:
    assert line.format(__version__) in text_of(ROOT / file)


KEEP_OFF_CM = 100.0 * find_most_keep_off_m(TreatmentConfig())
ESTIMATE, MISSION = EstimateConfig(), MissionConfig()


@pytest.mark.parametrize(
    ("page", "text"),
    [
        ("README.md", f"extended Kalman filter, {ekf.STATES} states"),
        ("docs/navigation.md", f"\n{ekf.STATES} states: position"),
        ("docs/results/missions.md", f"the {KEEP_OFF_CM:g} cm around the middle of its stem never"),
        ("docs/safety.md", f"keeps {KEEP_OFF_CM:g} cm off every stem of crop"),
        (
            "docs/safety.md",
            f"off stems of crop as the edge of the spray does: by {KEEP_OFF_CM:g} cm",
        ),
        ("docs/safety.md", f"`mission.stall_timeout_s` ({MISSION.stall_timeout_s:g} s) fails"),
        ("docs/ros.md", f"says nothing for {platform.SILENCE_S:g} s"),
        ("docs/navigation.md", f"| {platform.SILENCE_S:g} s | a source outside"),
        ("docs/navigation.md", f"| {verdicts.SILENT_S:g} s | `gnss` is `silent`"),
        ("docs/navigation.md", f"`estimate.gnss_timeout_s` ({ESTIMATE.gnss_timeout_s:g} s)"),
        ("docs/navigation.md", f"dead_reckoning_std_m` ({ESTIMATE.dead_reckoning_std_m:g} m)"),
    ],
)
def test_a_figure_in_the_text_is_that_of_the_code(page: str, text: str) -> None:
    assert text in text_of(ROOT / page)


def test_the_results_say_of_faults_what_the_campaign_measured() -> None:
    campaign = text_of(ROOT / "docs/results/fault-campaign.md")
    found = re.search(
        r"--no-camera`: Of (\d+) faults on 10 seeds the robot noticed (\d+) %.* "
        r"of the others it noticed (\d+) %",
        campaign,
    )
    assert found
    faults, of_all, of_harmful = found.groups()
    rows = csv.DictReader(text_of(ROOT / "docs/results/fault-campaign.csv").splitlines())
    drives = [row for row in rows if row["campaign"] == "drives without a fault"]
    assert len(drives) > 2
    crushed = sum(int(row["crushed"]) for row in drives)
    results = text_of(ROOT / "docs/results/missions.md")
    assert f"Without a camera, of {faults} faults on 10 seeds" in results
    assert f"noticed {of_all} % of all and {of_harmful} % of those that had an effect" in results
    assert f"in which {crushed} plants were crushed" in results


def test_the_results_have_the_iou_that_perception_measured_in_the_farm_world() -> None:
    (row,) = re.findall(r"^\| Farm world, all three pooled \|(.+)$", text_of(
        ROOT / "docs/results/perception.md"), re.MULTILINE)  # fmt: skip
    field, kind = (row.split("|")[k].strip().replace(", ", " and ") for k in (1, 3))
    said = f"weed and crop IoU {field} on the preset `field`, {kind} on `kind`"
    assert said in text_of(ROOT / "docs/results/missions.md")
