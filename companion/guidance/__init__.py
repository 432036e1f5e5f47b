"""Where to fly, how fast, and where to look."""
