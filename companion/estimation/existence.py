"""Existence: how surely a neighbour or a trunk is there, by the looks that saw it or missed it.

The log of the odds that it exists rises with every look that sees it, by the likelihoods of such a
look with and without it, and falls with every look at its place that does not. This is the target
existence of Musicki, Evans and Stankovic, "Integrated probabilistic data association", IEEE TAC
39(6), 1994, without the change of existence with time.
"""

from __future__ import annotations

import math

from mavlink_bridge.shared.settings import Contradiction


def log_odds(probability: float) -> float:
    """Return the log of the odds of a probability, between 0 and 1."""
    return math.log(probability / (1.0 - probability))


CONFIRMED = log_odds(0.9)  # from here on it counts
SUREST = log_odds(0.999)  # no higher, so that a few misses end what is gone


def check_chances(detected: float, ghosts: float) -> None:
    """Check that a look is likelier where something is than where nothing is.

    Raises:
        Contradiction: it is not.
    """
    if not ghosts < detected:
        text = f"ghosts, {ghosts:g}, must be below detected, {detected:g}"
        raise Contradiction(("ghosts", "detected"), text)
