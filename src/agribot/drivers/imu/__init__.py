"""IMU boards and the IMUs of motor boards."""
