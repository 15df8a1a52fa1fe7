"""A whole run: platform, stack and all that listens to them."""
