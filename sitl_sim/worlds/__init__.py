"""Where a flight takes place: obstacles, seeded generators, geodesy."""
