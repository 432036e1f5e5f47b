"""A Betaflight that answers MSP as the real one does, without flying."""

import struct

from mavlink_bridge.betaflight.msp import Msp, Reply

BOXES = [0, 1, 50]  # ARM, ANGLE, MSP OVERRIDE
RX_MSP = 1 << 14


class FakeController:
    """Answers by command; tests change its attributes to change its setup."""

    def __init__(self, only_receiver=True):
        self.variant = b"BTFL"
        self.api, self.version = ((1, 47), (4, 6, 0)) if only_receiver else ((1, 48), (26, 6, 0))
        self.features = RX_MSP if only_receiver else 0
        self.ranges = [(0, 0, 32, 48), (1, 1, 32, 48)] + (
            [] if only_receiver else [(50, 2, 32, 48)]
        )
        self.rates = (40, 0, 40, 40, 40, 3)  # rc_rate, expo, three srates, ACTUAL
        self.boxes = BOXES
        self.armed, self.override, self.reasons = False, False, 0
        self.attitude = (0, 0, 90)  # decidegrees, decidegrees, degrees
        self.gyro = (0, 0, 0)
        self.gps = True  # has a fix
        self.gps_place = (47.4, 8.5)  # °, latitude and longitude
        self.altitude = 0
        self.throttle = 1000  # µs, as its receiver has it

    def answer(self, command):
        """Return the payload of one command."""
        rc_rate, expo, *srates, kind = self.rates
        rates = bytes([rc_rate, expo, *srates, 0, 50, 0, 0, 0])
        rates += bytes([expo, rc_rate, rc_rate, expo, 0, 100])
        head = (125, 0, 0, self.armed | self.override << 2, 0, 10, 4, 0, 0, 29)
        where = [round(degrees * 1e7) for degrees in self.gps_place]
        return {
            Msp.API_VERSION: bytes([0, *self.api]),
            Msp.FC_VARIANT: self.variant,
            Msp.FC_VERSION: bytes(self.version),
            Msp.FEATURE_CONFIG: struct.pack("<I", self.features),
            Msp.RX_MAP: bytes([0, 1, 3, 2, 4, 5, 6, 7]),
            Msp.BOXIDS: bytes(self.boxes),
            Msp.MODE_RANGES: b"".join(bytes(r) for r in [*self.ranges, (0, 0, 0, 0)]),
            Msp.RC_TUNING: rates + struct.pack("<3H", *[1998] * 3) + bytes([kind, 50]),
            Msp.ATTITUDE: struct.pack("<3h", *self.attitude),
            Msp.RAW_IMU: struct.pack("<9h", 0, 0, 256, *self.gyro, 0, 0, 0),
            Msp.RC: struct.pack("<6H", 1500, 1500, 1500, self.throttle, 1000, 1000),
            Msp.ALTITUDE: struct.pack("<ih", self.altitude, 0),
            Msp.RAW_GPS: struct.pack("<BBiihHHH", self.gps, 12, *where, 488, 0, 0, 10),
            Msp.STATUS_EX: struct.pack("<3HIBHBBBBI", *head, self.reasons) + bytes(3),
            Msp.ANALOG: struct.pack("<BHHhH", 168, 0, 0, 150, 1680),
        }[command]

    def several(self, commands):
        """Return the answer to a request for several commands."""
        parts = [self.answer(c) for c in commands]
        return Reply(Msp.MULTIPLE_MSP, b"".join(bytes([len(p)]) + p for p in parts))
