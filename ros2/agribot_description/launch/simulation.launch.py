"""The world alone, as Gazebo was: sensors out, /agribot/cmd_vel in."""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument("world", default_value="empty"),
            DeclareLaunchArgument("bridge", default_value="--ros2"),
            DeclareLaunchArgument("options", default_value="", description="of agribot sim"),
            ExecuteProcess(
                cmd=["agribot", "sim", "--world", LaunchConfiguration("world"),
                     LaunchConfiguration("bridge"), LaunchConfiguration("options")],
                shell=True,
                output="screen",
            ),
        ]
    )  # fmt: skip
