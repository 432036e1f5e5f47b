"""The distance constraints (37), (38) as margins [m]: each row is to be >= -slack.

The rows are distances, not their squares: a linearised distance is the half-space tangent to the
obstacle, which lies wholly on the free side. So a plan that keeps the linearised rows keeps the
true ones, and full steps need no line search. The distances themselves are those of
`mavlink_bridge/shared/distance.py`; a test holds the two together.
"""

from __future__ import annotations

import casadi as ca

from companion.control.nmpc.parameters import Scene, Weights

# Margin [m] of a row that is switched off.
FREE = 100.0


def agent_margins(p: ca.SX, scene: Scene, w: Weights) -> ca.SX:
    """Return the margins (J,1) of (16), (37) to the neighbours' predicted positions, p (3,1) m."""
    rows = []
    for j in range(scene.neighbours):
        d = p - scene.neighbour_p[:, j]
        squeezed = ca.vertcat(d[0], d[1], d[2] / w["agent_vertical_scale"])
        margin = ca.sqrt(ca.sumsqr(squeezed) + 1e-6) - scene.neighbour_safety[j]
        rows.append(_switched(margin, scene.neighbour_active[j]))
    return ca.vertcat(*rows)


def cylinder_margins(p: ca.SX, scene: Scene, w: Weights) -> ca.SX:
    """Return the margins (K,1) of (20), (38) to the cylinders' surfaces, horizontally."""
    rows = []
    for k in range(scene.cylinder_count):
        d = p[:2] - scene.cylinders[:2, k]
        margin = ca.sqrt(ca.sumsqr(d) + 1e-6) - scene.cylinders[2, k] - w["d_obstacle_safety"]
        rows.append(_switched(margin, scene.cylinder_active[k]))
    return ca.vertcat(*rows)


def plane_margins(p: ca.SX, scene: Scene, w: Weights) -> ca.SX:
    """Return the margins (H,1) of (38) to the half-spaces n·p <= b: walls and the fence."""
    rows = []
    for h in range(scene.plane_count):
        margin = scene.planes[3, h] - ca.dot(scene.planes[:3, h], p) - w["d_obstacle_safety"]
        rows.append(_switched(margin, scene.plane_active[h]))
    return ca.vertcat(*rows)


def _switched(margin: ca.SX, active: ca.SX) -> ca.SX:
    """Return the margin where `active` is 1, FREE where it is 0."""
    return active * margin + (1 - active) * FREE
