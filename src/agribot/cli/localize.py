"""`agribot localize`: where a robot was, from a log of it, by the filter that drives ours."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("logs", type=Path, nargs="+", metavar="LOG", help="bag or recording")
    for sensor in ("odom", "imu", "gnss", "mag"):
        parser.add_argument(f"--{sensor}", metavar="TOPIC|FILE", help="default: chosen by its type")
    parser.add_argument(
        "--outage", action="append", default=[], metavar="A-B",
        help="withhold the fixes from A to B, seconds from the first message; repeatable",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, metavar="DIR")
    parser.add_argument("--json", action="store_true", help="print the result as the last line")


def run(options: argparse.Namespace) -> int:
    from agribot.app.localization.bag_log import BagLog
    from agribot.app.localization.batches import make_batches
    from agribot.app.localization.localize import LogPass, localize
    from agribot.app.localization.log_robot import allow_speeds, set_antenna
    from agribot.app.localization.log_scan import scan_log
    from agribot.app.localization.time_order import order_by_stamp
    from agribot.core.config import RunConfig
    from agribot.core.geo import Datum
    from agribot.description.loader import load_robot

    named = {s: getattr(options, s) for s in ("odom", "imu", "gnss", "mag") if getattr(options, s)}
    log = BagLog(options.logs[0], named)
    robot = set_antenna(load_robot(), (0.0, 0.0, 0.0))
    scan = scan_log(log, robot.drive)
    robot = msgspec.structs.replace(
        robot, drive=allow_speeds(robot.drive, scan.most_mps, scan.most_radps)
    )
    mount, fix = scan.mount.solve(), scan.first_fix
    assert mount is not None and fix is not None
    sys.stderr.write(f"IMU: {mount.axes} ({mount.how})\n")
    config = RunConfig(profile="log")
    datum = Datum(lat_deg=fix.lat_deg, lon_deg=fix.lon_deg, alt_m=fix.alt_m)
    field = msgspec.structs.replace(config.field, datum=datum)
    config = msgspec.structs.replace(config, field=field)
    outages = [tuple(map(float, text.split("-"))) for text in options.outage]
    first = LogPass(config, robot, outages)
    batches = make_batches(order_by_stamp(log.entries()), scan.start_s, mount, robot.drive)
    localize(batches, [first])
    done = first.finish(scan.sensors["gnss"].samples)
    sys.stderr.write(f"rejected: {done.rejected}\n")
    sys.stdout.write(msgspec.json.encode(done.result).decode() + "\n")
    return 0 if done.result.started_after_s is not None else 1
