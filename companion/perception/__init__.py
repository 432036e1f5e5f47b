"""Perception: neighbours, trunks and other surfaces in one frame, in the camera's axes."""
