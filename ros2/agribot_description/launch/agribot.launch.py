"""The main job: the robot drives the farm, RViz shows it."""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, ExecuteProcess, RegisterEventHandler
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    view = PathJoinSubstitution([FindPackageShare("agribot_description"), "rviz", "agribot.rviz"])
    robot = ExecuteProcess(
        cmd=["agribot", "run", LaunchConfiguration("profile"), "--raw-images",
             LaunchConfiguration("bridge"), LaunchConfiguration("options")],
        shell=True,  # so that options may be several words
        output="screen",
    )  # fmt: skip
    return LaunchDescription(
        [
            DeclareLaunchArgument("profile", default_value="farm"),
            DeclareLaunchArgument(
                "bridge", default_value="--ros2", description="--ros2 (rmw_zenoh) or --dds"
            ),
            DeclareLaunchArgument("options", default_value="", description="of agribot run"),
            DeclareLaunchArgument("rviz", default_value="true"),
            robot,
            RegisterEventHandler(
                OnProcessExit(target_action=robot, on_exit=[EmitEvent(event=Shutdown())])
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", view],
                parameters=[{"use_sim_time": True}],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
