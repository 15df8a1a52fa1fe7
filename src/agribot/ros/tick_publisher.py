"""The tap of every bridge: the control loop puts a record into a queue and goes on.

One thread turns the records into messages and passes them to the gateways. When it cannot keep
up, or a gateway stalls, the oldest records are lost, and the loop is not delayed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar

from agribot.core import topics
from agribot.core.config import EstimateConfig
from agribot.core.errors import BridgeError
from agribot.core.geo import Datum
from agribot.core.messages import MappedPlant, MapPoint, Path, TickRecord, Vec3
from agribot.core.platform import TrueState
from agribot.core.robot import RobotSpec
from agribot.core.topics import Topic
from agribot.ros.messages import cdr
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.rosmsg import to_nanoseconds
from agribot.ros.messages.topic_writer import TopicWriter
from agribot.ros.send_queue import SendQueue

QUEUE_TICKS = 50  # one second
_SLOW_PERIOD_S = 1.0  # period of the weed map
_TRUTH_PERIOD_S = 0.1

T = TypeVar("T")


class Gateway(Protocol):
    """One network that takes messages. Called from the publisher's thread only."""

    def publish(self, topic: Topic, data: bytes, t_ns: int) -> None:
        """Send one CDR message.

        Raises: BridgeError: the gateway is closed or lost its peer.
        """
        ...

    def step(self, record: TickRecord) -> None:
        """Handle the record of a robot's tick, after its messages."""
        ...

    def close(self) -> None: ...


class GatewayGroup:
    """Several gateways: one that fails is named in `fault` and does not delay the others."""

    def __init__(self, gateways: Sequence[Gateway]) -> None:
        self._gateways = tuple(gateways)
        self._clock = cdr.ClockCdr()
        self.fault = ""

    def send(self, topic: Topic, log_ns: int, data: bytes, _publish_ns: int) -> None:
        for gateway in self._gateways:
            try:
                gateway.publish(topic, data, log_ns)
            except BridgeError as error:
                self.fault = str(error)

    def publish_time(self, t_s: float) -> None:
        t_ns = to_nanoseconds(t_s)
        self.send(topics.CLOCK, t_ns, self._clock(t_ns), t_ns)

    def step(self, record: TickRecord) -> None:
        for gateway in self._gateways:
            gateway.step(record)

    def close(self) -> None:
        for gateway in self._gateways:
            gateway.close()


class QueuedGateways(Generic[T]):
    """Gateways with a thread of their own: it calls `_step` with each item of `_queue`."""

    def __init__(self, gateways: Sequence[Gateway]) -> None:
        self._gateways = GatewayGroup(gateways)
        self._queue: SendQueue[T] = SendQueue(self._step, QUEUE_TICKS)

    @property
    def dropped(self) -> int:
        return self._queue.dropped

    @property
    def fault(self) -> str:
        return self._gateways.fault

    def close(self) -> None:
        """Send what is queued, within a moment, and close the gateways. Safe to call twice."""
        if self._queue.close():
            self._gateways.close()

    def _step(self, item: T) -> None:
        raise NotImplementedError


class RunSources(NamedTuple):
    """Values of the run besides the record, read in the loop's thread; each call is quick."""

    plan: Callable[[], Path | None]
    goals_map_m: Callable[[], Sequence[MapPoint]] = tuple
    weed_map: Callable[[], Sequence[MappedPlant]] | None = None
    truth: Callable[[], TrueState] | None = None
    imu_bias: Callable[[], tuple[Vec3, Vec3]] | None = None


class _QueuedTick(NamedTuple):
    record: TickRecord
    truth: TrueState | None
    imu_bias: tuple[Vec3, Vec3] | None = None


class TickPublisher(QueuedGateways[_QueuedTick]):
    """Call it with every TickRecord; close it when the run is over.

    `dropped` counts ticks that found the queue full, `fault` names the last failure of a gateway.
    """

    def __init__(
        self,
        gateways: Sequence[Gateway],
        robot: RobotSpec,
        datum: Datum,
        urdf: str,
        camera: CameraLog,
        sources: RunSources,
        wheels: EstimateConfig | None = None,
    ) -> None:
        """Publish to all `gateways`; `wheels` is how well the robot's wheels are believed."""
        super().__init__(gateways)
        self._sources = sources
        self._feed = TopicWriter(self._gateways.send, robot, datum, urdf, camera, wheels)
        self._weeds: deque[tuple[float, Sequence[MappedPlant]]] = deque(maxlen=1)
        self._plans: deque[tuple[float, Path, tuple[MapPoint, ...]]] = deque(maxlen=1)
        self._plan: Path | None = None
        self._next_weeds_s = self._next_truth_s = 0.0

    def __call__(self, record: TickRecord) -> None:
        t_s = record.batch.t_s
        plan = self._sources.plan()
        if plan is not None and plan is not self._plan:
            self._plan = plan
            self._plans.append((t_s, plan, tuple(self._sources.goals_map_m())))
        if self._sources.weed_map is not None and t_s >= self._next_weeds_s:
            self._next_weeds_s = t_s + _SLOW_PERIOD_S
            self._weeds.append((t_s, tuple(self._sources.weed_map())))
        truth = imu_bias = None
        if self._sources.truth is not None and t_s >= self._next_truth_s:
            self._next_truth_s = t_s + _TRUTH_PERIOD_S
            truth = self._sources.truth()
            imu_bias = self._sources.imu_bias and self._sources.imu_bias()
        self._queue.put(_QueuedTick(record, truth, imu_bias))

    def _step(self, item: _QueuedTick) -> None:
        t_s = item.record.batch.t_s
        while self._plans:
            self._feed.set_plan(*self._plans.popleft())
        self._feed(item.record)
        while self._weeds:
            self._feed.set_weeds(*self._weeds.popleft())
        if item.truth is not None:
            true = item.truth
            pose = (true.x_map_m, true.y_map_m, true.yaw_map_rad)
            self._feed.write_truth(t_s, pose, (true.v_mps, true.yaw_rate_radps))
        if item.imu_bias is not None:
            self._feed.write_imu_bias(t_s, item.imu_bias)
        self._gateways.publish_time(t_s)
        self._gateways.step(item.record)
