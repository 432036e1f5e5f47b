"""Emulated autopilots in three flavours: modes, parameters, missions, telemetry streams."""
