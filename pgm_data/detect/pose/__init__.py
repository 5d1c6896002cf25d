"""Points of a body in the picture of one person."""
