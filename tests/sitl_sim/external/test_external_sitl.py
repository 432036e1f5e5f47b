"""An autopilot's process ends with the simulator, however often that is told to."""

import sys

import pytest

from sitl_sim.external.external_sitl import ExternalSitl
from sitl_sim.external.lockstep_fleet import LockstepFleet

STUBBORN = "import signal, time; signal.signal(15, signal.SIG_IGN); print(1); time.sleep(60)"


class Stubborn(ExternalSitl):
    """A process that does not hear SIGTERM, as an ArduCopter that waits for the simulator."""

    period, connected = 0.001, True

    def __init__(self, folder, interrupted):
        super().__init__(folder)
        self.links = {}
        self.run([sys.executable, "-c", STUBBORN])
        while not (folder / "output.log").exists():
            pass
        wait = self._process.wait

        def interrupted_wait(timeout=None):
            if timeout is not None:
                raise KeyboardInterrupt
            return wait()

        if interrupted:
            self._process.wait = interrupted_wait

    def send(self, time, i, state):
        pass

    def receive(self, timeout):
        return True


def test_a_second_signal_leaves_no_autopilot_behind(tmp_path):
    """It comes while the first autopilot to be ended is waited for."""
    fleet = LockstepFleet.__new__(LockstepFleet)
    fleet._sitls = [Stubborn(tmp_path / str(i), interrupted=True) for i in range(2)]
    sitls = list(fleet._sitls)
    with pytest.raises(KeyboardInterrupt):
        fleet.close()
    assert [s.alive for s in sitls] == [False, False]
