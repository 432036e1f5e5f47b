"""The drone's model, the NMPC, and the controllers that it is compared with."""
