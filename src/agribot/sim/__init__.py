"""The simulator: physics, sensors, camera and the platform that the stack drives."""
