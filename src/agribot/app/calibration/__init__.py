"""What driving a figure tells of the robot, and how it gets into the robot's own settings."""
