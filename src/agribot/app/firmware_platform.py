"""The simulated robot with real firmware: every wheel sample, fix and command is bytes.

simulator -> encoders, contacts, voltages and IMU of the board -> firmware, executed instruction by
instruction -> frames -> codecs -> stack -> frames -> firmware -> duty of the motors -> simulator,
in lock-step, so that a run repeats bit by bit. What the receiver measures goes to its decoder as
UBX, on a line of its own. The bench that runs the firmware stands on simavr,
whose licence keeps it outside of this package: it comes with the project's sources.
"""

from __future__ import annotations

import importlib.util
import math
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import msgspec

from agribot.app import stop_memory
from agribot.app.firmware_faults import BELOW_THE_SAMPLES, BoardFaults, LineNoise
from agribot.app.firmware_receiver import FirmwareReceiver
from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError, PlatformError
from agribot.core.facts import Fact
from agribot.core.home import find_home
from agribot.core.messages import (
    Four,
    ImplementCommand,
    Inbox,
    RobotCommand,
    SensorBatch,
)
from agribot.core.messages.sensors import join_batches
from agribot.core.robot import DriveSpec, RobotSpec
from agribot.drivers.board.agribot_board import TOOL_OUTPUTS, make_board
from agribot.drivers.board.board_link import BoardLink
from agribot.drivers.line.schemes import SourceUri
from agribot.drivers.line.uri_options import UriOptions
from agribot.sim.faults.boards import hush_inputs

if TYPE_CHECKING:
    from agribot.app.run_setup import RunSetup
    from agribot.core.world import WorldSpec
    from agribot.sim.platform import SimPlatform

BOARD_HZ = 100.0  # rate at which contacts, voltages and IMU change, and bytes are handed on
BOOT_S = 2.0  # time by which a board has spoken
MAG_SETTLES_S = 0.1  # time from the world's first field at the chip to the first frame that has it
COUNTS_PER_TURN = 2048.0
SUPPLY_V = 24.0
MOST_SENSED_A = 24.0  # range of the board's current sensors
PACK_FULL_V = 25.2  # full pack of the simulator: six lithium-ion cells
OPTIONS = (
    ("counts_per_turn", f"{COUNTS_PER_TURN:g}"), ("full_speed_radps", "80"),
    ("battery_empty_v", "18"), ("battery_full_v", f"{PACK_FULL_V:g}"),
)  # fmt: skip


class FirmwareMotors:
    """The board on its bench between the wheels' encoders and the motors.

    A motor is V = R I + k w and T = k I behind its gear; with no duty it is shorted, and brakes.
    Without power no current flows, and it rolls.
    """

    def __init__(self, bench: Any, drive: DriveSpec, faults: BoardFaults) -> None:
        self._bench, self._drive, self._faults = bench, drive, faults
        self.has_power = True

    def drive(self, dt_s: float, speed_radps: Four) -> Four:
        """Run the firmware for `dt_s`; gives the torques at the wheels, Nm."""
        duties = self._bench.advance(dt_s, self._faults.show(speed_radps))
        runaway_radps = self._faults.runaway_radps
        if runaway_radps is not None:
            duties = (self._drive.torque_constant_nmpa * runaway_radps / SUPPLY_V,) * 4
        constant, winding = self._drive.torque_constant_nmpa, self._drive.winding_ohm
        currents = self._faults.limit_currents(
            [
                (duty * SUPPLY_V - constant * speed) / winding
                for duty, speed in zip(duties, speed_radps, strict=True)
            ]
        )
        if not self.has_power:
            currents = [0.0] * len(currents)
        torques = []
        for current_a, speed in zip(currents, speed_radps, strict=True):
            torque_nm = constant * current_a
            gear = self._drive.gear_efficiency_ratio
            torques.append(torque_nm * gear if torque_nm * speed >= 0.0 else torque_nm)
        self._bench.set_currents([min(abs(current_a), MOST_SENSED_A) for current_a in currents])
        a, b, c, d = torques
        return a, b, c, d


