"""Training of the packaged detector: network, data, optimisation. Needs the `train` extra."""
