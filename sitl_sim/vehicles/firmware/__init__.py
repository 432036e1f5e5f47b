"""Emulated autopilots: modes, parameters, missions, telemetry streams, in three flavours."""
