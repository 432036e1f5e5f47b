"""The run folder: truth, world, logs, code version."""
