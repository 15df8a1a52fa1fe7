"""The faults of one run: a layer between the true sensors and the batch, and hands in the physics.

Each fault draws from a random stream of the seed and its name, so that the same seed gives the
same run, and one fault more does not change the others.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from agribot.core.config import RunConfig
from agribot.core.messages import STOP, SensorBatch
from agribot.core.plugins import FAULTS, bind_settings, find_plugin
from agribot.core.robot import RobotSpec
from agribot.core.world import Obstacle, WorldSpec
from agribot.sim.faults.boards import (
    HungBoard,
    PressedButton,
    SilentContactor,
    SilentInputs,
    UnpluggedImu,
)
from agribot.sim.faults.bodies import BodyFaults
from agribot.sim.faults.links import NoisyLink, SilentBoard, SteppedClock
from agribot.sim.faults.motions import (
    EmptyBattery,
    FrozenImu,
    GyroBias,
    Late,
    Magnet,
    Miscount,
    MotorField,
    Touch,
)
from agribot.sim.faults.pictures import BadPicture, find_mount_shift_m
from agribot.sim.faults.positions import (
    FrozenReceiver,
    NoisyPosition,
    NoisyVelocity,
    Offset,
    Outage,
)
from agribot.sim.faults.schedule import Fault
from agribot.sim.faults.table import BUILT_IN
from agribot.sim.physics import Physics
from agribot.sim.random_streams import make_stream

# Last: what stands on the line gets noise, and then the computer's stamps.
LAST = ("link.noise", "clock.step")


class BatchFault(Protocol):
    """Fault between the true samples of a tick and those that the robot gets."""

    def alter(self, batch: SensorBatch) -> SensorBatch: ...


class FaultChange(NamedTuple):
    """A fault that began or ended, and that in words."""

    fault: Fault
    is_on: bool
    words: str


class FaultLayer:
    """All faults of one run."""

    def __init__(
        self, faults: Sequence[Fault], config: RunConfig, robot: RobotSpec, world: WorldSpec
    ) -> None:
        self.faults = tuple(faults)
        self._batch_faults = [
            (
                fault.name,
                maker(
                    fault,
                    FaultMaterial(
                        make_stream(config.seed, f"fault {fault.name}"),
                        robot,
                        world,
                        tuple(one for one in self.faults if one.name == fault.name),
                    ),
                ),
            )
            for fault in sorted(self.faults, key=_choose_place)
            if (maker := _find_maker(fault.name, config)) is not None
        ]
        self._body = BodyFaults(self.faults, robot, config.seed)
        self._on: set[int] = set()
        self._changes: list[FaultChange] = []

    def act(self, t_s: float, physics: Physics) -> Obstacle | None:
        """Let act what acts in the physics from now on; return an obstacle that has appeared."""
        appeared = self._body.step(t_s, physics)
        if any(board.is_off(t_s) for board in self._hung_boards):
            physics.command(STOP)
        return appeared

    def find_mount_shift_m(self, t_s: float) -> float:
        """Find how far to the left of its place the camera's mount is."""
        return find_mount_shift_m(self.faults, t_s)

    def list_names(self, t_s: float) -> tuple[str, ...]:
        """List the names of the faults that are on."""
        return tuple(fault.name for fault in self.faults if fault.is_on(t_s))

    def hears(self, t_s: float) -> bool:
        """Whether the board hears commands."""
        return self._body.hears(t_s) and all(board.hears(t_s) for board in self._hung_boards)

    def alter(self, batch: SensorBatch) -> SensorBatch:
        """Return the samples as the robot gets them."""
        self._note_changes(batch.t_s)
        for _, fault in self._batch_faults:
            batch = fault.alter(batch)
        return batch

    def leave(self, names: Collection[str]) -> None:
        """Let somebody else do what faults of these names do to samples."""
        self._batch_faults = [one for one in self._batch_faults if one[0] not in names]

    @property
    def _hung_boards(self) -> list[HungBoard]:
        return [fault for _, fault in self._batch_faults if isinstance(fault, HungBoard)]

    def take_changes(self) -> list[FaultChange]:
        """Return what began and what ended since the last call."""
        changes, self._changes = self._changes, []
        return changes

    def _note_changes(self, t_s: float) -> None:
        for number, fault in enumerate(self.faults):
            if fault.is_on(t_s) == (number in self._on):
                continue
            self._on ^= {number}
            is_on = number in self._on
            words = "ends" if not is_on else "begins" if fault.begin_s >= 0.0 else "goes on"
            self._changes.append(FaultChange(fault, is_on, f"{fault.text} {words}"))


