"""The rigid body on soil with motors that somebody else drives, such as real firmware."""

from __future__ import annotations

from typing import Protocol

from agribot.core.errors import PlatformError
from agribot.core.messages import WHEEL_NAMES, FloatArray, Four
from agribot.core.robot import RobotSpec
from agribot.core.world import WorldSpec
from agribot.sim import kernel
from agribot.sim.physics import Physics
from agribot.sim.state import WHEEL_SPEED

HELD_BY_DRIVER = slice(kernel.BOARD_INTEGRAL, kernel.BOARD_INTEGRAL + len(WHEEL_NAMES))


class WheelDriver(Protocol):
    """Driver of the wheels, in the order of WHEEL_NAMES."""

    def drive(self, dt_s: float, speed_radps: Four) -> Four:
        """Live through `dt_s` while the wheels turn so; gives the torques at the wheels, Nm."""
        ...


class DrivenPhysics(Physics):
    """Asks a `WheelDriver` before every step; the board of the simulator does nothing.

    That board's controllers have no gains: what is left of them is the torque that they hold,
    within the limit of the drive.
    """

    def __init__(
        self, robot: RobotSpec, world: WorldSpec, physics_step_ns: int, driver: WheelDriver
    ) -> None:
        if robot.middle_wheels:
            raise PlatformError(
                f"robot '{robot.name}' has {len(robot.wheel_names)} wheels; the firmware's board "
                "drives four motors; take the simulator's own board (--platform sim)"
            )
        self._driver: WheelDriver | None = None  # the robot settles on its own board
        super().__init__(robot, world, physics_step_ns, is_effort=True)
        self._board = self._board._replace(p_nmspr=0.0, i_nmprad=0.0, d_nms2prad=0.0)
        self._driver = driver

    def _count_steps(self, most: int) -> int:
        count = super()._count_steps(most)
        return count if self._driver is None else 1

    def _run(self, history: FloatArray, steps: int) -> None:
        if self._driver is not None:
            a, b, c, d = history[0, WHEEL_SPEED].tolist()
            torque_nm = self._driver.drive(self._dt_s * steps, (a, b, c, d))
            self._board_state[HELD_BY_DRIVER] = torque_nm
        super()._run(history, steps)
