"""The flight log: written, read back, replayed."""
