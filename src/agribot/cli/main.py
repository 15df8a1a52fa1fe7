"""The `agribot` program: one command line for everything.

Exit status: 0 done and good, 1 ran but the result is bad, 2 wrong use or bad input,
130 interrupted after a clean stop.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from agribot.core.version import __version__

if TYPE_CHECKING:
    from agribot.record.damage import Damage

# name -> (module, one line of help, an example)
COMMANDS = {
    "run": (
        "agribot.cli.run.run",
        "run the robot through a mission",
        "agribot run farm --sensors rtk --seed 1 --out runs/first",
    ),
    "sim": (
        "agribot.cli.run.sim",
        "simulate the world alone: sensors out, drive commands in, no autonomy",
        "agribot sim --world empty --drive=0.4,0.2 --for 20 --speed max",
    ),
    "report": (
        "agribot.cli.data.report",
        "make report.json, report.html and map.png from a recording",
        "agribot report runs/first/run.mcap -o runs/first-report",
    ),
    "replay": (
        "agribot.cli.run.replay",
        "run the stack again on a recording and compare every command",
        "agribot replay runs/first/run.mcap",
    ),
    "localize": (
        "agribot.cli.data.localize",
        "poses from a log of any robot, by the robot's own filter, and how good they are",
        "agribot localize drive.bag --out poses --json",
    ),
    "bag": (
        "agribot.cli.data.bag",
        "look into, convert and export recordings: ROS 1 .bag, ROS 2 .db3, .mcap",
        "agribot bag convert runs/first/run.mcap first.bag",
    ),
    "record": (
        "agribot.cli.data.record",
        "save a recording that was cut off; begin, end and mark those of a running robot",
        "agribot record recover runs/first/run.mcap",
    ),
    "ros2": (
        "agribot.cli.run.ros2",
        "run the robot as a ROS 2 node, without ROS installed",
        "agribot ros2 farm --allow-drive",
    ),
    "ros1": (
        "agribot.cli.run.ros1",
        "run the robot as a node of a ROS 1 master, without ROS installed",
        "agribot ros1 farm --ros-master http://127.0.0.1:11311",
    ),
    "foxglove": (
        "agribot.cli.run.foxglove",
        "run the robot and let Foxglove watch it",
        "agribot foxglove farm",
    ),
    "graph": (
        "agribot.cli.run.graph",
        "draw who publishes and who listens, in ROS 1, in ROS 2 or inside the robot",
        "agribot graph ros1 --out nodes.svg",
    ),
    "view": (
        "agribot.cli.run.view",
        "show a recording in Rerun, RViz, QGIS or Foxglove",
        "agribot view qgis runs/first",
    ),
    "node": (
        "agribot.cli.run.node",
        "one stage alone over topics: gps-converter, data-manipulation, autonomous-drive ...",
        "agribot node gps-converter --ros1",
    ),
    "describe": (
        "agribot.cli.fields.describe",
        "check, convert and show the robot description",
        "agribot describe --tree",
    ),
    "world": (
        "agribot.cli.fields.world",
        "list, check, generate and render worlds",
        "agribot world render Farm -o farm.png",
    ),
    "plan": (
        "agribot.cli.fields.plan",
        "plan how to work a whole field, and certify it",
        "agribot plan --field field.geojson --implement-width 0.75 --out plan.geojson",
    ),
    "calibrate": (
        "agribot.cli.tools.calibrate",
        "measure what the robot's description says: wheel radius and effective separation",
        "agribot calibrate drive --sensors rtk --json",
    ),
    "board": (
        "agribot.cli.tools.board",
        "show which board is at a line, and write its program into it",
        "agribot board show serial:/dev/ttyACM0",
    ),
    "gnss": (
        "agribot.cli.tools.gnss",
        "show what a receiver reports, and set up a u-blox receiver for driving",
        "agribot gnss show serial:/dev/ttyACM0",
    ),
    "plugins": (
        "agribot.cli.tools.plugins",
        "list what installed packages add to the program, and why what cannot be used",
        "agribot plugins",
    ),
    "doctor": (
        "agribot.cli.doctor.doctor",
        "say what is installed, which devices answer and what to do about what is missing",
        "agribot doctor",
    ),
    "ui": (
        "agribot.cli.run.ui",
        "show the operator's page on a simulated robot or on a recording",
        "agribot ui runs/first/run.mcap",
    ),
    "teleop": (
        "agribot.cli.run.teleop",
        "drive a running robot with keys, mouse or gamepad, without a page",
        "agribot teleop keyboard --scale 0.5",
    ),
    "map": (
        "agribot.cli.fields.map",
        "keep background maps for the page on this machine",
        "agribot map import farm.mbtiles",
    ),
    "weeds": (
        "agribot.cli.data.weeds",
        "weed maps in the files of farm software: export, import, merge",
        "agribot weeds export runs/first -o weeds.gpkg",
    ),
    "sweep": (
        "agribot.cli.tools.sweep",
        "run many seeds and settings and compare their reports",
        "agribot sweep farm --seeds 1-8 --vary mission.speed_mps=0.4,0.6 --out runs/speeds",
    ),
    "bench": (
        "agribot.cli.tools.bench",
        "measure what the parts of the robot can do",
        "agribot bench nav --sensors m8n --seeds 1-100 --json",
    ),
    "dataset": (
        "agribot.cli.data.dataset",
        "draw, import, check and split labelled images",
        "agribot dataset generate --images 1000 --seed 1 --out fields",
    ),
    "label": (
        "agribot.cli.data.label",
        "label photographs on a page: the network guesses, you correct",
        "agribot label photos --open",
    ),
    "train": (
        "agribot.cli.data.train",
        "train the crop/weed network on simulated images or your own photographs",
        "agribot train --images 1200 --minutes 20 --seed 0 --out training",
    ),
    "adapt": (
        "agribot.cli.data.adapt",
        "adapt a crop/weed network to a field by its rows, without labels",
        "agribot adapt photos -o field.onnx --json",
    ),
    "eval": (
        "agribot.cli.data.evaluate",
        "judge a crop/weed network on labelled pictures",
        "agribot eval photos --model agribot-sim --out judged --json",
    ),
    "predict": (
        "agribot.cli.data.predict",
        "masks, overlays and plant tables of pictures and videos",
        "agribot predict photos -o seen --model agribot-sim",
    ),
    "live": (
        "agribot.cli.data.live",
        "watch a camera, a video or the simulator through the network",
        "agribot live sim --seconds 10 --out live",
    ),
    "export": (
        "agribot.cli.data.export",
        "a network at another input size or precision, with the cost in accuracy",
        "agribot export agribot-sim --precision int8 --calibrate photos -o small.onnx",
    ),
    "models": (
        "agribot.cli.data.models",
        "the networks that come with the program and their cards",
        "agribot models agribot-sim",
    ),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; what ends it early is printed in one line, with status 2."""
    # Read when numpy is imported. Its threads wait in a loop and cost more CPU time than they save.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    arguments = list(sys.argv[1:] if argv is None else argv)
    wanted = next((word for word in arguments if not word.startswith("-")), "")
    program = f"agribot {wanted}" if wanted in COMMANDS else "agribot"
    try:
        return _run_and_print(arguments, wanted)
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return 130
    except Exception as error:  # noqa: BLE001  the one place where errors become words
        from agribot.cli.refusals import refuse

        return refuse(program, error)


