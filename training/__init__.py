"""How the packaged detector came about: network, data, training. Needs the `train` extra."""
