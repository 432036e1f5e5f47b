"""A stalled machine must not look like a silent client."""

import signal
import threading
import time

from pymavlink import mavutil  # noqa: TID251 - as most clients
from pymavlink.dialects.v20 import common as m

from tests.wire.served import served

OFFBOARD = 6  # PX4's main mode


class Client:
    """Requests offboard and streams level setpoints at 20 Hz, as MAVSDK does."""

    def __init__(self, port):
        self._line = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=245)
        self._line.wait_heartbeat(timeout=30)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._stream)
        self._thread.start()

    def _stream(self):
        while not self._ended.wait(0.05):
            self._line.mav.set_attitude_target_send(
                0, 1, 1, m.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE, [1, 0, 0, 0], 0, 0, 0, 0.35
            )

    def command(self, number, *values):
        self._line.mav.command_long_send(1, 1, number, 0, *values, *[0] * (7 - len(values)))

    def modes(self, seconds):
        """Return PX4's main mode and whether armed, of each heartbeat of some seconds."""
        end, seen = time.monotonic() + seconds, []
        while (left := end - time.monotonic()) > 0:
            beat = self._line.recv_match(type="HEARTBEAT", blocking=True, timeout=left)
            if beat is not None:
                armed = bool(beat.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED)
                seen.append((beat.custom_mode >> 16 & 0xFF, armed))
        return seen

    def close(self):
        self._ended.set()
        self._thread.join()
        self._line.close()


def test_setpoints_during_a_stall_count_when_it_ends():
    with served("px4") as world:
        client = Client(world.companion + 1)
        try:
            end = time.monotonic() + 60
            while client.modes(1.5)[-1:] != [(OFFBOARD, True)]:
                assert time.monotonic() < end
                client.command(m.MAV_CMD_DO_SET_MODE, 1, OFFBOARD)
                client.command(m.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            world.process.send_signal(signal.SIGSTOP)
            time.sleep(3.0)  # PX4 waits for 1.0 s
            world.process.send_signal(signal.SIGCONT)
            seen = client.modes(5.0)
        finally:
            client.close()
    assert len(seen) > 3
    assert set(seen) == {(OFFBOARD, True)}
