"""How long tests of real processes wait for what must come, however busy the machine is.

What must come by a time is measured in processor time, or in the time of a simulated flight.
"""

PATIENCE = 90.0  # s
