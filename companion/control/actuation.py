"""Actuation: the guarded command as a setpoint, remembered as the input in flight.

Body rates count for as long as the delay of the chain is in doubt before their effect is seen. So
they are limited until the delay is known: a wrong delay then costs a small swing, by which the
delay is learnt, where the full rates would tumble the drone.
"""

from __future__ import annotations

import numpy as np

from companion.estimation.delay import Delay, within_doubt
from companion.estimation.input_history import SentInput
from companion.estimation.motion import MotionEstimator
from mavlink_bridge.shared.thrust import ThrustMap
from mavlink_bridge.wire.messages import RateCommand, RateSetpoint


class Actuation:
    """Turns commands into SET_ATTITUDE_TARGET for one vehicle."""

    def __init__(self, system_id: int, motion: MotionEstimator) -> None:
        """motion: told of each input that is sent."""
        self._system_id = system_id
        self._motion = motion

    def setpoint(
        self,
        time: float,
        command: RateCommand | None,
        thrust_map: ThrustMap,
        delay: Delay,
        in_control: bool,
    ) -> RateSetpoint | None:
        """Return the setpoint of the tick of `time` [s]; None where there is no command.

        delay: from a tick to its effect; what is not known of it limits the rates. in_control:
        whether the vehicle follows the setpoints. Where it does not, what was sent is not what
        flies, and the inputs are forgotten.
        """
        setpoint = None
        if command is not None:
            thrust = thrust_map.to_thrust(command.c)
            omega = within_doubt(command.omega, delay)
            setpoint = RateSetpoint(time, omega, thrust, self._system_id)
            u = np.array([command.c, *omega])
            self._motion.sent(SentInput(time, u, thrust))
        if not in_control:
            self._motion.clear()
        return setpoint
