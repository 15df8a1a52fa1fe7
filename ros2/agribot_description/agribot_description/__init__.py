"""Launch files, RViz view and description of AGRIBOT for ROS 2."""