class FirmwarePlatform:
    """`simulator` ticks with BOARD_HZ and has `FirmwareMotors`; `bench` is the board of both."""

    def __init__(
        self, config: RunConfig, robot: RobotSpec, simulator: SimPlatform, bench: Any,
        motors: FirmwareMotors, faults: BoardFaults, gnss_noise: LineNoise, saved_stop: Fact | None,
    ) -> None:  # fmt: skip
        """Switch the board on, and wait until it has spoken.

        `saved_stop` is that of the mission which goes on; empty where it may drive.

        Raises: ConfigError: ticks that the board's do not fit. PlatformError: the board is silent.
        """
        self._ticks, rest = divmod(BOARD_HZ, config.tick_hz)
        if rest:
            raise ConfigError(
                f"platform = 'firmware' needs a tick_hz that divides {BOARD_HZ:g}, not "
                f"{config.tick_hz:g}; take 50"
            )
        self.inbox = Inbox()
        self._simulator, self._bench, self._faults = simulator, bench, faults
        self._motors = motors
        if simulator.faults is not None:
            simulator.faults.leave(BELOW_THE_SAMPLES)
        self._t_s = 0.0
        self._has_imu = True
        self._battery_v = PACK_FULL_V  # until the simulator reports it
        self._field_from_s = math.inf  # before, the chip shows a field that is not of the world
        windings = {"winding_ohm": robot.drive.winding_ohm}
        options = UriOptions(SourceUri("firmware", "", "", OPTIONS), windings)
        self._link = BoardLink(make_board(robot, options), robot.drive, lambda: self._t_s)
        self._receiver = FirmwareReceiver(simulator.gnss_latency_s, gnss_noise, lambda: self._t_s)
        self._implement, self._is_power_cut = ImplementCommand(), False
        self._boot()
        # A person who starts a simulation has armed it, but has not seen why a mission stopped.
        stop_memory.begin(self.inbox, saved_stop)

    def read(self) -> SensorBatch:
        """Advance simulator and board by a tick; wheels, inputs and IMU are those of the board.

        Fixes are those of the receiver's bytes.

        Raises: PlatformError: the simulator does.
        """
        batches = []
        for _ in range(int(self._ticks)):
            self._simulator.write(self._command_simulator())
            batches.append(self._simulator.read())
            self._feel(batches[-1])
            self._motors.has_power = self._simulator.has_power
            self._t_s = self._faults.t_s = batches[-1].t_s
            self._receiver.carry(batches[-1])
            self._link.feed(self._faults.bring(self._bench.receive()), self._t_s)
        requests, hand = self.inbox.drain(self._t_s)
        samples = self._link.take(self._t_s)
        if self._faults.are_inputs_silent:
            samples |= hush_inputs(samples)
        samples["mag"] = tuple(each for each in samples["mag"] if each.t_s >= self._field_from_s)
        self._send(self._link.clear(self._t_s, requests, samples["board"]))
        samples |= self._receiver.take(self._t_s)
        notes = (*samples.pop("notes"), *self._link.watch_line(self._t_s))
        return msgspec.structs.replace(
            join_batches(batches),
            t_s=self._t_s,
            requests=requests,
            notes=notes,
            hand=hand,
            **samples,
        )

    def write(self, command: RobotCommand) -> None:
        """Send a command to the board.

        Raises: PlatformError: a number is not finite.
        """
        self._implement, self._is_power_cut = command.implement, command.is_power_cut
        self._send(self._link.command(command))

    def close(self) -> None:
        self._simulator.close()
        self._bench.close()

    def _send(self, data: bytes) -> None:
        self._bench.send(self._faults.send(data))

    def _boot(self) -> None:
        """Let the board begin, before the time of the run does."""
        self._bench.send(self._link.open())
        still = (0.0, 0.0, 0.0, 0.0)
        for _ in range(round(BOOT_S * BOARD_HZ)):
            self._bench.advance(1.0 / BOARD_HZ, still)
            self._link.feed(self._bench.receive(), 0.0)
            if self._link.has_spoken:
                return
            self._bench.send(self._link.board.poll())
        why = self._link.board.trouble or f"it says nothing for {BOOT_S:g} s"
        raise PlatformError(f"the firmware does not begin: {why}; build it anew")

    def _command_simulator(self) -> RobotCommand:
        """Make the command of tool and contactor: of the tool, what the board lets it do."""
        bits = self._bench.tool
        sections = tuple(
            is_on and (k >= TOOL_OUTPUTS or bool(bits >> k & 1))
            for k, is_on in enumerate(self._implement.sections_on)
        )
        implement = msgspec.structs.replace(self._implement, sections_on=sections)
        return RobotCommand(t_s=self._t_s, implement=implement, is_power_cut=self._is_power_cut)

    def _feel(self, batch: SensorBatch) -> None:
        """Let the board's inputs be what the simulator's sensors say."""
        bench = self._bench
        bench.set_bumper(pressed=bool(batch.bumper))
        bench.set_estop(pressed=self._faults.is_button_pressed)
        if self._has_imu != self._faults.has_imu:
            self._has_imu = self._faults.has_imu
            bench.plug_imu(is_there=self._has_imu)
        if self._faults.take_hangs():
            bench.hang()
        if batch.imu and (accel_mps2 := batch.imu[-1].accel_mps2) is not None:
            bench.set_imu(accel_mps2, batch.imu[-1].gyro_radps)
        if batch.mag:
            bench.set_mag(batch.mag[-1].field_t)
            self._field_from_s = min(self._field_from_s, batch.t_s + MAG_SETTLES_S)
        if batch.battery:
            self._battery_v = batch.battery[-1].voltage_v
        bench.set_battery(self._faults.drain(self._battery_v))


