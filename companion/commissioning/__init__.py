"""Commissioning: what one flight's log tells of the drone: mount, lag, lens, thrust, drag, delay.

Batch estimates over the whole flight; each has a standard deviation, and is refused where the
flight cannot tell it.
"""
