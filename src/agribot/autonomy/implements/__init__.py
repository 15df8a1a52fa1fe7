"""What an implement does and when, decided from the pose and the plants around it."""
