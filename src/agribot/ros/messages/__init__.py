"""Our structs as ROS messages and transforms. Import the module that you need."""
