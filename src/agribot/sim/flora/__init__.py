"""Procedural plants: species, leaf meshes and leaf textures."""
