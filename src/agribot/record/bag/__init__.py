"""Other people's recordings: ROS 1 bags, rosbag2 databases and MCAP, in and out."""
