"""A flight in the browser, replayed from its run folder or live."""

from sitl_sim.viewer.page import Page
from sitl_sim.viewer.sources import Live, Replay

__all__ = ["Live", "Page", "Replay"]
