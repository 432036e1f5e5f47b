"""Step responses of the rate loop: emulated vehicle and real Betaflight on the same physics.

A vehicle hovers in place (position and velocity are held, rotation is free), and one body rate
is commanded for a while. Rise time is from 10 to 90 % of the step, overshoot is the excess over
it, both of the median of several steps. Run as a program, this module draws them:
`python tests/wire/step_response.py PAGE.html`.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from mavlink_bridge.betaflight import msp
from mavlink_bridge.betaflight.controller import Controller
from mavlink_bridge.betaflight.process import MspLine, open_controller, wait_for_controller
from mavlink_bridge.wire.messages import Command, RateSetpoint, Received, Source
from sitl_sim.external.betaflight_sitl import BetaflightError, BetaflightSitl
from sitl_sim.external.namespace import Host
from sitl_sim.external.priority import PHYSICS, raise_priority, reset_priority
from sitl_sim.figures.page import draw, page
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles
from sitl_sim.vehicles.sensor_noise import SensorNoise
from sitl_sim.worlds.geodesy import GeoReference, LocalFrame

Floats = NDArray[np.float64]

AXES = ("roll", "pitch", "yaw")
STEPS_DEG = (40.0, 80.0, 200.0)
BEFORE, AFTER = 0.1, 0.4  # s of a recording around the step
PERIOD = 0.002  # s between samples
_SETTLE = 0.6  # s between steps
_RC_PERIOD = 0.01
_GAP_MAX = 0.012  # s
_TRIES = 30
_TURNING = 0.3  # of full speed
HOVER_THROTTLE = 0.575


@dataclass(frozen=True)
class Response:
    """Response of one axis: times (k,) s from the step, rate (k,) rad/s, commanded rate."""

    axis: str
    asked: float
    t: Floats
    rate: Floats

    @property
    def rise_time(self) -> float:
        """Time from 10 to 90 % of the step [s]."""
        return self._crossing(0.9) - self._crossing(0.1)

    @property
    def delay(self) -> float:
        """Time from the step to half of it [s]."""
        return self._crossing(0.5)

    @property
    def overshoot(self) -> float:
        """Excess over the step, as a share of it."""
        return max(float(self.rate.max()) / self.asked - 1.0, 0.0)

    def _crossing(self, share: float) -> float:
        level = share * self.asked
        above = np.flatnonzero(self.rate >= level)
        if not len(above) or above[0] == 0:
            return math.nan
        k = above[0]
        a, b = self.rate[k - 1], self.rate[k]
        return float(self.t[k - 1] + (level - a) / (b - a) * (self.t[k] - self.t[k - 1]))


def typical(responses: list[Response]) -> Response:
    """Return the median of responses to one step, point by point, aligned at half their rise.

    The delay from sending to arrival depends on the machine's load: the alignment removes it.
    """
    first = responses[0]
    delay = float(np.median([r.delay for r in responses]))
    moved = [np.interp(r.t + r.delay - delay, r.t, r.rate) for r in responses]
    return Response(first.axis, first.asked, first.t, np.median(np.array(moved), axis=0))


def hold_in_place(vehicles: Vehicles, level: bool) -> None:
    """Reset position and velocity; `level`: the attitude, too."""
    s = vehicles.state
    s.p[:], s.v[:] = [0.0, 0.0, 10.0], 0.0
    s.contact[:] = False
    if level:
        s.q[:] = [1.0, 0.0, 0.0, 0.0]


def omega_of(axis: str, rate_deg: float) -> Floats:
    """Return body rates (3,) rad/s with one axis turning."""
    omega = np.zeros(3)
    omega[AXES.index(axis)] = math.radians(rate_deg)
    return omega


def emulated(axis: str, rate_deg: float) -> Response:
    """Return the emulated vehicle's response, in simulated time."""
    vehicles = Vehicles(Airframe(), [[0.0, 0.0, 0.0]], 0.0)
    autopilots = Autopilots(vehicles, [1], "px4", noise=SensorNoise.none())
    companion = Source(1, 191)
    hover = Airframe().hover_thrust

    def ask(omega: Floats) -> None:
        autopilots.receive(0, Received(companion, RateSetpoint(0.0, omega, hover, 1)))

    def fly(seconds: float, omega: Floats) -> list[float]:
        out = []
        for k in range(round(seconds / PERIOD)):
            if k % 5 == 0:
                ask(omega)
            hold_in_place(vehicles, not omega.any())
            autopilots.advance(autopilots.t + PERIOD)
            out.append(float(vehicles.omega[0, AXES.index(axis)]))
        return out

    ask(np.zeros(3))
    for command, first in ((400, 1.0), (176, 1.0)):
        params = (first, 6.0 if command == 176 else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        fly(0.1, np.zeros(3))
        autopilots.receive(0, Received(companion, Command(command, params, 1)))
    fly(1.5, np.zeros(3))
    rate = fly(BEFORE, np.zeros(3)) + fly(AFTER, omega_of(axis, rate_deg))
    t = np.array([PERIOD * (k + 1) - BEFORE for k in range(len(rate))])
    return Response(axis, math.radians(rate_deg), t, np.array(rate))


class RealRates:
    """A real Betaflight held in place: commands rates, records its response."""

    def __init__(self, folder: Path, settings: list[str]) -> None:
        raise_priority(PHYSICS)
        self._vehicles = Vehicles(Airframe(), [[0.0, 0.0, 0.0]], 0.0)
        self._sitl = BetaflightSitl(folder, Host(), settings)
        self._frame = LocalFrame(np.zeros(3), 0.0, GeoReference())
        self._line = open_controller(f"tcp:127.0.0.1:{self._sitl.msp_port}")
        self._last = time.monotonic()
        self._rc_at = self._gap = 0.0  # longest time between two exchanges
        self._controller = self._meet()
        self._run(7.0, np.zeros(3), 0.0, armed=False)
        self._run(1.0, np.zeros(3), 0.0)
        self._run(1.5, np.zeros(3), HOVER_THROTTLE, held=True)
        if not (self._sitl.command > _TURNING).all():
            self.close()
            raise BetaflightError("Betaflight does not arm: the machine is too busy")

    def _meet(self) -> Controller:
        return wait_for_controller(MspLine(self._line.stream))

    def steps(self, axis: str, rate_deg: float, count: int = 5) -> list[Response]:
        """Return steps during which neither this process nor Betaflight was delayed.

        Raises:
            BetaflightError: the machine is too busy for undisturbed steps.
        """
        good: list[Response] = []
        for _ in range(_TRIES):
            response = self._step(axis, rate_deg)
            before = response.rate[response.t < 0.0]
            at_rest = float(np.abs(before).max()) < 0.1 * response.asked
            if self._gap < _GAP_MAX and at_rest and math.isfinite(response.delay):
                good.append(response)
            if len(good) == count:
                return good
        raise BetaflightError(f"{len(good)} of {count} steps undisturbed: the machine is too busy")

    def _step(self, axis: str, rate_deg: float) -> Response:
        """Record one step, which begins when it is sent."""
        self._run(_SETTLE, np.zeros(3), HOVER_THROTTLE, held=True)
        omega = omega_of(axis, rate_deg)
        samples: list[tuple[float, Floats]] = []
        self._run(BEFORE, np.zeros(3), HOVER_THROTTLE, held=True, note=samples.append)
        begun = time.monotonic()
        self._rc_at = self._gap = 0.0
        self._run(AFTER, omega, HOVER_THROTTLE, held=True, turning=True, note=samples.append)
        k = AXES.index(axis)
        t = np.array([when - begun for when, _ in samples])
        rate = np.array([o[k] for _, o in samples])
        steps = round((BEFORE + AFTER) / PERIOD)
        grid = np.array([PERIOD * (n + 1) - BEFORE for n in range(steps)])
        return Response(axis, math.radians(rate_deg), grid, np.interp(grid, t, rate))

    def close(self) -> None:
        """End the process."""
        self._line.stream.close()
        self._sitl.close()
        reset_priority()

    def _run(
        self,
        seconds: float,
        omega: Floats,
        throttle: float,
        *,
        armed: bool = True,
        held: bool = False,
        turning: bool = False,
        note: Callable[[tuple[float, Floats]], None] = lambda sample: None,
    ) -> None:
        end = time.monotonic() + seconds
        sticks = np.array(self._controller.rate_sticks(omega))
        frame = msp.raw_rc(self._controller.channels(sticks, throttle, armed, False))
        before = time.monotonic()
        while (now := time.monotonic()) < end:
            self._gap, before = max(self._gap, now - before), now
            if now - self._rc_at >= _RC_PERIOD:
                self._rc_at = now
                self._line.stream.send(frame)
                for _ in self._line.stream.receive():
                    pass
            command = self._sitl.exchange(0, self._vehicles.state, self._frame)
            count = int((now - self._last) / 0.001)
            if count:
                self._last += count * 0.001
                self._vehicles.step(count * 0.001, command[None], 0.0, count)
            if held:
                hold_in_place(self._vehicles, not turning)
            note((now, self._vehicles.omega[0].copy()))
            time.sleep(PERIOD / 2)


@dataclass(frozen=True)
class Pair:
    """Responses of the emulated vehicle and of a real Betaflight to one step."""

    ours: Response
    real: Response

    @property
    def text(self) -> str:
        """Row of a table: axis, step, rise times, overshoots."""
        o, r = self.ours, self.real
        return (
            f"| {o.axis} | {math.degrees(o.asked):.0f} | {1e3 * r.rise_time:.0f} | "
            f"{1e3 * o.rise_time:.0f} | {100 * r.overshoot:.1f} | {100 * o.overshoot:.1f} |"
        )


def compare(folder: Path, count: int) -> Iterator[Pair]:
    """Yield every axis and step; real responses are medians of `count`."""
    real = RealRates(folder, [])
    try:
        for axis in AXES:
            for rate in STEPS_DEG:
                yield Pair(emulated(axis, rate), typical(real.steps(axis, rate, count)))
    finally:
        real.close()


def plot(pairs: list[Pair]) -> str:
    """Return a page with a row for each axis and a column for each step."""
    titles = [f"{p.ours.axis}, {math.degrees(p.ours.asked):.0f} °/s" for p in pairs]
    figure = make_subplots(rows=len(AXES), cols=len(STEPS_DEG), subplot_titles=titles)
    for n, pair in enumerate(pairs):
        # Half rise against half rise: transport to the real one is not the rate loop's.
        moved = pair.real.t - pair.real.delay + pair.ours.delay
        for name, r, t, colour in (
            ("Betaflight 4.6.0", pair.real, moved, "#d62728"),
            ("emulated", pair.ours, pair.ours.t, "#1f77b4"),
        ):
            figure.add_scatter(
                x=1e3 * t,
                y=np.degrees(r.rate),
                name=name,
                line_color=colour,
                showlegend=not n,
                row=n // len(STEPS_DEG) + 1,
                col=n % len(STEPS_DEG) + 1,
            )
    figure.update_xaxes(range=[-50, 250])
    figure.update_layout(width=1000, height=720, margin={"l": 40, "r": 10, "t": 40, "b": 30})
    return page("Step responses, °/s over ms", "", [("Rate loops", draw(figure))])


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        found = list(compare(Path(place), count=5))
    print("\n".join(p.text for p in found))
    Path(sys.argv[1]).write_text(plot(found), encoding="utf-8")
