"""The cost terms of eq. (29), each a residual and what is done with it.

A term w·(sqrt(r'r + eps²) - eps) is a norm, smooth at zero; its Hessian is taken as w·J'J/s,
s = sqrt(r'r + eps²), which majorises it (iteratively reweighted least squares). Generalised
Gauss-Newton, which keeps the curvature of the norm instead, ends worse from cold. A term
without eps is the square w·r'r, taken as 2w·J'J. A hinge, w·max(r, 0)², is taken with the
curvature of r besides: where a plan presses on a hinge, Gauss-Newton's half alone is too little,
and full steps overshoot and cycle around the optimum. Both solvers read these definitions, and
no others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca

from companion.control.nmpc.parameters import Scene, Weights
from companion.model import GRAVITY


@dataclass(frozen=True)
class Term:
    """weight · norm(residual) with smoothing eps, or weight · |residual|² where eps is None.

    `gradient` and `curvature` are by the residual.
    """

    residual: ca.SX
    weight: ca.SX
    eps: ca.SX | None = None

    def value(self) -> ca.SX:
        """The term itself."""
        square = ca.sumsqr(self.residual)
        if self.eps is None:
            return self.weight * square
        return self.weight * (ca.sqrt(square + self.eps**2) - self.eps)

    def gradient(self) -> ca.SX:
        """Derivative by the residual."""
        return self.curvature() * self.residual

    def curvature(self) -> ca.SX:
        """Scalar h of the majoriser h·J'J."""
        if self.eps is None:
            return 2 * self.weight
        return self.weight / ca.sqrt(ca.sumsqr(self.residual) + self.eps**2)

    def hessian(self, variables: ca.SX) -> ca.SX:
        """The positive semidefinite Hessian by `variables` that the real-time solver takes."""
        jacobian = ca.jacobian(self.residual, variables)
        return self.curvature() * jacobian.T @ jacobian


@dataclass(frozen=True)
class Hinge(Term):
    """weight · max(residual, 0)² of a scalar.

    bend: by the variables, a positive semidefinite matrix that is at least the second derivative
    of the residual.
    """

    bend: Callable[[ca.SX], ca.SX] = field(kw_only=True)

    def value(self) -> ca.SX:
        """The term itself."""
        return self.weight * ca.fmax(self.residual, 0) ** 2

    def gradient(self) -> ca.SX:
        """Derivative by the residual."""
        return 2 * self.weight * ca.fmax(self.residual, 0)

    def curvature(self) -> ca.SX:
        """Second derivative by the residual; at the edge itself that of the free side."""
        return 2 * self.weight * (self.residual > 0)

    def hessian(self, variables: ca.SX) -> ca.SX:
        """At least the true one."""
        return super().hessian(variables) + self.gradient() * self.bend(variables)


def cohesion(p: ca.SX, scene: Scene, w: Weights) -> list[Term]:
    """Short-term action, first sum of (29): keep d_ref to every neighbour.

    (29)'s (|d| - d_ref)², not (12), which has no minimum at d_ref. w_short/N_i, and the end of
    the short horizon, are in scene.cohesion. Too near counts `crowding` times as far off as too
    distant, and too distant only as a norm: the symmetric square lets far neighbours press near
    ones together until none can brake, and draws who lost the swarm across its way at full speed.
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
    """(18), made regular at the goal: C e/sqrt(|e|² + delta²); height errors closed at once."""
    e = scene.goal - p
    delta = w["goal_smoothing"]
    far = ca.sqrt(ca.sumsqr(e[:2]) + delta**2)
    return ca.vertcat(
        scene.speed * e[:2] / far, w["climb_speed"] * e[2] / ca.sqrt(e[2] ** 2 + delta**2)
    )


def migration(p: ca.SX, v: ca.SX, scene: Scene, w: Weights) -> Term:
    """Long-term action, (17) and second sum of (29)."""
    return Term(v - reference_velocity(p, scene, w), w["w_mig"] * scene.migration, w["eps_mig"])


def speed_excess(v: ca.SX, scene: Scene, w: Weights) -> Hinge:
    """(32), soft: v_min > 0 would forbid hovering, and a hard v_max has no answer to a gust."""
    excess = ca.sqrt(ca.sumsqr(v) + 1e-6) - scene.v_max
    return Hinge(excess, w["w_v"], bend=lambda variables: ca.hessian(excess, variables)[0])


def blind_motion(v: ca.SX, scene: Scene, w: Weights) -> Hinge:
    """Motion out of the cone around the line of sight: (29) knows no blind side.

    Who backs or slides away from what it sees hits what it does not see. Free: speeds below
    v_blind against the line of sight, and directions within the cone whose half-angle has the
    cosine `seen_cone`. Around (7), not around the camera's axis: who flees is not to look away
    from what it flees from.
    """
    cone = w["seen_cone"] * ca.sqrt(ca.sumsqr(v[:2]) + 1e-4)
    return Hinge(
        cone - ca.dot(scene.sight, v[:2]) - w["v_blind"],
        w["w_blind"],
        bend=lambda variables: ca.hessian(cone, variables)[0],
    )


def line_of_sight(q: ca.SX, scene: Scene, w: Weights) -> Term:
    """Yaw is not in (29) though omega_z is an input: the body's x axis towards (7).

    A norm as the others are: far off, the turn is not to cost more than the flight.
    """
    return Term(_x_body(q) - scene.sight, w["w_yaw"], w["eps_yaw"])


def state_terms(x: ca.SX, scene: Scene, w: Weights) -> list[Term]:
    """All terms of (29) that depend on one state."""
    p, v, q = x[:3], x[3:6], x[6:10]
    return [
        *cohesion(p, scene, w),
        migration(p, v, scene, w),
        speed_excess(v, scene, w),
        blind_motion(v, scene, w),
        line_of_sight(q, scene, w),
    ]


def change_terms(u: ca.SX, before: ca.SX, w: Weights) -> list[Term]:
    """(21), w_c1 and w_c2: change of thrust and of rates; `before` is the previous input."""
    return [
        Term(u[0] - before[0], w["w_c1"], w["eps_c"]),
        Term(u[1:] - before[1:], w["w_c2"], w["eps_omega"]),
    ]


def effort_terms(u: ca.SX, w: Weights) -> list[Term]:
    """(21), w_c3 and w_c4: thrust beyond hover (|c| itself would pull below hover), rates."""
    return [
        Term(u[0] - GRAVITY, w["w_c3"], w["eps_c"]),
        Term(u[1:], w["w_c4"], w["eps_omega"]),
    ]


def _x_body(q: ca.SX) -> ca.SX:
    """(2,) horizontal part of the body's x axis, along which the camera looks."""
    return ca.vertcat(
        q[0] ** 2 + q[1] ** 2 - q[2] ** 2 - q[3] ** 2, 2 * (q[1] * q[2] + q[0] * q[3])
    )
