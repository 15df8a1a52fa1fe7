"""Cells of the matrix: which fault, in which state, by which course, on which seed."""

from __future__ import annotations

import re
from collections.abc import Sequence

import msgspec

from agribot.core.errors import ConfigError
from agribot.lab.bench.fault_matrix.covering import cover_pairs, list_all
from agribot.lab.bench.fault_matrix.states import STATE_OF, STATES
from agribot.sim.faults.schedule import parse_fault
from agribot.sim.faults.table import FaultKind

PROFILE, PRESET, SENSORS = "rows-10x12", "field", "rtk"
DRIVEN_ROWS, SOWN_ROWS, ROW_M = 2, 6, 8.0
LONGEST_S = 300.0  # longest time in simulation of a drive
ONCE_S = 2.0  # length of a fault that happens once
BURSTS, BURST_S, EVERY_S = 5, 0.4, 4.0  # count, length and distance of bursts that come and go
RISE_S = 60.0  # time in which a growing fault rises
ALSO_AFTER_S = 4.0  # time from the first of two faults to the second
ONCE, FOR_GOOD, COMES_AND_GOES, GROWS = "once", "for good", "comes and goes", "grows"
COURSES = (ONCE, FOR_GOOD, COMES_AND_GOES, GROWS)
# One of each kind that a robot without a camera can have.
FAULTS = (
    "gnss.outage", "gnss.jump=0.5", "gnss.wrong_fix=0.4", "gnss.drift=0.05", "gnss.frozen",
    "gnss.scatter=10", "gnss.velocity=30", "mag.motor", "mag.offset=30", "imu.bias=0.05",
    "imu.frozen", "imu.late=0.25", "imu.unplugged", "wheels.stuck=right_wheel_R",
    "wheels.reversed", "motor.dead=left_wheel_F", "motor.weak=0.02", "motor.runaway",
    "soil.mud=0.05", "bumper.contact", "button.pressed", "inputs.silent", "contactor.silent",
    "contactor.welded", "obstacle.unmapped", "battery.empty", "clock.step=2", "link.noise=0.2",
    "board.silent", "board.hung", "program.stalled=3", "disk.full", "start.aside=1",
    "start.turned=30", "robot.tipped=40", "carried=0.5", "crop.gap=5",
)  # fmt: skip
# Pairs: what may stay unnoticed by itself, and what happens while it lasts.
HIDDEN = (
    "gnss.scatter=3", "gnss.drift=0.01", "gnss.velocity=5", "imu.bias=0.01", "mag.offset=5",
    "mag.motor", "motor.weak=0.05", "link.noise=0.01", "contactor.welded",
)  # fmt: skip
SECOND = (
    "gnss.outage", "gnss.wrong_fix=0.4", "gnss.frozen", "imu.bias=0.05", "imu.unplugged",
    "wheels.stuck=right_wheel_R", "motor.dead=left_wheel_F", "motor.runaway", "board.silent",
    "carried=0.5",
)  # fmt: skip
# Time from the begin until the sensors on board hold evidence of a fault, s; infinite where none
# of them ever does. Others: 3 s.
DETECTABLE_S = {
    "gnss.drift=0.05": 10.0, "gnss.drift=0.01": float("inf"), "motor.weak=0.05": float("inf"),
    "battery.empty": 5.0, "obstacle.unmapped": 5.0,
}  # fmt: skip
DETECTABLE_IN_S = 3.0


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """A drive in which `fault` begins in `state`; a reference has no fault, but a script."""

    seed: int
    script: str
    fault: str = ""
    state: str = ""
    course: str = ""
    also: str = ""  # a second fault, for good, after `ALSO_AFTER_S`

    @property
    def reference(self) -> Cell:
        """The same drive without a fault."""
        return Cell(seed=self.seed, script=self.script)

    @property
    def name(self) -> str:
        """Name of its file; every cell has another."""
        words = filter(None, (self.fault, self.also, self.state or self.script, self.course))
        return re.sub(r"[^A-Za-z0-9.=+-]+", "_", "-".join((*words, f"seed{self.seed}")))

    @property
    def detectable_in_s(self) -> float:
        """Time from its begin until the sensors on board hold evidence of it."""
        if self.course == GROWS:
            return float("inf")
        found_s = [DETECTABLE_S.get(self.fault, DETECTABLE_IN_S)]
        if self.also:
            found_s.append(ALSO_AFTER_S + DETECTABLE_S.get(self.also, DETECTABLE_IN_S))
        return min(found_s)

    def list_faults(self, onset_s: float) -> tuple[str, ...]:
        """Write its faults as the settings of a run have them."""
        if not self.fault:
            return ()
        also = (f"{self.also}@{_format(onset_s + ALSO_AFTER_S)}",) if self.also else ()
        begin = f"{self.fault}@{_format(onset_s)}"
        if self.course == GROWS:
            return (f"{begin}~{RISE_S:g}", *also)
        if self.course == COMES_AND_GOES:
            begins_s = [onset_s + number * EVERY_S for number in range(BURSTS)]
            return (*(f"{self.fault}@{_format(t_s)}+{BURST_S:g}" for t_s in begins_s), *also)
        lasts = f"+{ONCE_S:g}" if self.course == ONCE and not _find(self.fault).is_momentary else ""
        return (f"{begin}{lasts}", *also)

    def list_settings(self, onset_s: float) -> tuple[str, ...]:
        """List the settings of its drive."""
        faults = ", ".join(f'"{fault}"' for fault in self.list_faults(onset_s))
        kinds = [_find(fault) for fault in filter(None, (self.fault, self.also))]
        is_recorded = any(kind.part == "disk" for kind in kinds)
        return (
            f"seed={self.seed}",
            f"sim.preset={PRESET}",
            f"sim.sensors={SENSORS}",
            "perception.enabled=false",
            f"record.enabled={str(is_recorded).lower()}",
            f"field.row_count={DRIVEN_ROWS}",
            f"field.row_length_m={ROW_M:g}",
            f"duration_s={LONGEST_S:g}",
            f"faults=[{faults}]",
            *(('safety.must_report=["red button"]',) if "inputs.silent" in self.fault else ()),
        )


