"""Plays ArduCopter's end of the JSON link and of MAVLink, and refuses what its parser refuses.

The rules are those of SIM_JSON.cpp: the last whole line counts; a value stands right behind
`"key":`, a vector is read by sscanf("[%f, %f, %f]"); the clock is the sum of the steps between the
time stamps, from 0, each cut to whole µs; a step of 0.1 s or more is not taken. Its clock and what
it read last are in `seen.json`.
"""

import json
import re
import socket
import struct
import sys
from contextlib import suppress
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

NUMBER = r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
VECTOR = r"\[" + r",\s*".join([NUMBER] * 3)
KEYS = [  # section, key, what is read, whether it is required
    ("", "timestamp", NUMBER, True),
    ("imu", "gyro", VECTOR, True),
    ("imu", "accel_body", VECTOR, True),
    ("", "position", VECTOR, True),
    ("", "attitude", VECTOR, False),
    ("", "quaternion", r"\[" + r",\s*".join([NUMBER] * 4), False),
    ("", "velocity", VECTOR, True),
    ("", "no_time_sync", NUMBER, False),
]


def parse(line):
    """What parse_sensors() reads of a line; None where it would not take the line."""
    out = {}
    for section, key, form, required in KEYS:
        start = line.find(section)
        place = line.find(key, start + len(section) + 1) if start >= 0 else -1
        if place < 0:
            if required:
                return None
            continue
        found = re.match(form, line[place + len(key) + 2 :])
        if found is None:
            return None  # it returns what it has, which lacks the attitude
        out[key] = [float(a) for a in found.groups()]
    return out if "attitude" in out or "quaternion" in out else None


def ticked(clock_us, before, stamp):
    """The clock [µs] after the next time stamp [s]: `uint64_t += double`."""
    step = max(stamp - before, 0.0)
    return int(clock_us + step * 1e6) if step < 0.1 else clock_us


def argument(name):
    return sys.argv[sys.argv.index(name) + 1]


def udp_client(name):
    host, port = argument(name).removeprefix("udpclient:").split(":")
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.connect((host, int(port)))
    s.setblocking(False)
    return s


if __name__ == "__main__":
    motors = json.loads(Path("../motors.json").read_text())
    Path("arguments.json").write_text(json.dumps(sys.argv[1:]))
    port = 9002 + 10 * int(argument("-I"))
    links = [udp_client("--serial0"), udp_client("--serial1")]
    mav = mavlink.MAVLink(None, int(argument("--sysid")), 1)
    mav.robust_parsing = True
    mine = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    mine.settimeout(1.0)
    clock_us, last = 0, 0.0
    frame, refused, buffer, asked = 0, 0, "", set()

    def send(message):
        for link in links:
            with suppress(OSError):
                link.send(message.pack(mav))

    while True:
        pwm = [1000 + round(1000 * m) for m in motors] + [1500] * 12
        packet = struct.pack("<HHI16H", 18458, 1200, frame, *pwm)
        mine.sendto(packet, ("127.0.0.1", port))
        try:
            buffer += mine.recv(65000).decode()
        except TimeoutError:
            continue  # the same packet again
        lines = buffer.split("\n")
        if len(lines) < 3:
            continue
        read, buffer = parse(lines[-2]), "\n" + lines[-1]
        if read is None:
            refused += 1
            Path("refused.json").write_text(json.dumps({"refused": refused}))
            continue
        clock_us, last = ticked(clock_us, last, read["timestamp"][0]), read["timestamp"][0]
        clock = clock_us / 1e6
        frame += 1
        if frame % 20 == 0:
            Path("seen.part").write_text(json.dumps({"clock": clock, **read}))
            Path("seen.part").replace("seen.json")
        for link in links:
            with suppress(OSError):
                for m in mav.parse_buffer(link.recv(4096)) or []:
                    if m.get_type() == "COMMAND_LONG" and m.command == 511:
                        asked.add(int(m.param1))
        if frame % 1000 == 100:
            send(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3))
        if frame % 20 == 0 and 32 in asked:
            send(mavlink.MAVLink_local_position_ned_message(round(clock * 1e3), *[0] * 6))
            send(mavlink.MAVLink_attitude_quaternion_message(round(clock * 1e3), 1, *[0] * 6))
        if frame % 200 == 0 and 1 in asked:
            send(mavlink.MAVLink_sys_status_message(1 << 28, 1 << 28, 1 << 28, *[0] * 10))
