"""Training of the crop/weed network: the only package that imports torch."""
