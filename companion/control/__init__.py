"""Control: the NMPC, the controllers that it is compared with, and the setpoint."""
