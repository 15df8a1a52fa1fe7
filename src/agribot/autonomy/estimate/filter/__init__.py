"""The Kalman filter, the motion behind it, and the geometry that sensors share."""
