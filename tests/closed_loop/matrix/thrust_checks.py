"""Rows of the fault matrix about the thrust, as in `checks`."""

import numpy as np

from companion.types import Phase
from tests.closed_loop.matrix.inprocess import AUTOPILOT, fly

_HOVER = 0.333  # of the simulated airframe
_PARAMETERS = {
    "px4": {"MPC_THR_HOVER": 0.5} | AUTOPILOT,  # nobody has set the hover thrust
    "ardupilot": {"MOT_THST_HOVER": 0.4, "GUID_OPTIONS": 8},
}


def dip_at_takeover(flavour, true, configured, parameter=None, **more):
    """Take off, take over, hold for 5 s; return the m that the drone falls below its place."""
    parameters = dict(_PARAMETERS[flavour])
    if parameter is not None:
        parameters[next(iter(parameters))] = parameter
    f = fly(
        [{"kind": "thrust_scale", "amount": _HOVER / true}],
        world={},
        drones__autopilot=flavour,
        drones__parameters=parameters,
        mission__targets=[[0.0, 0.0, 2.0]],
        mission__time_limit=13.0,
        companion={
            "gaze": {"survey": 0.0},
            "mission": {"land": False},
            "airframe": {"hover_thrust": configured},
        },
        **more,
    )
    c, truth = f.companions[0], f.truth.arrays()
    # Setpoints may fly the vehicle a second before its HEARTBEAT tells that they do.
    streams = next(at for at, o in c.ticks(0.0) if o.phase is Phase.ENGAGE)
    taken = next(at for at, o in c.ticks(0.0) if o.phase is Phase.FLY)
    assert taken < 8.0
    flown = (truth["t"] > streams - 0.1) & (truth["t"] < taken + 5.0)
    z = truth["position"][flown, 0, 2]
    learnt = c.companion._motion._hover_thrust.estimate
    assert abs(learnt.map.hover_thrust / true - 1.0) < 0.1, learnt
    return float(min(z[0], 2.0) - z.min())


def row_36(note):
    """The hover thrust is far from the configured one and from the autopilot's parameter."""
    for flavour, true, configured, parameter, wind in (
        ("px4", 0.2, 0.7, 0.25, 0.0),
        ("px4", 0.7, 0.2, 0.6, 5.0),
        ("ardupilot", 0.57, 0.33, 0.5, 5.0),
    ):
        dip = dip_at_takeover(flavour, true, configured, parameter, wind=[wind, 0.0, 0.0])
        assert dip <= 0.15, (flavour, true, configured, dip)
        note(f"dip [m], {flavour}, {true:g} for {configured:g}", dip)


def row_36_in_flight(note):
    """A quarter of the thrust is lost in flight."""
    weaker = {"kind": "thrust_scale", "amount": 0.75, "at": 8.0}
    f = fly(
        [weaker],
        world={},
        mission__targets=[[0.0, 0.0, 2.0]],
        mission__time_limit=13.0,
        companion={"gaze": {"survey": 0.0}, "mission": {"land": False}},
    )
    truth = f.truth.arrays()
    z = truth["position"][truth["t"] > 8.0, 0, 2]
    assert z.min() > 1.7
    assert np.abs(z[-50:] - 2.0).max() < 0.1  # the last second
    note("falls by [m], thrust × 0.75", 2.0 - z.min())
