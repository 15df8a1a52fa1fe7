"""Labelled images: drawn by the simulator, checked and split, whoever made them."""
