"""What a user of the original does with this robot, over a real ROS 1; each step says pass or fail.

It is for the system's own Python with rospy, and needs a master, roslaunch, rostopic, rosservice,
rosparam, and `agribot` in the PATH:

    roscore & ROS_PACKAGE_PATH=$PWD/ros1:/usr/share /usr/bin/python3 tests/ros/original_user.py

Every step looks at what became of the robot. The exit status is the number of those that failed.
"""

# mypy: disable-error-code="import-not-found"
from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import actionlib
import rosgraph
import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import (
    PointStamped,
    PoseArray,
    PoseStamped,
    PoseWithCovarianceStamped,
)
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from original_contract import (
    CONTRACT,
    LOUD_RADPS,
    NOISE,
    PLAN_ROUTE_MD5,
    RATES_HZ,
    RECONFIGURE_MD5,
    ROUTE_TEXTS,
)
from original_robot import (
    PATIENCE_S,
    SEPARATOR,
    Failed,
    Gyro,
    Places,
    Robot,
    call,
    check,
    do,
    list_listeners,
    make_pose,
    make_service,
    publish,
    run,
    wait,
)

FOLDER = Path.cwd()
EVENTS = FOLDER / "run" / "events.jsonl"
OPTIONS = (
    "--allow-drive --sensors rtk --set perception.enabled=false --set mission.waits_for_goals=true"
    f" --out {FOLDER / 'run'}"
)
RVIZ = Path(__file__).parents[2] / "ros1" / "agribot_description" / "rviz" / "agribot.rviz"
RVIZ_TOOLS = {"/initialpose", "/move_base_simple/goal", "/clicked_point"}


def see_the_launch(robot: Robot) -> str:
    wait(lambda: robot.status, "no status")
    check("/agribot" in run("rosnode", "list").split(), "no node /agribot")
    return f"/agribot is {robot.state}: {robot.status['reason']}"


def list_topics(_robot: Robot) -> str:
    said = run("rostopic", "list", "-v").partition("Subscribed topics")[0]
    found = dict(re.findall(r" \* (\S+) \[(\S+)\]", said))
    wrong = [f"{name} is {found.get(name)}" for name, kind in CONTRACT.items()
             if found.get(name) != kind]  # fmt: skip
    check(not wrong, wrong)
    return f"{len(found)} topics, all {len(CONTRACT)} of the original with its types"


