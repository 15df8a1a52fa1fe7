"""Labelled images: drawn by the simulator, checked and split, whatever their origin."""
