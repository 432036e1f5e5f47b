"""Solvers are built once: it takes a second and compiles once."""

import pytest

from companion.control.nmpc import Nmpc, NmpcConfig
from companion.control.nmpc.ipopt import IpoptNmpc


@pytest.fixture(scope="session")
def thorough():
    """A config whose real-time solver goes on to convergence."""
    return NmpcConfig(
        sqp_iterations_cold=200,
        sqp_iterations_max=200,
        step_tolerance=1e-5,
        work_max=100_000,
    )


@pytest.fixture(scope="session")
def reference(thorough):
    """IPOPT that finds the minimum next to its guess."""
    return IpoptNmpc(thorough, barrier=1e-6)


@pytest.fixture(params=["compiled", "virtual machine"])
def solver(request):
    """A cold real-time solver on either path."""
    made = Nmpc(NmpcConfig(), compiled=request.param == "compiled")
    if request.param == "compiled" and made.backend != "compiled":
        pytest.skip("no C compiler")
    return made