def list_singles(faults: Sequence[str], seeds: Sequence[int], *, is_all: bool) -> tuple[Cell, ...]:
    """List the cells of single faults: a covering array over fault, state, course and seed."""
    factors = (faults, [state.name for state in STATES], COURSES, [str(seed) for seed in seeds])
    rows = list_all(factors, _is_possible) if is_all else cover_pairs(factors, _is_possible)
    return tuple(
        _make_cell(fault, state, int(seed), course=course) for fault, state, course, seed in rows
    )


def list_pairs(seeds: Sequence[int], *, is_all: bool) -> tuple[Cell, ...]:
    """List the cells of two faults: a covering array over both, the state and the seed.

    `is_all` takes every fault as the first of two.
    """
    firsts = (*HIDDEN, *FAULTS) if is_all else HIDDEN
    factors = (firsts, SECOND, [state.name for state in STATES], [str(seed) for seed in seeds])
    return tuple(
        _make_cell(fault, state, int(seed), course=FOR_GOOD, also=also)
        for fault, also, state, seed in cover_pairs(factors, _can_be_two)
    )


def choose_faults(names: Sequence[str]) -> tuple[str, ...]:
    """Choose the faults of these names.

    Raises: ConfigError: no cell has one of them.
    """
    chosen = tuple(fault for fault in FAULTS if _find(fault).name in names)
    if not chosen:
        raise ConfigError(
            f"no cell of the matrix has one of these faults: {', '.join(names)}; try --in-row"
        )
    return chosen


def list_references(cells: Sequence[Cell]) -> tuple[Cell, ...]:
    """List the drives without a fault that cells are compared with."""
    return tuple(dict.fromkeys(cell.reference for cell in cells))


def _make_cell(fault: str, state: str, seed: int, *, course: str, also: str = "") -> Cell:
    script = STATE_OF[state].script
    return Cell(seed=seed, script=script, fault=fault, state=state, course=course, also=also)


def _is_possible(row: tuple[str, ...]) -> bool:
    fault, state, course, _ = row
    kind = _find(fault)
    if kind.at_start:
        return STATE_OF[state].is_reached is None and course == FOR_GOOD
    if kind.is_momentary:
        return course == FOR_GOOD
    return course != GROWS or kind.can_rise


def _can_be_two(row: tuple[str, ...]) -> bool:
    first, second, state, _ = row
    kinds = _find(first), _find(second)
    is_late = any(kind.at_start for kind in kinds) and STATE_OF[state].is_reached is not None
    return kinds[0].name != kinds[1].name and not is_late


def _find(fault: str) -> FaultKind:
    return parse_fault(f"{fault}@0").kind


def _format(t_s: float) -> str:
    return f"{t_s:.3f}".rstrip("0").rstrip(".")
