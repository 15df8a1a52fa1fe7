"""ROS 1 without ROS: the slave API over XML-RPC and TCPROS in plain Python."""
