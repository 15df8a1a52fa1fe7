"""Who publishes and who listens: inside the robot, with measured rates, and in its networks."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response

from agribot.core.errors import BridgeError
from agribot.ros.graph import Graph, select_topics
from agribot.ros.graph_picture import draw_graph
from agribot.ros.robot_graph import SENSOR_TOPICS, make_robot_graph
from agribot.ui.server.answers import NO_STORE, Unusable, json_answer
from agribot.ui.server.health_routes import measure_rates
from agribot.ui.server.hub import Hub
from agribot.ui.server.off_the_loop import run_in_thread
from agribot.ui.server.topic_sources import TITLES

PER_TICK = ("/agribot/odometry/estimate", "/agribot/cmd_vel", "/agribot/tick", "/tf")


async def graph(request: Request) -> Response:
    found = await _find(request, request.path_params["of"])
    return json_answer(found)


async def graph_picture(request: Request) -> Response:
    found = await _find(request, request.path_params["of"])
    text = await run_in_thread(draw_graph, found)
    return Response(text, media_type="image/svg+xml", headers=NO_STORE)


async def _find(request: Request, of: str) -> Graph:
    """Find a graph.

    Raises: Unusable: no such network, or it does not answer.
    """
    hub: Hub = request.app.state.hub
    if of == "robot":
        return make_own_graph(hub)
    sources = hub.find_topics()
    if of not in sources.feeds:
        raise Unusable(404, f"no network '{of[:20]}'; there are robot, {', '.join(sources.feeds)}")
    try:
        return select_topics(await run_in_thread(sources.read_graph, of))
    except BridgeError as error:
        raise Unusable(503, str(error)) from error


def make_own_graph(hub: Hub) -> Graph:
    """Make the graph of the robot's parts with the rates of the last seconds."""
    config, robot = hub.about.config, hub.about.robot_spec
    has_eyes = robot.camera is not None and config.perception.enabled
    absent = [] if has_eyes else ["camera", "perceive"]
    absent += [] if config.platform == "sim" else ["simulator"]
    absent += [] if robot.lidar is not None else ["lidar"]
    absent += [] if robot.implement is not None else ["implement"]
    bridges = [TITLES[name] for name in hub.about.ros.layers_from]
    return make_robot_graph(_measure_topics(hub), absent, bridges)


def _measure_topics(hub: Hub) -> dict[str, float]:
    rates = {
        SENSOR_TOPICS[rate.topic].name: rate.measured_hz
        for rate in measure_rates(hub)
        if rate.measured_hz is not None and rate.topic in SENSOR_TOPICS
    }
    ticks_hz = measure_ticks_hz(hub)
    return rates | ({} if ticks_hz is None else dict.fromkeys(PER_TICK, ticks_hz))


def measure_ticks_hz(hub: Hub) -> float | None:
    """Count the ticks per second of the robot's own time; None before there are some."""
    counts = hub.counts
    passed_s = counts[-1].t_s - counts[0].t_s if counts else 0.0
    if passed_s <= 0.0 or "ticks" not in counts[-1].samples:
        return None
    passed = counts[-1].samples["ticks"] - counts[0].samples.get("ticks", 0)
    return round(passed / passed_s, 2)


ROUTES = (
    ("GET", "/api/v1/graph/{of}", graph),
    ("GET", "/api/v1/graph/{of}/picture.svg", graph_picture),
)
