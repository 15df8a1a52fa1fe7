"""Ways out of the robot for other people's tools, and ways in. Import the module that you need."""
