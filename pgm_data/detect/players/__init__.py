"""The scene's players in the picture: found, told apart, followed."""
