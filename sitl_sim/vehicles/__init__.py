"""Vehicles: rigid bodies, rate loops, estimators, emulated autopilots."""
