"""AGRIBOT: an autonomous field robot that weeds, in simulation and on real hardware."""

__version__ = "0.1.0"
