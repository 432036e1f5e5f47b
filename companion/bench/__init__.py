"""How fast and how good the solver and perception are."""
