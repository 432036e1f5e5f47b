"""The cost terms of eq. (29): a residual, its weight and its shape each.

A term w·(sqrt(r'r + eps²) - eps) is a norm, smooth at zero. Its Hessian is taken as w·J'J/s,
s = sqrt(r'r + eps²), which majorises it (iteratively reweighted least squares). Generalised
Gauss-Newton, which keeps the curvature of the norm instead, ends worse from a cold start. A term
without eps is the square w·r'r, its Hessian 2w·J'J. The Hessian of a hinge, w·max(r, 0)², includes
the curvature of r: where a plan presses on a hinge, Gauss-Newton's part alone is too little, and
full steps overshoot and cycle around the optimum. Both solvers are built from these terms alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca

from companion.control.nmpc.parameters import Scene, Weights
from mavlink_bridge.shared.constants import GRAVITY


@dataclass(frozen=True)
class Term:
    """weight · norm(residual) with smoothing eps, or weight · |residual|² where eps is None."""

    residual: ca.SX
    weight: ca.SX
    eps: ca.SX | None = None

    def value(self) -> ca.SX:
        """Return the term itself."""
        square = ca.sumsqr(self.residual)
        if self.eps is None:
            return self.weight * square
        return self.weight * (ca.sqrt(square + self.eps**2) - self.eps)

    def gradient(self) -> ca.SX:
        """Return the derivative by the residual."""
        return self.curvature() * self.residual

    def curvature(self) -> ca.SX:
        """Return the scalar h of the majoriser h·J'J."""
        if self.eps is None:
            return 2 * self.weight
        return self.weight / ca.sqrt(ca.sumsqr(self.residual) + self.eps**2)

    def hessian(self, variables: ca.SX) -> ca.SX:
        """Return the Hessian by `variables` of the real-time solver, positive semidefinite."""
        jacobian = ca.jacobian(self.residual, variables)
        return self.curvature() * jacobian.T @ jacobian


@dataclass(frozen=True)
class Hinge(Term):
    """weight · max(residual, 0)² of a scalar.

    bend: from the variables to a positive semidefinite matrix that majorises the residual's second
    derivative by them.
    """

    bend: Callable[[ca.SX], ca.SX] = field(kw_only=True)

    def value(self) -> ca.SX:
        """Return the term itself."""
        return self.weight * ca.fmax(self.residual, 0) ** 2

    def gradient(self) -> ca.SX:
        """Return the derivative by the residual."""
        return 2 * self.weight * ca.fmax(self.residual, 0)

    def curvature(self) -> ca.SX:
        """Return the second derivative by the residual; at the edge, that of the free side."""
        return 2 * self.weight * (self.residual > 0)

    def hessian(self, variables: ca.SX) -> ca.SX:
        """Return a matrix that majorises the true Hessian by `variables`."""
        return super().hessian(variables) + self.gradient() * self.bend(variables)


def cohesion(p: ca.SX, scene: Scene, w: Weights) -> list[Term]:
    """Return the short-term action, first sum of (29): keep d_ref to every neighbour.

    The residual is (29)'s |d| - d_ref, not (12), which has no minimum at d_ref. scene.cohesion is
    1/N_i, and 0 beyond the short horizon. A neighbour that is too near counts `crowding` times as
    far off. One that is too distant counts as a norm only: with the symmetric square, far
    neighbours press near ones together until none can brake, and draw a drone that lost the swarm
    across its way at full speed.
    """
    terms = []
    for j in range(scene.neighbours):
        distance = ca.sqrt(ca.sumsqr(scene.neighbour_p[:, j] - p) + 1e-6)
        off = distance - w["d_ref"]
        weight = w["w_short"] * scene.cohesion[j]
        terms.append(Term(w["crowding"] * ca.fmin(off, 0), weight))
        terms.append(Term(ca.fmax(off, 0), weight, w["eps_cohesion"]))
    return terms


def reference_velocity(p: ca.SX, scene: Scene, w: Weights) -> ca.SX:
    """Return the velocity (3,1) m/s of (18), regular at the goal: C e/sqrt(|e|² + delta²).

    Errors of height are closed at `climb_speed`, however far the goal is.
    """
    e = scene.goal - p
    delta = w["goal_smoothing"]
    far = ca.sqrt(ca.sumsqr(e[:2]) + delta**2)
    return ca.vertcat(
        scene.speed * e[:2] / far, w["climb_speed"] * e[2] / ca.sqrt(e[2] ** 2 + delta**2)
    )


def migration(p: ca.SX, v: ca.SX, scene: Scene, w: Weights) -> Term:
    """Return the long-term action, (17) and second sum of (29)."""
    return Term(v - reference_velocity(p, scene, w), w["w_mig"], w["eps_mig"])


def speed_excess(v: ca.SX, scene: Scene, w: Weights) -> Hinge:
    """Return (32), soft: v_min > 0 would forbid hovering; a hard v_max is infeasible in a gust."""
    excess = ca.sqrt(ca.sumsqr(v) + 1e-6) - scene.v_max
    return Hinge(excess, w["w_v"], bend=lambda variables: ca.hessian(excess, variables)[0])


def blind_motion(v: ca.SX, scene: Scene, w: Weights) -> Hinge:
    """Return the cost of motion out of the cone around the line of sight, which (29) lacks.

    A drone that backs, slides, climbs or sinks away from an object in view hits one out of view.
    Speeds below v_blind are free, and so are directions in the cone whose half-angle has the cosine
    `seen_cone`. The cone is around (7), not around the camera's axis: a drone that flees is not to
    look away.
    """
    cone = w["seen_cone"] * ca.sqrt(ca.sumsqr(v) + 1e-4)
    return Hinge(
        cone - ca.dot(scene.sight, v[:2]) - w["v_blind"],
        w["w_blind"],
        bend=lambda variables: ca.hessian(cone, variables)[0],
    )


def line_of_sight(q: ca.SX, scene: Scene, w: Weights) -> Term:
    """Return the cost of yaw off (7), which (29) lacks though omega_z is an input.

    It is a norm, so that a large turn does not cost more than the flight.
    """
    return Term(_x_body(q) - scene.sight, w["w_yaw"], w["eps_yaw"])


def state_terms(x: ca.SX, scene: Scene, w: Weights) -> list[Term]:
    """Return all terms of (29) in one state x (10,1)."""
    p, v, q = x[:3], x[3:6], x[6:10]
    return [
        *cohesion(p, scene, w),
        migration(p, v, scene, w),
        speed_excess(v, scene, w),
        blind_motion(v, scene, w),
        line_of_sight(q, scene, w),
    ]


def change_terms(u: ca.SX, before: ca.SX, w: Weights) -> list[Term]:
    """Return (21), w_c1 and w_c2: change of thrust and rates from `before`, the previous input."""
    return [
        Term(u[0] - before[0], w["w_c1"], w["eps_c"]),
        Term(u[1:] - before[1:], w["w_c2"], w["eps_omega"]),
    ]


def effort_terms(u: ca.SX, w: Weights) -> list[Term]:
    """Return (21), w_c3 and w_c4: rates, and thrust off hover, as |c| would pull below hover."""
    return [
        Term(u[0] - GRAVITY, w["w_c3"], w["eps_c"]),
        Term(u[1:], w["w_c4"], w["eps_omega"]),
    ]


def _x_body(q: ca.SX) -> ca.SX:
    """Return the horizontal part (2,1) of the body's x axis, along which the camera looks."""
    return ca.vertcat(
        q[0] ** 2 + q[1] ** 2 - q[2] ** 2 - q[3] ** 2, 2 * (q[1] * q[2] + q[0] * q[3])
    )
