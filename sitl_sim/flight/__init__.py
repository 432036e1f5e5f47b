"""One flight: the world, its vehicles and their companions."""
