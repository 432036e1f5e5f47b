"""The daemon around the pipeline: sockets, frames, clock, supervisor, journal."""