def measure_rates(_robot: Robot) -> str:
    """Over the robot's clock, until all means are within five per cent."""
    process = subprocess.Popen(
        ["timeout", f"{PATIENCE_S}", "rostopic", "hz", "-w", "100000", *RATES_HZ],
        env={**os.environ, "PYTHONUNBUFFERED": "1"}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    seen: dict[str, float] = {}
    for line in process.stdout or ():
        name, *numbers = line.split() or [""]
        if name in RATES_HZ:
            seen[name] = float(numbers[0])
        if RATES_HZ.keys() == seen.keys() and not list_wrong_rates(seen):
            break
    process.send_signal(signal.SIGINT)
    process.wait()
    check(RATES_HZ.keys() == seen.keys() and not list_wrong_rates(seen), seen)
    return ", ".join(f"{name} {hz:.1f} Hz" for name, hz in seen.items())


def list_wrong_rates(seen_hz: dict[str, float]) -> list[str]:
    return [name for name, hz in RATES_HZ.items() if not 0.95 < seen_hz[name] / hz < 1.05]


def echo_topics(_robot: Robot) -> str:
    lat_deg = read_number("/agribot/fix/latitude")
    up_mps2 = read_number("/agribot/imu/linear_acceleration/z")
    seen = f"latitude {lat_deg:.5f}, specific force upwards {up_mps2:.2f} m/s2"
    check(abs(lat_deg - 21.1613) < 0.001 and abs(up_mps2 - 9.8) < 1.0, seen)
    return seen


def read_number(field: str) -> float:
    return float(run("rostopic", "echo", "-n", "1", field).split()[0])


def stop_and_clear(robot: Robot) -> str:
    do(robot, "resume", lambda: robot.drives)
    do(robot, "stop", lambda: robot.status["stopped"] and robot.stands)
    refused = call("start")
    check(not refused.success and "clear the stop first" in refused.message, refused)
    do(robot, "clear_stop", lambda: not robot.status["stopped"])
    return f"stood, {refused.message}, cleared"


def pause_and_skip(robot: Robot) -> str:
    do(robot, "pause", lambda: robot.drives, False)
    first = robot.status["leg"]
    do(robot, "skip_row", lambda: robot.status["leg"] == "to row 2")
    do(robot, "pause", lambda: robot.state == "paused" and robot.stands, True)
    return f"{first}, then {robot.status['leg']}, then paused"


def go_home_and_cancel(robot: Robot) -> str:
    do(robot, "return_home", lambda: robot.status["leg"] == "way home" and robot.drives)
    do(robot, "cancel", lambda: robot.state == "cancelled" and robot.stands)
    do(robot, "start", lambda: robot.status["leg"] == "to row 1" and robot.drives)
    do(robot, "pause", lambda: robot.state == "paused" and robot.stands, True)
    return "on its way home, cancelled, began anew, paused"


def mark_and_record(robot: Robot) -> str:
    do(robot, "mark", lambda: '"kind":"mark"' in EVENTS.read_text())
    first = EVENTS.with_name("run.mcap")
    do(robot, "stop_recording", lambda: is_closed(first))
    second = FOLDER / "run-2" / "run.mcap"
    do(robot, "start_recording", lambda: second.is_file() and not is_closed(second))
    do(robot, "stop_recording", lambda: is_closed(second))
    return f"{first} has the mark, {second} is the next recording"


def is_closed(file: Path) -> bool:
    """Whether an MCAP file has its end."""
    return file.read_bytes()[8:].endswith(b"\x89MCAP0\r\n")


def set_the_pose(robot: Robot) -> str:
    """The robot believes it until its receiver knows better."""
    x_m, y_m = robot.truth[0] + 0.4, robot.truth[1]
    rospy.set_param("/agribot/initial_pose", {"x": x_m, "y": y_m, "yaw": robot.yaw_rad})
    with closing(Places()) as places:
        do(robot, "set_pose", lambda: places.include(x_m, y_m))
    return f"believed to be at {x_m:.2f}, {y_m:.2f}"


def use_2d_pose_estimate(robot: Robot) -> str:
    x_m, y_m = robot.truth[0], robot.truth[1] + 0.4
    stated = PoseWithCovarianceStamped()
    stated.header.frame_id = "map"
    stated.pose.pose = make_pose(x_m, y_m, robot.yaw_rad)
    # What RViz states: 0.5 m and 15 degrees.
    stated.pose.covariance = [0.25, *[0.0] * 6, 0.25, *[0.0] * 27, 0.0685]
    with closing(Places()) as places:
        publish("/initialpose", stated)
        wait(lambda: places.include(x_m, y_m), lambda: f"believed {places.seen[-1]}")
    return f"believed to be at {x_m:.2f}, {y_m:.2f}"


def use_2d_nav_goal(robot: Robot) -> str:
    goal = PoseStamped()
    goal.header.frame_id, goal.pose = "map", make_pose(-2.0, 0.5, math.pi / 2.0)
    publish("/move_base_simple/goal", goal)
    wait(
        lambda: robot.is_at(-2.0, 0.5) and robot.stands and robot.looks(math.pi / 2.0),
        lambda: f"{robot.truth} {robot.yaw_rad} {robot.status}",
    )
    return f"stands at {robot.truth[0]:.2f}, {robot.truth[1]:.2f} and looks North"


def use_publish_point(_robot: Robot) -> str:
    """It is noted, and no program publishes it again."""
    heard: list[Any] = []
    listener = rospy.Subscriber("/clicked_point", PointStamped, heard.append)
    wait(listener.get_num_connections, "the robot does not publish the page's points")
    point = PointStamped()
    point.header.frame_id, point.point.x, point.point.y = "map", 1.25, -2.5
    publish("/clicked_point", point, listeners=2)
    wait(lambda: "point: East 1.250 m, North -2.500 m" in EVENTS.read_text(), "it is not noted")
    wait(lambda: heard, "it is not heard")
    call("mark")  # what the point would lead to has come when this is answered
    noted = EVENTS.read_text().count("point: East 1.250 m")
    seen = f"noted {noted} time, published {len(heard)} time"
    check(noted == len(heard) == 1, seen)
    return seen


def compare_rviz(_robot: Robot) -> str:
    """All that the view shows is published, and its tools are heard."""
    named = set(re.findall(r"Topic: (/\S+)", RVIZ.read_text()))
    published = {name for name, _ in rospy.get_published_topics()}
    check(named >= RVIZ_TOOLS and named - RVIZ_TOOLS <= published, named - published)
    deaf = [tool for tool in RVIZ_TOOLS if "/agribot" not in list_listeners(tool)]
    check(not deaf, f"not heard: {deaf}")
    return f"the {len(named - RVIZ_TOOLS)} topics of its view are there, its 3 tools are heard"


def change_noise(_robot: Robot) -> str:
    with closing(Gyro()) as gyro:
        quiet = gyro.measure()
        reconfigure({"gaussian_noise": LOUD_RADPS})
        loud = gyro.measure()
        reconfigure({"gaussian_noise": 0.0})
        again = gyro.measure()
    seen = f"gyro {quiet:.4f}, {loud:.4f}, {again:.4f} rad/s"
    check(abs(loud - math.hypot(LOUD_RADPS, quiet)) < 0.01, seen)
    check(quiet < 0.01 and again < 0.01, seen)
    return seen


def reconfigure(values: dict[str, float]) -> None:
    """As rqt_reconfigure; the types are those that the topic of the group announces."""
    updates = rospy.wait_for_message(f"{NOISE}/parameter_updates", rospy.AnyMsg, PATIENCE_S)
    announced = updates._connection_header["message_definition"]
    service, kinds = make_service(
        "dynamic_reconfigure/Reconfigure", RECONFIGURE_MD5, "Config config", "Config config",
        f"{SEPARATOR}dynamic_reconfigure/Config\n{announced}",
    )  # fmt: skip
    double = kinds["dynamic_reconfigure/DoubleParameter"]
    config = kinds["dynamic_reconfigure/Config"]()
    config.doubles = [double(name, value) for name, value in values.items()]
    answer = rospy.ServiceProxy(f"{NOISE}/set_parameters", service)(config)
    have = {each.name: each.value for each in answer.config.doubles}
    check(have | values == have, have)


def send_goals(robot: Robot) -> str:
    """What AutonomusDriveAction did: one goal of move_base after the other."""
    client = actionlib.SimpleActionClient("move_base", MoveBaseAction)
    check(client.wait_for_server(rospy.Duration(PATIENCE_S)), "no server of move_base")
    feedback: list[Any] = []
    for y_m in (1.1, 1.7):
        goal = MoveBaseGoal()
        goal.target_pose.header.frame_id, goal.target_pose.pose = "map", make_pose(-2.0, y_m, 1.57)
        client.send_goal(goal, feedback_cb=feedback.append)
        client.wait_for_result(rospy.Duration(PATIENCE_S))
        check(client.get_state() == GoalStatus.SUCCEEDED, client.get_goal_status_text())
        check(robot.is_at(-2.0, y_m), robot.truth)
    check(feedback, "no feedback")
    return f"two goals reached with {len(feedback)} feedbacks, North {robot.truth[1]:.2f} m"


def visit_a_list(robot: Robot) -> str:
    visit = PoseArray()
    visit.header.frame_id = "map"
    visit.poses = [make_pose(-2.0, 2.3, 0.0), make_pose(-2.0, 2.9, 0.0)]
    publish("/agribot/visit", visit)
    wait(lambda: robot.status["task"] and robot.state == "done", lambda: robot.status)
    check(robot.is_at(-2.0, 2.9), robot.truth)
    return f"{robot.status['waypoints_reached']} of 2 places, North {robot.truth[1]:.2f} m"


def plan_a_route(robot: Robot) -> str:
    """As mapviz's plan_route, which draws what it gets."""
    before = robot.truth
    service, _ = make_service("marti_nav_msgs/PlanRoute", PLAN_ROUTE_MD5, *ROUTE_TEXTS)
    request = service._request_class()
    request.header.frame_id, request.plan_from_vehicle = "map", True
    request.waypoints = [make_pose(-2.0, 1.0, 1.57), make_pose(-2.0, 3.0, 1.57)]
    answer = rospy.ServiceProxy("/agribot/plan_route", service)(request)
    check(answer.success, answer.message)
    places = [(p.pose.position.x, p.pose.position.y) for p in answer.route.route_points]
    check(math.dist(places[0], before) < 0.1 and math.dist(places[-1], (-2.0, 3.0)) < 0.05, places)
    check(min(math.dist(place, (-2.0, 1.0)) for place in places) < 0.05, places)
    check(robot.stands and robot.is_at(*before), robot.truth)
    return f"{len(places)} points from the robot through both places, not driven"


STEPS: tuple[tuple[str, Callable[[Robot], str]], ...] = (
    ("roslaunch agribot_description agribot.launch", see_the_launch),
    ("rostopic list -v", list_topics),
    ("rostopic hz", measure_rates),
    ("rostopic echo", echo_topics),
    ("rosservice call resume, stop, start, clear_stop", stop_and_clear),
    ("rosservice call pause, skip_row", pause_and_skip),
    ("rosservice call return_home, cancel, start", go_home_and_cancel),
    ("rosservice call mark, stop_recording, start_recording", mark_and_record),
    ("rosservice call set_pose", set_the_pose),
    ("RViz, 2D Pose Estimate", use_2d_pose_estimate),
    ("RViz, 2D Nav Goal", use_2d_nav_goal),
    ("RViz, Publish Point", use_publish_point),
    ("RViz, agribot.rviz", compare_rviz),
    ("rqt_reconfigure, noise of the gyro", change_noise),
    ("mapviz, plan_route", plan_a_route),
    ("actionlib, one goal after the other", send_goals),
    ("a list of places at once", visit_a_list),
)


def has_simulated_time() -> bool:
    return bool(rosgraph.Master("/user").hasParam("/use_sim_time"))


def main() -> int:
    failed = 0
    launch = ["roslaunch", "agribot_description", "agribot.launch", "rviz:=false"]
    with subprocess.Popen([*launch, f"options:={OPTIONS}"], stdout=subprocess.DEVNULL) as process:
        wait(has_simulated_time, "roslaunch has not set /use_sim_time")  # read when a node begins
        rospy.init_node("user", disable_signals=True)
        robot = Robot()
        for name, step in STEPS:
            try:
                line = f"pass  {name}: {step(robot)}"
            except (Failed, rospy.ROSException, ValueError, subprocess.TimeoutExpired) as error:
                line, failed = f"fail  {name}: {error}", failed + 1
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()
        process.send_signal(signal.SIGINT)
    return failed


if __name__ == "__main__":
    sys.exit(main())