def open_firmware(
    setup: RunSetup, described: RobotSpec, world: WorldSpec
) -> tuple[SimPlatform, FirmwarePlatform]:
    """Open the simulator of a run with the firmware at its wheels, and the platform of both.

    Raises: AgribotError: the bench cannot be built, or the settings do not fit.
    """
    from agribot.sim.faults.motors import draw_weak_wheel
    from agribot.sim.faults.schedule import read_faults
    from agribot.sim.platform import SimPlatform
    from agribot.sim.random_streams import make_stream

    config, began_s = setup.config, setup.earlier.sim_s
    bench = open_bench()
    found = read_faults(config, has_camera=described.camera is not None, began_s=began_s)
    faults = BoardFaults(
        found, described.drive, make_stream(config.seed, "fault of the board's line"),
        draw_weak_wheel(config.seed),
    )  # fmt: skip
    noise = LineNoise(found, make_stream(config.seed, "fault of the receiver's line"))
    motors = FirmwareMotors(bench, described.drive, faults)
    simulator = SimPlatform(
        msgspec.structs.replace(config, tick_hz=BOARD_HZ), described, world,
        board=setup.robot.drive, began_s=began_s,
        driver=motors,
    )  # fmt: skip
    return simulator, FirmwarePlatform(
        config, setup.robot, simulator, bench, motors, faults, noise,
        saved_stop=None if setup.saved is None else setup.saved.stop,
    )  # fmt: skip


def find_firmware() -> Path:
    """Find the folder `firmware/` of the project's sources.

    Raises: ConfigError: it is not there.
    """
    named = os.environ.get("AGRIBOT_FIRMWARE")
    places = [Path(named)] if named else []
    places += [Path(__file__).parents[3] / "firmware", Path("firmware")]
    for place in places:
        if (place / "bench" / "avr_bench.py").is_file():
            return place.resolve()
    raise ConfigError(
        "platform = 'firmware' needs the folder firmware/ of the project's sources; start it "
        "there, or name the folder in AGRIBOT_FIRMWARE"
    )


def open_bench() -> Any:
    """Put the prebuilt firmware of the motor board on its bench.

    Raises: ConfigError: its sources, a C compiler or simavr are missing.
    """
    folder = find_firmware()
    module = _load_module(folder / "bench" / "avr_bench.py")
    cache = find_home() / "bench"
    cache.mkdir(parents=True, exist_ok=True)
    try:
        library = module.load_library(module.build_library(cache))
        return module.AvrBench(
            library, folder / "prebuilt" / "motor_board.hex", counts_per_turn=COUNTS_PER_TURN
        )
    except RuntimeError as error:
        raise ConfigError(f"platform = 'firmware': {error}") from error


def _load_module(path: Path) -> ModuleType:
    name = "agribot_firmware_bench"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
