"""State estimation: where the robot is, how well that is known, and why not when it is not."""
