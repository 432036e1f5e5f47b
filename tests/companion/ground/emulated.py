"""Emulated vehicles and their companions' services, on lines of bytes; no solver."""

import numpy as np

from companion.ground.station import Station
from companion.services.services import Services, Situation
from companion.settings.config import CompanionConfig
from companion.types import Phase
from mavlink_bridge.wire.codec import Codec
from mavlink_bridge.wire.memory import MemoryEndpoint
from mavlink_bridge.wire.messages import Source
from mavlink_bridge.wire.signing import Signing, timestamp_at
from sitl_sim.vehicles.airframe import Airframe
from sitl_sim.vehicles.emulated import Autopilots
from sitl_sim.vehicles.rigid_body import Vehicles

SIGNED_AT = timestamp_at(1.7e9)


def config(i=1, **link):
    return CompanionConfig.model_validate(
        {
            "name": f"drone{i}",
            "link": {"system_id": i, "endpoint": f"udpin:127.0.0.1:{24000 + i}", **link},
            "mission": {"goals": [[5.0, 0.0, 2.0]]},
        }
    )


def signing(key):
    return None if key is None else Signing(key, SIGNED_AT)


class Emulated:
    """A fleet and its station; `step` lets the world go on. Those in `cut` are out of reach."""

    def __init__(self, count, key=None, station_key="as the vehicles"):
        self.count, self.now, self.cut = count, 0.0, set()
        start = np.array([[6.0 * k, 0.0, 0.0] for k in range(count)])
        ids = range(1, count + 1)
        self.vehicles = Autopilots(Vehicles(Airframe(), start, 0.0), ids, origin=start)
        self.here, there = MemoryEndpoint(), None
        there = MemoryEndpoint(self.here)
        self.configs = [config(i) for i in ids]
        own = key if station_key == "as the vehicles" else station_key
        self.station = Station(self.configs, there, 254, signing(own))
        self.codecs = [
            (Codec(i, 1, signing=signing(key)), Codec(i, 191, signing=signing(key))) for i in ids
        ]
        self.companions = [
            Services(Source(i, 191), c.camera, c.fence, [], frozenset())
            for i, c in zip(ids, self.configs, strict=True)
        ]
        self.situations = [Situation(Phase.WAIT)] * count

    def step(self, dt=0.02):
        """Let the world go on, and the station hear and answer it."""
        self.now = round(self.now + dt, 3)
        self.vehicles.advance(self.now)
        for data in self.here.receive():
            for r in self.codecs[0][0].decode_datagram(data):
                self.ask(r)
        for i in range(self.count):
            vehicle, companion = self.codecs[i]
            self.say(i, vehicle.encode(self.vehicles.telemetry(i, "gcs")))
            served = self.companions[i].update(self.now, [], self.situations[i])
            self.say(i, companion.encode(served.messages))
        self.station.step(self.now)

    def ask(self, r):
        for i in range(self.count):
            if i not in self.cut:
                self.say(i, self.codecs[i][0].encode(self.vehicles.receive(i, r, "gcs")))

    def say(self, i, data):
        if i not in self.cut:
            self.here.send(data)
