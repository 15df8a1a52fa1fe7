"""ROS 2 on DDS, the middleware of most installations, over the cyclonedds wheel."""
