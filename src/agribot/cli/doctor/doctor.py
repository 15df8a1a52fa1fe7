"""`agribot doctor`: what this machine is, which devices it has, and whether a robot would start."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from agribot.cli.standard_error import print_line
from agribot.core.version import __version__

if TYPE_CHECKING:
    from agribot.cli.doctor.doctor_findings import CheckResult
    from agribot.cli.doctor.doctor_probe import DeviceProbe

LOADING = "loading every package; this takes some seconds ..."
DRIVING = "driving for one second on the farm; the first time on a machine takes half a minute ..."

Check = Callable[[], Iterator["CheckResult"]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print the findings as the last line")
    parser.add_argument(
        "--full",
        action="store_true",
        help="load every package, and drive on the simulated farm for a second",
    )
    parser.add_argument(
        "--probe",
        action="store_true",
        help="open each serial line and camera not in use, and say what answers; this resets "
        "Arduinos",
    )
    parser.add_argument(
        "--udev",
        action="store_true",
        help="with --probe: print rules that name the boards by what they said they are",
    )
    parser.add_argument(
        "--ask",
        action="append",
        default=[],
        metavar="NODE",
        help="with --probe: a line such as /dev/ttyAMA0 to be asked though it is silent, for a "
        "VESC or an ODrive; never one with an Arduino",
    )
    parser.add_argument(
        "--original",
        action="store_true",
        help="only prove the parts of the original AGRIBOT that a command shows within seconds "
        "(docs/original.md)",
    )


def run(options: argparse.Namespace) -> int:
    """Check the machine.

    Raises: ConfigError: options that belong together, or a missing extra.
    """
    if options.original:
        return _prove_original(as_json=options.json)
    print_line(f"agribot {__version__}, looking at this machine ...")
    _check_options(options)
    from agribot.cli.doctor import doctor_machine
    from agribot.cli.doctor.doctor_findings import format_line

    machine = doctor_machine.describe_machine()
    print_line(_format_machine(machine))
    findings: list[CheckResult] = []
    for check in _list_checks(is_full=options.full):
        for finding in check():
            findings.append(finding)
            print_line(format_line(finding))
    if options.full:
        print_line(DRIVING)
        findings.append(_drive_farm(findings))
        print_line(format_line(findings[-1]))
    probe = _probe(options, findings) if options.probe else None
    ok = all(finding.state != "bad" for finding in findings)
    print_line("OK" if ok else "NOT OK: fix what is called bad above")
    if options.json:
        _print_json(ok, machine, findings, probe)
    elif options.udev and probe is not None:
        _print_rules(probe)
    return 0 if ok else 1


def _prove_original(*, as_json: bool) -> int:
    """Run the quick proofs of docs/original.md; 1 where one fails."""
    from agribot.lab.original import load_table, prove

    table = load_table()
    proofs = [proof for proof in table.proofs if proof.is_quick]
    print_line(
        f"{len(proofs)} of the original's {len(table.proofs)} parts, one command or two each"
    )
    results = []
    for proof, outcome in zip(proofs, prove(proofs, given=table.files), strict=True):
        reason = f": {outcome.reason}" if outcome.reason else ""
        print_line(f"{outcome.state:7} {proof.id:4} {proof.part}{reason}")
        commands = {"part": proof.part, "commands": proof.commands}
        results.append(
            {"id": proof.id, **commands, "result": outcome.state, "reason": outcome.reason}
        )
    ok = all(result["result"] == "pass" for result in results)
    print_line("OK" if ok else "NOT OK: run the commands of a failed row by hand")
    if as_json:
        sys.stdout.write(json.dumps({"ok": ok, "rows": results}) + "\n")
    return 0 if ok else 1


def _check_options(options: argparse.Namespace) -> None:
    """Refuse what --probe alone can do.

    Raises: ConfigError: it is not there.
    """
    from agribot.core.errors import ConfigError

    for name in ("udev", "ask"):
        if getattr(options, name) and not options.probe:
            raise ConfigError(f"--{name} says what to do with what --probe finds; add --probe")


def _probe(options: argparse.Namespace, findings: list[CheckResult]) -> DeviceProbe:
    """Open the devices, add to the findings what they are, and say what to run."""
    from agribot.cli.doctor.doctor_findings import format_line
    from agribot.cli.doctor.doctor_probe import DeviceProbe
    from agribot.cli.tools.calibration_motors import list_unstated
    from agribot.drivers.probe.gpsd_probe import ask_gpsd

    probe = DeviceProbe(gpsd=ask_gpsd(), ask=options.ask)
    for check in (probe.check_lines, probe.check_cameras):
        for finding in check():
            findings.append(finding)
            print_line(format_line(finding))
    command, lacks = probe.write_command()
    if lacks:
        print_line(f"a robot needs {lacks}, which did not answer")
    if command:
        print_line(command)
    if probe.has_own_board and (lacking := list_unstated()):
        print_line(
            f"that robot's {' and '.join(lacking)} are not stated, and it is refused; measure "
            "them and keep them: agribot calibrate motors (docs/first-drive.md, step 3)"
        )
    return probe


def _print_rules(probe: DeviceProbe) -> None:
    from agribot.drivers.probe.udev_names import RULES_FILE

    rules = probe.write_rules()
    sys.stdout.write("".join(f"{rule}\n" for rule in rules))
    if any(not rule.startswith("#") for rule in rules):
        print_line(
            f"put these lines into {RULES_FILE}, then: sudo udevadm control --reload && "
            "sudo udevadm trigger --subsystem-match=tty"
        )


def _list_checks(*, is_full: bool) -> Iterator[Check]:
    """List the checks, the quick ones first; each module is imported when its turn comes."""
    from agribot.cli.doctor import doctor_machine as computer

    yield computer.check_python
    yield computer.check_board
    yield computer.check_disk
    yield computer.check_clock
    yield computer.check_heat
    yield computer.check_declination
    from agribot.cli.doctor import doctor_devices as devices

    yield devices.check_devices
    yield devices.check_gpsd
    from agribot.cli.doctor import doctor_runs as runs

    yield runs.check_dropouts
    from agribot.cli.doctor import doctor_packages as packages

    if is_full:
        print_line(LOADING)
    yield lambda: packages.check_packages(loads=is_full)
    yield packages.check_caches
    yield packages.check_weights


def _drive_farm(findings: list[CheckResult]) -> CheckResult:
    from agribot.cli.doctor import doctor_packages

    return doctor_packages.drive_farm(findings)


def _print_json(
    ok: bool, machine: dict[str, Any], findings: list[CheckResult], probe: DeviceProbe | None
) -> None:
    import msgspec

    result = {
        "ok": ok,
        "version": __version__,
        "machine": machine,
        "findings": msgspec.to_builtins(findings),
    }
    if probe is not None:
        command, lacks = probe.write_command()
        result["probe"] = {
            "devices": msgspec.to_builtins(probe.found),
            "command": command,
            "lacks": lacks,
            "udev_rules": probe.write_rules(),
        }
    sys.stdout.write(json.dumps(result) + "\n")


def _format_machine(machine: dict[str, Any]) -> str:
    memory = "?" if machine["memory_gib"] is None else machine["memory_gib"]
    name = machine["cpu"] or machine["board"] or "unknown CPU"
    return (
        f"{machine['system']}\n{name}, {machine['architecture']}, "
        f"{machine['cpus_usable']} usable CPUs, {memory} GiB"
    )
