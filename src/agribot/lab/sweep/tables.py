"""The results of a sweep on disk: one file for each finished run, and tables over all of them."""

from __future__ import annotations

import csv
import io
import math
import statistics
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from agribot.core.errors import MAKE_ROOM, OTHER_OUT, ConfigError, RecordingError, explain_os_error
from agribot.core.version import __version__
from agribot.core.whole_file import write_at_once
from agribot.lab.sweep.execution import RunOutcome
from agribot.lab.sweep.plan import SweepJob
from agribot.record.report import Report

# Lists that a table of numbers shows by their length.
COUNTED = ("safety.stops", "safety.noticed", "safety.faults", "safety.gate", "safety.checks",
           "safety.crushes", "safety.interventions", "safety.visits")  # fmt: skip
Value = str | int | float | bool | None


class _SweepPlan(msgspec.Struct, frozen=True, kw_only=True):
    """Content of `sweep.json`."""

    version: str
    jobs: tuple[SweepJob, ...]


class SweepFolder:
    """`sweep.json` lists the runs that belong to it, `results/` holds those that are finished."""

    def __init__(self, path: Path, jobs: Sequence[SweepJob]) -> None:
        """Open a sweep's folder, or make it; one with more runs takes the place of one with fewer.

        `jobs` has the names that the folder has for the same runs.

        Raises: ConfigError: the folder holds another sweep. RecordingError: no such folder.
        """
        self.path = path
        about = path / "sweep.json"
        with explain_os_error(f"cannot write into {path}", OTHER_OUT):
            (path / "results").mkdir(parents=True, exist_ok=True)
            found = about.read_bytes() if about.is_file() else None
            known = () if found is None else _read_jobs(about, found)
            self.jobs = _name_as_known(jobs, known)
            if not set(self.jobs) <= set(known):
                is_longer = set(known) <= set(self.jobs)
                if not is_longer or len({job.name for job in self.jobs}) < len(self.jobs):
                    raise _make_other_sweep_error(path)
                write_at_once(about, _encode_json(_SweepPlan(version=__version__, jobs=self.jobs)))

    def run_dir(self, job: SweepJob) -> Path:
        return self.path / "runs" / job.name

    def read_finished(self) -> dict[str, Report]:
        """Read the reports of the runs that need not run again, by name."""
        found = {}
        for job in self.jobs:
            path = self._result(job)
            if path.is_file():
                found[job.name] = _read(path)
        return found

    def keep(self, job: SweepJob, report: Report) -> None:
        with explain_os_error(f"cannot write into {self.path}", MAKE_ROOM):
            write_at_once(self._result(job), msgspec.json.encode(report) + b"\n")

    def write_tables(self, errors: Sequence[RunOutcome]) -> dict[str, Any]:
        """Write runs.csv, summary.csv, summary.md and sweep-report.json; return the latter."""
        reports = self.read_finished()
        rows = [_make_row(job, reports[job.name]) for job in self.jobs if job.name in reports]
        failed = {outcome.job.name: outcome.error for outcome in errors}
        summary = summarise(self.jobs, reports)
        result = {
            "runs_total": len(self.jobs),
            "runs_done": len(rows),
            "runs_ok": sum(report.ok for report in reports.values()),
            "errors": failed,
            "summary": summary,
        }
        with explain_os_error(f"cannot write into {self.path}", MAKE_ROOM):
            write_at_once(self.path / "runs.csv", _encode_csv(rows))
            write_at_once(self.path / "summary.csv", _encode_csv(_flat_summary(summary)))
            report_json = msgspec.json.format(_encode_json({**result, "runs": rows}), indent=1)
            write_at_once(self.path / "sweep-report.json", report_json)
            write_at_once(self.path / "summary.md", format_markdown(summary).encode())
        return result

    def _result(self, job: SweepJob) -> Path:
        return self.path / "results" / f"{job.name}.json"


def _read_jobs(about: Path, content: bytes) -> tuple[SweepJob, ...]:
    try:
        known = msgspec.json.decode(content, type=_SweepPlan)
    except msgspec.MsgspecError:
        raise _make_other_sweep_error(about.parent) from None
    if known.version != __version__:
        raise _make_other_sweep_error(about.parent)
    return known.jobs


def _name_as_known(jobs: Sequence[SweepJob], known: Sequence[SweepJob]) -> tuple[SweepJob, ...]:
    """Give jobs the names of the same ones among `known`: a longer list numbers them otherwise."""
    names = {_name_nothing(job): job.name for job in known}
    return tuple(
        msgspec.structs.replace(job, name=names.get(_name_nothing(job), job.name)) for job in jobs
    )


def _name_nothing(job: SweepJob) -> SweepJob:
    return msgspec.structs.replace(job, name="")


def _make_other_sweep_error(path: Path) -> ConfigError:
    return ConfigError(
        f"{path} holds another sweep (its sweep.json differs); give the same options again, with "
        "more seeds or values if wanted, or another --out folder"
    )