class FaultMaterial(NamedTuple):
    """Material of a fault: its own random stream, the robot, the world, and all of its name."""

    rng: np.random.Generator
    robot: RobotSpec
    world: WorldSpec
    alike: tuple[Fault, ...] = ()


MakeFault = Callable[[Fault, FaultMaterial], BatchFault]


def _find_maker(name: str, config: RunConfig) -> MakeFault | None:
    """Find what makes a fault of samples, here or in an installed package."""
    if name in BUILT_IN:
        return MAKERS.get(name)
    installed = find_plugin(FAULTS, name)
    if installed is None:
        return None
    return partial(installed.make, **bind_settings(installed, config.plugins, name))


def _make_offset(fault: Fault, around: FaultMaterial) -> BatchFault:
    return Offset(fault, around.world.datum, around.rng)


# Effects of faults on samples; a fault without an entry has none.
MAKERS: dict[str, MakeFault] = {
    "gnss.outage": lambda fault, _: Outage(fault),
    "gnss.jump": _make_offset,
    "gnss.wrong_fix": _make_offset,
    "gnss.drift": _make_offset,
    "gnss.frozen": lambda fault, _: FrozenReceiver(fault),
    "gnss.scatter": lambda fault, around: NoisyPosition(fault, around.world.datum, around.rng),
    "gnss.velocity": lambda fault, around: NoisyVelocity(fault, around.rng),
    "mag.motor": lambda fault, around: MotorField(fault, around.rng),
    "mag.offset": lambda fault, around: Magnet(fault, around.rng),
    "imu.bias": lambda fault, _: GyroBias(fault),
    "imu.frozen": lambda fault, _: FrozenImu(fault),
    "imu.late": lambda fault, _: Late(fault),
    "imu.unplugged": lambda fault, _: UnpluggedImu(fault),
    "wheels.stuck": lambda fault, _: Miscount(fault),
    "wheels.reversed": lambda fault, _: Miscount(fault),
    "camera.black": lambda fault, _: BadPicture(fault),
    "camera.frozen": lambda fault, _: BadPicture(fault),
    "camera.flipped": lambda fault, _: BadPicture(fault),
    "camera.mirrored": lambda fault, _: BadPicture(fault),
    "camera.late": lambda fault, _: Late(fault),
    "camera.off": lambda fault, _: BadPicture(fault),
    "bumper.contact": lambda fault, around: Touch(fault, _measure_front_m(around.robot)),
    "button.pressed": lambda _, around: PressedButton(around.alike),
    "battery.empty": lambda fault, _: EmptyBattery(fault),
    "link.noise": lambda fault, around: NoisyLink(fault, around.rng),
    "clock.step": lambda fault, _: SteppedClock(fault),
    "board.silent": lambda fault, _: SilentBoard(fault),
    "inputs.silent": lambda _, around: SilentInputs(around.alike),
    "contactor.silent": lambda fault, _: SilentContactor(fault),
    "board.hung": lambda fault, _: HungBoard(fault),
}


def _choose_place(fault: Fault) -> int:
    return LAST.index(fault.name) if fault.name in LAST else -1


def _measure_front_m(robot: RobotSpec) -> float:
    """Measure from the body's origin to the foremost point of the wheels."""
    ahead_m: float = robot.wheel_xy_body_m()[:, 0].max()
    return float(ahead_m + robot.drive.wheel_radius_m)
