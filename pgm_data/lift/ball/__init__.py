"""The ball in metres from its track in the picture: `world` is what it flies in, `solution` is what comes back."""
