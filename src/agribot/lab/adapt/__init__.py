"""A network learns a field from its rows: pictures in, weights out, no label by hand."""
