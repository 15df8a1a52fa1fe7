"""The weed map and the spot treatment that acts on it: pure decisions on messages."""
