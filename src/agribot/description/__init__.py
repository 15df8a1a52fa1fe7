"""Reading and writing robot (xacro, URDF) and world (SDF) files, and the packaged ones."""
