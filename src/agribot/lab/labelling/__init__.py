"""Labelling photographs by hand: what the page of `agribot label` works on."""
