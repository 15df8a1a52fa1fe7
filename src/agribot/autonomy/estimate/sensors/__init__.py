"""The sensors that correct the pose, and the noise of each."""