def _run_and_print(arguments: list[str], wanted: str) -> int:
    """Flush all output at the end, so that a reader who has gone is noticed here."""
    try:
        status = _run(arguments, wanted)
    except SystemExit:  # the parser's, after its help
        print(end="", flush=True)
        raise
    print(end="", flush=True)
    return status


def _run(arguments: list[str], wanted: str) -> int:
    parser = argparse.ArgumentParser(
        prog="agribot",
        description="An autonomous field robot that weeds.",
        epilog="example: agribot run farm",
    )
    parser.add_argument("--version", action="version", version=f"agribot {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    known = COMMANDS if wanted in COMMANDS else COMMANDS | _list_installed(wanted)
    for name, (module_name, help_line, example) in known.items():
        command = commands.add_parser(
            name,
            help=help_line,
            description=help_line[0].upper() + help_line[1:] + ".",
            epilog=f"example: {example}",
        )
        if name == wanted:  # only the wanted command is imported: --help stays quick
            importlib.import_module(module_name).add_arguments(command)
    options = parser.parse_args(arguments)
    return _note_damage(
        lambda: int(importlib.import_module(known[options.command][0]).run(options))
    )


def _list_installed(wanted: str) -> dict[str, tuple[str, str, str]]:
    """List the commands of installed packages; one that cannot be imported only where wanted.

    Raises: ConfigError: the wanted one cannot be imported.
    """
    from agribot.core import plugins
    from agribot.core.errors import ConfigError

    found = {}
    for name in plugins.list_names(plugins.COMMANDS):
        try:
            module = plugins.find_plugin(plugins.COMMANDS, name)
        except ConfigError:
            if name == wanted:
                raise
            continue
        if module is not None:
            found[name] = (module.__name__, module.HELP, module.EXAMPLE)
    return found


def _note_damage(run: Callable[[], int]) -> int:
    """Run a command and name what is damaged in its recordings; 1 where it lacked some of them."""
    from agribot.record.damage import collect_damage

    def note(damage: Damage) -> None:
        sys.stderr.write(f"note: {damage.describe()}\n")

    with collect_damage(note) as found:
        status = run()
    return status or int(any(damage.is_gap for damage in found))
