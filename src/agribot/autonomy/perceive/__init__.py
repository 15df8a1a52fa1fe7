"""Steps from a camera image to plants on the ground: network, geometry, plants."""
