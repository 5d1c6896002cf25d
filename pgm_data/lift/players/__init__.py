"""Skeletons on the court from points in the picture."""
