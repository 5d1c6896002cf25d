"""The ball in the picture: found in each frame, linked over time, its contacts told from its track."""
