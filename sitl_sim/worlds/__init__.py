"""The world of a flight: obstacles, seeded generators, geodesy."""