def summarise(jobs: Sequence[SweepJob], reports: dict[str, Report]) -> list[dict[str, Any]]:
    """Compute mean, standard deviation and largest value over the seeds of each combination.

    A key that is null in some runs is averaged over the `count` others; true
    counts as 1. The standard deviation of a single value is null.
    """
    summary = []
    for profile, settings in dict.fromkeys((job.profile, job.settings) for job in jobs):
        every = [job for job in jobs if (job.profile, job.settings) == (profile, settings)]
        of_these = [job for job in every if job.name in reports]
        flat = [flatten(reports[job.name]) for job in of_these]
        columns: dict[str, list[float]] = {}
        for values in flat:
            for key, value in values.items():
                if isinstance(value, bool | int | float) and key != "seed":
                    columns.setdefault(key, []).append(float(value))
        summary.append({
            "profile": profile,
            "settings": dict(_split(setting) for setting in settings),
            "seeds": len(every),
            "runs": len(of_these),
            "mean": {key: statistics.fmean(values) for key, values in columns.items()},
            "std": {
                key: statistics.stdev(values) if len(values) > 1 else None
                for key, values in columns.items()
            },
            "max": {key: max(values) for key, values in columns.items()},
            "count": {key: len(values) for key, values in columns.items()},
        })  # fmt: skip
    return summary


def format_markdown(summary: Iterable[dict[str, Any]]) -> str:
    """Format one line for each combination; "-" where nothing was measured.

    RMS is over all missions together, p95 their mean, max the worst instant of all, as is the
    farthest that any place of the robot got out of the field. Weeds treated in the rows and between
    them, ways and interventions are summed.
    """
    heads = ("profile", "settings", "good", "rows", "XTE RMS", "p95", "max", "crushed", "in row",
             "between rows", "h/ha", "outside", "way", "interventions", "way for each")  # fmt: skip
    lines = [f"| {' | '.join(heads)} |", "| --- " * len(heads) + "|"]
    for entry in summary:
        runs, mean = entry["runs"], entry["mean"]
        done, total = (
            round(runs * mean.get(key, 0.0)) for key in ("mission.rows_done", "mission.rows_total")
        )
        cells = (
            entry["profile"],
            " ".join(f"{key}={value}" for key, value in entry["settings"].items()) or "-",
            f"{round(runs * mean.get('ok', 0.0))} of {entry['seeds']}",
            f"{done} of {total}",
            _format_value(pooled_rms_m(entry), 100.0, " cm"),
            _format_value(mean.get("tracking.xte_p95_m"), 100.0, " cm"),
            _format_value(entry["max"].get("tracking.xte_max_m"), 100.0, " cm"),
            f"{round(runs * mean.get('tracking.plants_crushed', 0.0))}",
            _format_treated(entry, "in_row"),
            _format_treated(entry, "between_rows"),
            _format_value(mean.get("mission.h_per_ha"), 1.0, ""),
            _format_value(entry["max"].get("safety.outside_m_max"), 100.0, " cm"),
            *_format_way(entry),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _format_treated(entry: dict[str, Any], part: str) -> str:
    """Format how many weeds of a part of the field were treated in all runs; "-" without any."""
    treated, of = (
        round(entry["mean"].get(key, 0.0) * entry["count"].get(key, 0))
        for key in (f"weeds.{part}.treated", f"weeds.{part}.of")
    )
    return f"{treated} of {of}" if of else "-"


def _format_way(entry: dict[str, Any]) -> tuple[str, str, str]:
    """Format the way of all runs, how often they needed a person, and the way for each time."""
    sums = {key: entry["mean"].get(key, 0.0) * entry["count"].get(key, 0)
            for key in ("mission.distance_m", "safety.interventions")}  # fmt: skip
    km, count = sums["mission.distance_m"] / 1000.0, round(sums["safety.interventions"])
    return f"{km:.2f} km", str(count), f"{km / count:.2f} km" if count else "-"


def pooled_rms_m(entry: dict[str, Any]) -> float | None:
    """Compute the cross-track RMS over all missions of a combination; None where none has one."""
    mean_m, std_m = (entry[what].get("tracking.xte_rms_m") for what in ("mean", "std"))
    if mean_m is None:
        return None
    count = entry["count"]["tracking.xte_rms_m"]
    return math.sqrt(mean_m**2 + (std_m or 0.0) ** 2 * (count - 1) / count)


def _format_value(value: float | None, scale: float, unit: str) -> str:
    return "-" if value is None else f"{scale * value:.1f}{unit}"


def flatten(report: Report) -> dict[str, Value]:
    """Put the groups in front of the keys of report.json, such as `tracking.xte_rms_m`."""
    flat: dict[str, Value] = {}

    def visit(tree: dict[str, Any], at: str) -> None:
        for key, value in tree.items():
            name = f"{at}{key}"
            if isinstance(value, dict):
                visit(value, f"{name}.")
            else:
                flat[name] = len(value) if name in COUNTED else value

    visit(msgspec.to_builtins(report), "")
    return flat


def _make_row(job: SweepJob, report: Report) -> dict[str, Value]:
    return {"run": job.name, **dict(_split(s) for s in job.settings), **flatten(report)}


def _flat_summary(summary: Iterable[dict[str, Any]]) -> list[dict[str, Value]]:
    rows = []
    for entry in summary:
        row: dict[str, Value] = {
            "profile": entry["profile"], **entry["settings"], "runs": entry["runs"],
        }  # fmt: skip
        for key in entry["mean"]:
            row |= {f"{key} {what}": entry[what][key] for what in ("mean", "std", "max", "count")}
        rows.append(row)
    return rows


def _split(setting: str) -> tuple[str, str]:
    key, _, value = setting.partition("=")
    return key, value


def _encode_csv(rows: Sequence[dict[str, Value]]) -> bytes:
    columns = dict.fromkeys(key for row in rows for key in row)
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(columns), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def _read(path: Path) -> Report:
    try:
        return msgspec.json.decode(path.read_bytes(), type=Report)
    except msgspec.MsgspecError as error:
        raise RecordingError(
            f"{path} is no report of this version ({error}); delete it to run it again"
        ) from error


def _encode_json(value: object) -> bytes:
    return msgspec.json.encode(value)
