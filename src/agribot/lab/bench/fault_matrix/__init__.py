"""Every fault in every state of the robot, each by a course in time, and pairs of faults."""
