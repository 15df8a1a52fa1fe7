"""Sensor models: each has its own random stream and its own presets."""
