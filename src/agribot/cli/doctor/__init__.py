"""`agribot doctor`: what is installed, connected, and in order."""
