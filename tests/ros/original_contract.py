"""Names, types and rates that users of the original know, and the types of services they call.

For the system's own Python with rospy.
"""

# mypy: disable-error-code="import-not-found"
from __future__ import annotations

from geometry_msgs.msg import Pose
from original_robot import SEPARATOR
from std_msgs.msg import Header

# The original's topics and types.
CONTRACT = {
    "/agribot/fix": "sensor_msgs/NavSatFix",
    "/agribot/fix_velocity": "geometry_msgs/Vector3Stamped",
    "/agribot/imu": "sensor_msgs/Imu",
    "/agribot/imu/bias": "sensor_msgs/Imu",
    "/magnetic": "geometry_msgs/Vector3Stamped",
    "/odom": "nav_msgs/Odometry",
    "/agribot/odom": "nav_msgs/Odometry",
    "/agribot/joint_states": "sensor_msgs/JointState",
    "/joint_states": "sensor_msgs/JointState",
    "/agribot/agribot/camera/image_raw": "sensor_msgs/Image",
    "/currentPose": "geometry_msgs/Pose",
    "/goal_GPS": "sensor_msgs/NavSatFix",
    "/distance": "std_msgs/Float64",
    "/angle": "std_msgs/Float64",
    "/angleOG": "std_msgs/Float64",
    "/Rawheading": "std_msgs/Float64",
    "/Filteredheading": "std_msgs/Float64",
    "/calibrated": "std_msgs/Bool",
    "/tf": "tf2_msgs/TFMessage",
    "/clock": "rosgraph_msgs/Clock",
    "/move_base/status": "actionlib_msgs/GoalStatusArray",
}
# Of docs/topics.md.
RATES_HZ = {
    "/agribot/imu": 200.0,
    "/odom": 50.0,
    "/agribot/joint_states": 50.0,
    "/agribot/fix": 10.0,
    "/currentPose": 10.0,
    "/magnetic": 5.0,
}
NOISE = "/agribot/imu/rate"
LOUD_RADPS = 0.05
# Of dynamic_reconfigure/Reconfigure, which rqt_reconfigure calls with a Config in and out.
RECONFIGURE_MD5 = "bb125d226a21982a4a98760418dc2672"
# Of marti_nav_msgs/PlanRoute, which mapviz calls.
PLAN_ROUTE_MD5 = "fc2df8428924c01b72b355fa8fd38799"
ROUTE_TEXTS = (
    "Header header\ngeometry_msgs/Pose[] waypoints\nbool plan_from_vehicle",
    "Route route\nbool success\nstring message",
    "\n".join(SEPARATOR + text for text in (
        f"std_msgs/Header\n{Header._full_text}",
        f"geometry_msgs/Pose\n{Pose._full_text}",
        "marti_nav_msgs/Route\nHeader header\nRoutePoint[] route_points\n"
        "marti_common_msgs/KeyValue[] properties",
        "marti_nav_msgs/RoutePoint\ngeometry_msgs/Pose pose\nstring id\n"
        "marti_common_msgs/KeyValue[] properties",
        "marti_common_msgs/KeyValue\nstring key\nstring value",
    )),
)  # fmt: skip
