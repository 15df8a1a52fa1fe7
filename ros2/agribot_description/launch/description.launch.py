"""The description without any simulation: joints at zero, the frame tree, no world."""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import Command, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    urdf = Command(["agribot describe --urdf --robot ", LaunchConfiguration("robot")])
    return LaunchDescription(
        [
            DeclareLaunchArgument("robot", default_value="agribot"),
            Node(package="joint_state_publisher", executable="joint_state_publisher"),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[{"robot_description": ParameterValue(urdf, value_type=str)}],
            ),
        ]
    )
