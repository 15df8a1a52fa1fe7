"""Names of ROS types in DDS, which rmw_zenoh uses as well."""

from __future__ import annotations


def to_dds_name(ros_type: str) -> str:
    """Convert `sensor_msgs/msg/Imu` to `sensor_msgs::msg::dds_::Imu_`."""
    package, kind, name = ros_type.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def from_dds_name(name: str) -> str:
    """Convert `sensor_msgs::msg::dds_::Imu_` to `sensor_msgs/msg/Imu`; "" for other names."""
    parts = name.split("::")
    if len(parts) != 4 or parts[2] != "dds_":
        return ""
    return f"{parts[0]}/{parts[1]}/{parts[3].removesuffix('_')}"
