"""A served world ends by a signal, and by nothing else."""

import json
import signal
import time

import numpy as np
import pytest

from tests.sitl_sim.commands.test_interrupted import SCENARIO, interrupt, lines, started, wait_until


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 0), (signal.SIGINT, 130)])
def test_it_serves_past_the_time_limit_until_told_to_stop(tmp_path, number, status):
    (tmp_path / "far.yaml").write_text(SCENARIO.format(limit=0.5, port=276))
    with started(tmp_path, "serve", "far.yaml", "--out", "run") as process:
        wait_until(lambda: "companion UDP" in (tmp_path / "err").read_text(), process)
        time.sleep(3.0)
        assert process.poll() is None
        assert interrupt(process, number) == status
    told = [line for line in lines(tmp_path) if not line.startswith("drone1: system 1")]
    assert told == (["interrupted: what was served is kept in run"] if status else [])
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["never_flew"] == ["drone1"]
    assert metrics["interrupted"] is bool(status)
    assert np.load(tmp_path / "run" / "truth.npz")["t"][-1] > 1.0
