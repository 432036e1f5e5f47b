"""What passes between the world and a vehicle's companion and ground stations, and when.

Telemetry, pictures and replies go out, answers, commands and requests come in, each at its own
millisecond of the vehicle's clock and always in the same order.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor, Future

from mavlink_bridge.shared.arrays import Vector
from mavlink_bridge.wire.link import Link
from mavlink_bridge.wire.messages import Received
from mavlink_bridge.wire.video import Frame
from sitl_sim.external.fleet import RealFleet
from sitl_sim.external.lockstep_fleet import LockstepFleet
from sitl_sim.faults.catalogue import Schedule
from sitl_sim.flight.delays import Delays
from sitl_sim.flight.sensors import Capture
from sitl_sim.flight.vehicle_connection import VehicleConnection
from sitl_sim.scenarios.scenario import QUANTUM_MS, TICK_MS, Scenario
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles

TELEMETRY_MS = 20

Look = Callable[[VehicleConnection, float, float, Vector, Vector], Capture]
"""Renders a frame: vehicle, flight time [s], stamp [s, its clock], p (n,3) m and q (n,4) of all."""


class Exchange:
    """Passes on, for each vehicle, what is due at an instant.

    Each `drone` is a vehicle of the flight, each `now` the ms since the flight began. In lockstep
    the exchange waits for the answer that is due; in real time it waits for nobody.
    """

    def __init__(
        self,
        scenario: Scenario,
        schedule: Schedule,
        vehicles: Vehicles,
        autopilots: Autopilots | RealFleet | LockstepFleet,
        delays: Delays,
        look: Look,
        pools: tuple[Executor, Executor],
        real_time: bool,
    ) -> None:
        """Take the parts of a flight; pools: what calls `look`, and what delivers its frames."""
        self._schedule = schedule
        self._vehicles, self._autopilots = vehicles, autopilots
        self._delays = delays
        self._look = look
        self._captures, self._deliveries = pools
        self._real_time = real_time
        self._latency_ms = round(scenario.sensing.latency * 1e3 / QUANTUM_MS) * QUANTUM_MS
        self._answer_timeout = scenario.timing.answer_timeout

    def instant(self, drone: VehicleConnection, now: int) -> None:
        """Pass on all that is due at this very millisecond, always in the same order."""
        drone.line.now = now / 1e3
        if drone.due_ms is not None and drone.due_ms <= now:
            self._take_answer(drone, now)
        self._hand_over(drone, now)
        if self._real_time:
            self.deliver(drone, drone.companion, now)
        boot = now + drone.boot_ms
        if boot % TELEMETRY_MS == 0:
            self.deliver(drone, drone.ground, now)
            self._send_telemetry(drone, now)
        if (boot + self._latency_ms) % TICK_MS == 0:
            self._start_capture(drone, now)
        if boot % TICK_MS == 0:
            self._send_frame(drone, now)

    def next_event(self, drone: VehicleConnection, now: int) -> int:
        """Return the next millisecond at which anything is due."""
        real = isinstance(self._autopilots, RealFleet)  # they send their telemetry themselves
        boot = now + drone.boot_ms
        period = TICK_MS if real else TELEMETRY_MS
        following = min(
            now + period - boot % period,
            now + TICK_MS - (boot + self._latency_ms) % TICK_MS,
        )
        if drone.due_ms is not None and not real:
            following = min(following, max(drone.due_ms, now + QUANTUM_MS))
        if drone.held:
            following = min(following, max(drone.held[0][0], now + QUANTUM_MS))
        return following

    def deliver(self, drone: VehicleConnection, link: Link, now: int) -> None:
        """Give the vehicle what waits on a link; send its replies at once."""
        relayed = isinstance(self._autopilots, LockstepFleet)  # it gets the packets as they are
        for received in link.receive_packets() if relayed else link.receive():
            if link is drone.companion and drone.hold_ms:
                drone.held.append((now + drone.hold_ms, received))
            else:
                self._give(drone, link, received)

    def close(self) -> None:
        """Cancel the frames that are not yet begun, and wait for the others."""
        for pool in (self._captures, self._deliveries):
            pool.shutdown(wait=True, cancel_futures=True)

    def _send_telemetry(self, drone: VehicleConnection, now: int) -> None:
        """Send the telemetry that is due on both links."""
        if isinstance(self._autopilots, LockstepFleet):
            drone.relay_telemetry(self._autopilots)
            return
        if drone.signing is not None:
            drone.signing.advance()
        messages = self._autopilots.telemetry(drone.index, "companion")
        drone.companion.send(drone.telemetry.alter(now / 1e3, messages))
        unheard = not drone.ground.packets_in
        drone.ground.send(self._autopilots.telemetry(drone.index, "gcs", quiet=unheard))

    def _hand_over(self, drone: VehicleConnection, now: int) -> None:
        """Give the vehicle the messages whose way to it has taken long enough."""
        while drone.held and drone.held[0][0] <= now:
            self._give(drone, drone.companion, drone.held.popleft()[1])

    def _give(self, drone: VehicleConnection, link: Link, received: Received | bytes) -> None:
        """Give the vehicle a message, or a packet, of a link."""
        name = "companion" if link is drone.companion else "gcs"
        if isinstance(received, bytes):
            assert isinstance(self._autopilots, LockstepFleet)
            self._autopilots.pass_on(drone.index, name, received)
        else:
            assert not isinstance(self._autopilots, LockstepFleet)
            link.send(self._autopilots.receive(drone.index, received, name))

    def _start_capture(self, drone: VehicleConnection, now: int) -> None:
        """Start to render what the drone's sensors see at this instant."""
        if not drone.frames.connected:
            drone.companion_lost |= drone.process is not None
            return
        if drone.delivery is not None and not drone.delivery.done() and self._real_time:
            return  # the last frame is still under way: this one is dropped
        stamp = (now + drone.boot_ms) / 1e3
        p, q = self._vehicles.p.copy(), self._vehicles.q.copy()
        drone.capture = self._captures.submit(self._look, drone, now / 1e3, stamp, p, q)

    def _send_frame(self, drone: VehicleConnection, now: int) -> None:
        """Deliver the frame that was captured for this instant; its tick falls due."""
        if drone.capture is None or drone.due_ms is not None:
            return  # none was captured, or the companion is still busy with the last one
        stamp = (now + drone.boot_ms) / 1e3
        packets = drone.companion.packets_out
        drone.delivery = self._deliveries.submit(
            self._deliver_frame, drone, drone.capture, packets, stamp
        )
        drone.capture = None
        paused = sum(f.value for f in self._schedule.at(drone.index, now / 1e3, "pause"))
        computing, on_its_way = self._delays.draw(drone.index)
        drone.due_ms = now + round(computing + paused * 1e3)
        drone.hold_ms = 0 if self._real_time else on_its_way

    @staticmethod
    def _deliver_frame(
        drone: VehicleConnection, capture: Future[Capture], packets: int, due: float
    ) -> bool:
        taken, arrays = capture.result()
        return drone.frames.send(Frame(taken, arrays, packets, due=due))

    def _take_answer(self, drone: VehicleConnection, now: int) -> None:
        """Wait for the answer that is due and let the companion's messages take effect."""
        drone.due_ms = None
        if self._real_time:
            while (late := drone.frames.answer(0.0)) is not None:
                drone.landed |= late.done
            return
        if drone.delivery is None or not drone.delivery.result():
            drone.drop_companion()
            return
        deadline = time.monotonic() + self._answer_timeout  # without rendering
        while True:
            answer = drone.frames.answer(0.2)
            if answer is not None:
                break
            if drone.silent(deadline):
                drone.drop_companion()
                return
        drone.landed |= answer.done
        while drone.companion.packets_in < answer.packets and time.monotonic() < deadline:
            self.deliver(drone, drone.companion, now)
            if drone.companion.packets_in < answer.packets:
                drone.companion.wait(0.05)
        self.deliver(drone, drone.companion, now)
