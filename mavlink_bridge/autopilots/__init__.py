"""Requests to each kind of autopilot, and a check of which kind is on the line."""
