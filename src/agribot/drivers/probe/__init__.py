"""What is connected: devices found by their names and by their bytes."""
