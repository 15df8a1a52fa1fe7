"""Geographic files: fields and plans as other programs read and write them."""
