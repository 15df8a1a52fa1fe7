"""Conversion of our structs to ROS messages and transforms, and of sensor messages to structs."""
