"""Rate loops, estimators and batteries around the rigid bodies of `vehicle.py`; compiled."""
