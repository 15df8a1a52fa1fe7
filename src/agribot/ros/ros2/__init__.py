"""ROS 2 without ROS: the wire format of rmw_zenoh over the eclipse-zenoh wheel."""
