"""The numbers of the problem, each with its unit and its reason.

Sizes (N, neighbours, cylinders, planes, dt) fix the shape of the generated functions. All other
numbers are parameters of these, so that two drones with different weights share one compiled
library.
"""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from mavlink_bridge.shared.constants import GRAVITY
from mavlink_bridge.shared.settings import Contradiction, StrictModel


class NmpcConfig(StrictModel):
    """The problem's sizes, bounds, weights and penalties, and the solver's iteration counts."""

    # Horizons and sizes
    N: int = Field(20, ge=2, le=100, description="Long horizon [steps]; 2 s in the paper.")
    M: int = Field(5, ge=1, description="Short horizon [steps] of the cohesion cost; 0.5 s.")
    M_constraint: int = Field(
        15,
        ge=1,
        description="Steps over which neighbours must be kept away from, (37). The paper's M "
        "sees 1.7 m at head-on speed, too little; longer costs this solver nothing.",
    )
    dt: float = Field(0.1, gt=0, le=0.5, description="Step [s]; the tick of the companion.")
    neighbours: int = Field(
        8,
        ge=0,
        le=12,
        description="Neighbours in (37): the critical ones of section III-C, then the nearest. "
        "With the critical three alone, a drone that dodges one of them flies into a fourth.",
    )
    cylinders: int = Field(8, ge=0, le=64, description="Cylinders in (38), the nearest.")
    planes: int = Field(
        6, ge=2, le=64, description="Half-spaces in (38): floor, ceiling, nearest walls, fence."
    )

    # Reference
    speed: float = Field(
        1.65,
        gt=0,
        description="Cruise speed C [m/s], (18): the paper's mean of 1.5 includes slowing down.",
    )
    climb_speed: float = Field(
        0.8,
        gt=0,
        description="Speed [m/s] at which a height error is closed. (18) alone points at the "
        "goal: 50 m away it would close 1 m of height error in half a minute.",
    )
    goal_smoothing: float = Field(
        0.5, gt=0, description="delta [m] in C e/sqrt(|e|²+delta²): (18) is singular at the goal."
    )
    d_ref: float = Field(
        2.0,
        gt=0,
        description="Distance kept to neighbours [m]. 1.5, the spacing at the start, leaves too "
        "little room to brake.",
    )

    # Safety distances, soft and exact
    d_agent_safety: float = Field(0.8, gt=0, description="(37) [m], centre to centre.")
    d_obstacle_safety: float = Field(
        0.6, gt=0, description="(38) [m], drone's centre to the surface; radius 0.2 m + margin."
    )
    agent_vertical_scale: float = Field(
        4.0,
        ge=1,
        description="(37) is an ellipsoid this much taller than wide: a drone that evades up or "
        "down leaves the other's view, and flies in downwash. 1 is the paper's sphere.",
    )
    kappa: float = Field(
        1.0, ge=0, description="Standard deviations of a neighbour's position added to (37)."
    )
    widening_max: float = Field(
        0.5,
        ge=0,
        description="Most [m] that uncertainty adds to (37); with more, no drone could pass.",
    )
    tie_break: float = Field(
        0.06,
        ge=0,
        description="An object dead ahead is moved this far [m] to the left, so that the drone "
        "passes right of it; an exact tie has no descent direction to either side. 0.06 saves "
        "0.4 s a trunk against 0.01; objects off the line are not moved.",
    )

    # Bounds
    c_min: float = Field(2.0, ge=0, description="(35) [m/s²]; the propellers never stop.")
    c_max: float = Field(20.0, gt=0, description="(35) [m/s²]; twice hover.")
    omega_max: float = Field(3.0, ge=0.5, description="(36) [rad/s] on each axis.")
    delta_c_max: float = Field(4.0, ge=0.5, description="(33) [m/s² per step], both ways.")
    delta_omega_max: float = Field(1.5, ge=0.1, description="(34) [rad/s per step], each axis.")
    v_max: float = Field(
        1.85, gt=0, description="(32) [m/s], soft; faster evasions only hit another drone."
    )

    seen_cone: float = Field(
        0.5,
        ge=0,
        le=1,
        description="Cosine of the half-angle around the line of sight that is flown freely.",
    )
    v_blind: float = Field(
        0.1, ge=0, description="Backward speed [m/s] that is free: hovering is never quite still."
    )

    # Weights of (29)
    w_short: float = Field(1.0, ge=0, description="Cohesion and spacing; 1 m off = 1 m/s off.")
    crowding: float = Field(
        2.0, ge=1, description="Nearer than d_ref counts as this many times as far off; 1: paper."
    )
    w_mig: float = Field(1.0, ge=0, description="Migration: the scale of all other weights.")
    w_c1: float = Field(0.02, ge=0, description="Change of c: smooth thrust.")
    w_c2: float = Field(0.1, ge=0, description="Change of omega: smooth rates.")
    w_c3: float = Field(0.01, ge=0, description="|c - g|; the paper's |c| pulls below hover.")
    w_c4: float = Field(0.02, ge=0, description="|omega|: calm flight, and a still hover.")
    w_yaw: float = Field(
        2.5,
        ge=0,
        description="Line of sight, not in (29): norm of (R11,R21)-(cos psi,sin psi). A gaze of "
        "0.6 rad at 1.5 rad/s is followed within 15 deg, without loss of speed.",
    )
    w_v: float = Field(100.0, ge=0, description="Square of the speed beyond v_max, (32).")
    w_blind: float = Field(
        100.0, ge=0, description="Square of the speed beyond v_blind away from the line of sight."
    )
    eps_cohesion: float = Field(
        1.0, gt=0, description="Beyond d_ref by more than this [m], cohesion pulls no harder."
    )
    eps_mig: float = Field(
        0.3, gt=0, description="Below this [m/s] the migration norm is a parabola: smooth."
    )
    eps_c: float = Field(1.0, gt=0, description="The same for the thrust terms [m/s²].")
    eps_yaw: float = Field(0.3, gt=0, description="The same for the line of sight [-].")
    eps_omega: float = Field(0.5, gt=0, description="The same for the rate terms [rad/s].")

    # Penalties on the slack of (37), (38)
    penalty: float = Field(
        40.0,
        gt=0,
        description="L1 [1/m], exact: above any multiplier met, so slack is used only where no "
        "plan does without.",
    )
    penalty_quadratic: float = Field(
        40.0, gt=0, description="L2 [1/m²]: deep intrusions cost more; the QP is strictly convex."
    )

    # Solver: counts, never times, so that the same input gives the same plan, bit for bit
    sqp_iterations: int = Field(2, ge=1, le=50, description="Least number in a tick.")
    sqp_iterations_max: int = Field(8, ge=1, le=500, description="Most, while the step is large.")
    sqp_iterations_cold: int = Field(15, ge=1, le=500, description="Most in the first tick.")
    work_max: int = Field(
        67,
        ge=1,
        description="Work of a tick in interior-point iterations (an SQP step is two more) at "
        "which it begins no further step. 67 takes three times the median tick; another route "
        "has as much of its own.",
    )
    route_intrusion: float = Field(
        0.1,
        ge=0,
        description="A plan that comes this much [m] too near to a neighbour is compared with one "
        "past its other side: of such plans one in seven is 30 % dearer than that.",
    )
    route_gain: float = Field(
        0.7,
        ge=0,
        le=1,
        description="Share of the plan's cost below which another route is taken; 0: none is "
        "looked for.",
    )
    step_tolerance: float = Field(
        0.1,
        gt=0,
        description="Steps (largest change of any variable, SI) below this are small: they cost at "
        "most 0.2 % against the optimum on the recorded set, 0.03 % at 0.02.",
    )

    @model_validator(mode="after")
    def _orders(self) -> Self:
        """Check the relations between fields."""
        checks = {
            ("M", "N"): (self.M <= self.N, "M must be at most N"),
            ("M_constraint", "N"): (self.M_constraint <= self.N, "M_constraint must be at most N"),
            ("c_min",): (self.c_min < GRAVITY, f"c_min must be below hover, {GRAVITY}"),
            ("c_max",): (self.c_max > GRAVITY, f"c_max must be above hover, {GRAVITY}"),
            ("v_max", "speed"): (self.v_max >= self.speed, "v_max must be at least speed"),
            ("d_ref", "d_agent_safety"): (
                self.d_ref > self.d_agent_safety,
                "d_ref must be above d_agent_safety",
            ),
            ("sqp_iterations_max", "sqp_iterations"): (
                self.sqp_iterations_max >= self.sqp_iterations,
                "sqp_iterations_max must be at least sqp_iterations",
            ),
        }
        for keys, (fine, text) in checks.items():
            if not fine:
                raise Contradiction(keys, text)
        return self
