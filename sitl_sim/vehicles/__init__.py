"""Vehicles: rigid bodies, rate loops, estimators, emulated and real autopilots."""
