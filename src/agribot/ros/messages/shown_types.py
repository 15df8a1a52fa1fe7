"""Which displays of the page read which ROS type."""

from __future__ import annotations

_NUMBERS = ("Float32", "Float64", "Int8", "Int16", "Int32", "Int64", "UInt8", "UInt16", "UInt32",
            "UInt64")  # fmt: skip

# Displays by ROS type; their names are those of mapviz's plugins, `geojson` is added here.
SHOWN_TYPES: dict[str, tuple[str, ...]] = {
    "gps_common/msg/GPSFix": ("gps", "navsat"),
    "gps_msgs/msg/GPSFix": ("gps", "navsat"),
    "sensor_msgs/msg/NavSatFix": ("navsat", "gps"),
    "nav_msgs/msg/Odometry": ("odometry", "attitude_indicator"),
    "geometry_msgs/msg/PoseStamped": ("pose", "robot_image", "attitude_indicator"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("odometry",),
    "geometry_msgs/msg/PointStamped": ("pose",),
    "geometry_msgs/msg/PolygonStamped": ("path",),
    "geometry_msgs/msg/TransformStamped": ("tf_frame",),
    "sensor_msgs/msg/Imu": ("attitude_indicator",),
    "nav_msgs/msg/Path": ("path",),
    "marti_nav_msgs/msg/Route": ("route",),
    "sensor_msgs/msg/LaserScan": ("laserscan",),
    "sensor_msgs/msg/PointCloud2": ("pointcloud2",),
    "nav_msgs/msg/OccupancyGrid": ("occupancy_grid",),
    "visualization_msgs/msg/Marker": ("marker",),
    "visualization_msgs/msg/MarkerArray": ("marker",),
    "marti_visualization_msgs/msg/TexturedMarker": ("textured_marker",),
    "marti_visualization_msgs/msg/TexturedMarkerArray": ("textured_marker",),
    "stereo_msgs/msg/DisparityImage": ("disparity",),
    "sensor_msgs/msg/Image": ("image",),
    "sensor_msgs/msg/CompressedImage": ("image",),
    "std_msgs/msg/String": ("string", "geojson"),
    "marti_common_msgs/msg/StringStamped": ("string",),
    "marti_common_msgs/msg/Float32Stamped": ("float",),
    "marti_common_msgs/msg/Float64Stamped": ("float",),
    "marti_sensor_msgs/msg/Velocity": ("float",),
    **{f"std_msgs/msg/{name}": ("float",) for name in _NUMBERS},
}
# Every display that reads messages.
SHOWN_DISPLAYS = frozenset(display for displays in SHOWN_TYPES.values() for display in displays)
GRID_UPDATE = "map_msgs/msg/OccupancyGridUpdate"
ROUTE_POSITION = "marti_nav_msgs/msg/RoutePosition"
# Ending of the topic beside that adds to it, by type.
BESIDE = {"nav_msgs/msg/OccupancyGrid": "_updates", "marti_nav_msgs/msg/Route": "_position"}


def to_full_name(ros_type: str) -> str:
    """Return `sensor_msgs/msg/Imu` for the `sensor_msgs/Imu` of ROS 1."""
    package, slash, rest = ros_type.partition("/")
    return ros_type if not slash or rest.startswith("msg/") else f"{package}/msg/{rest}"
