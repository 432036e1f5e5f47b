"""The daemon around the pipeline: sockets, frames, clock, service manager, journal."""
