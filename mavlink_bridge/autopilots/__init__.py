"""How each autopilot is armed, flown and left, and which one is on the line."""
