"""Plays PX4's end of the HIL link and of MAVLink, and refuses what PX4 refuses.

A sensor that gives 100 equal values is stale (DataValidator.cpp), and a vehicle with a stale
sensor is never armed. The first steps get no answer. It answers the first sender of a MAVLink
port. Armed, it commands the motors in `motors.json`.
"""

import json
import os
import select
import socket
import sys
import time
from pathlib import Path

from pymavlink.dialects.v20 import common as mavlink

STALE = 100
GYRO, FORCE = 2000 / 32768 * 3.14159265 / 180, 9.80665 / 2048  # a unit of its FIFO
ARMABLE = 0x10000000
UNANSWERED = 8

n = int(sys.argv[sys.argv.index("-i") + 1])
motors = json.loads(Path("../motors.json").read_text())
told = {k: v for k, v in os.environ.items() if k.startswith("PX4_")}
Path("environment.json").write_text(json.dumps(told))


class Sensor:
    """Counts equal values, as DataValidator does."""

    def __init__(self):
        self.values, self.equal, self.stale = None, 0, False

    def put(self, *values):
        for now, before in zip(values, self.values or (), strict=False):
            self.equal = self.equal + 1 if abs(now - before) < 1e-6 else 0
        self.stale |= self.equal > STALE
        self.values = values


class Port:
    """A UDP port that answers its first sender."""

    def __init__(self, number):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", number))
        self.socket.setblocking(False)
        self.partner = None
        self.mav = mavlink.MAVLink(None, int(os.environ["PX4_PARAM_MAV_SYS_ID"]), 1)
        self.mav.robust_parsing = True

    def send(self, message):
        if self.partner:
            self.socket.sendto(message.pack(self.mav), self.partner)
            self.mav.seq = (self.mav.seq + 1) % 256

    def receive(self):
        try:
            data, sender = self.socket.recvfrom(4096)
        except BlockingIOError:
            return []
        self.partner = self.partner or sender
        return self.mav.parse_buffer(data) or []


ports = [Port(14580 + n), Port(18570 + n)]
while True:
    try:
        line = socket.create_connection(("127.0.0.1", 4560 + n))
        break
    except OSError:
        time.sleep(0.02)
mav = mavlink.MAVLink(None, 1, 1)
mav.robust_parsing = True
sensors = {name: Sensor() for name in ("gyro", "force", "magnetic", "pressure")}
armed, steps, fix, seen = False, 0, None, {}


def armable():
    return steps > 250 and fix is not None and not any(s.stale for s in sensors.values())


def telemetry(now_ms):
    out = [mavlink.MAVLink_attitude_quaternion_message(now_ms, 1, 0, 0, 0, 0, 0, 0)]
    if fix is not None:
        out.append(mavlink.MAVLink_local_position_ned_message(now_ms, 0, 0, 0, 0, 0, 0))
    if steps % 50 == 0:
        health = ARMABLE if armable() else 0
        out.append(mavlink.MAVLink_sys_status_message(ARMABLE, ARMABLE, health, *[0] * 10))
        out.append(mavlink.MAVLink_heartbeat_message(2, 12, 128 * armed, 0x03040000, 3, 3))
    return out


while True:
    for port in ports:
        for m in port.receive():
            if m.get_type() == "COMMAND_LONG" and m.command == 400:
                armed = armable()
                port.send(mavlink.MAVLink_command_ack_message(400, 0 if armed else 1))
    if not select.select([line], [], [], 0.01)[0]:
        continue
    data = line.recv(4096)
    if not data:
        sys.exit("the simulator hung up")
    for m in mav.parse_buffer(data) or []:
        seen[m.get_type()] = m.to_dict()
        if m.get_type() == "HIL_GPS":
            fix = m
        if m.get_type() != "HIL_SENSOR":
            continue
        steps += 1
        sensors["gyro"].put(*[int(a / GYRO) for a in (m.xgyro, m.ygyro, m.zgyro)])
        sensors["force"].put(*[int(a / FORCE) for a in (m.xacc, m.yacc, m.zacc)])
        sensors["magnetic"].put(m.xmag, m.ymag, m.zmag)
        sensors["pressure"].put(m.abs_pressure)
        if steps % 5 == 0:
            for port in ports:
                for message in telemetry(m.time_usec // 1000):
                    port.send(message)
        if steps == 300:
            Path("seen.json").write_text(json.dumps(seen))
        if steps > UNANSWERED:
            controls = motors if armed else [0.0] * 4
            answer = mavlink.MAVLink_hil_actuator_controls_message(
                m.time_usec, controls + [0.0] * 12, 128 * armed, 1
            )
            line.sendall(answer.pack(mav))
