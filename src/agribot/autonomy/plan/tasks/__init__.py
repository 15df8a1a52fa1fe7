"""What a mission can work at: crop rows, waypoints, a visit, a field plan."""
