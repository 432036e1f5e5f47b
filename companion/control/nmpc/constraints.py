"""The distance constraints as margins: each row is to be >= -slack.

Distances, not their squares: linearised, a distance gives the half-space tangent to what is to
be avoided, which lies wholly inside the free side. So a plan that keeps the linearised rows
keeps the true ones, and full steps need no line search.
"""

from __future__ import annotations

import casadi as ca

from companion.control.nmpc.parameters import Scene, Weights

# Margin [m] of a row that is switched off.
FREE = 100.0


def agent_margins(p: ca.SX, scene: Scene, w: Weights) -> ca.SX:
    """(16), (37): distance to each neighbour's predicted place beyond the safety distance."""
    rows = []
    for j in range(scene.neighbours):
        d = p - scene.neighbour_p[:, j]
        squeezed = ca.vertcat(d[0], d[1], d[2] / w["agent_vertical_scale"])
        margin = ca.sqrt(ca.sumsqr(squeezed) + 1e-6) - scene.neighbour_safety[j]
        rows.append(_switched(margin, scene.neighbour_active[j]))
    return ca.vertcat(*rows)


def cylinder_margins(p: ca.SX, scene: Scene, w: Weights) -> ca.SX:
    """(20), (38): horizontal distance to each cylinder's surface beyond the safety distance."""
    rows = []
    for k in range(scene.cylinder_count):
        d = p[:2] - scene.cylinders[:2, k]
        margin = ca.sqrt(ca.sumsqr(d) + 1e-6) - scene.cylinders[2, k] - w["d_obstacle_safety"]
        rows.append(_switched(margin, scene.cylinder_active[k]))
    return ca.vertcat(*rows)


def plane_margins(p: ca.SX, scene: Scene, w: Weights) -> ca.SX:
    """(38) for walls and the fence, which cylinders cannot describe: n·p <= b."""
    rows = []
    for h in range(scene.plane_count):
        margin = scene.planes[3, h] - ca.dot(scene.planes[:3, h], p) - w["d_obstacle_safety"]
        rows.append(_switched(margin, scene.plane_active[h]))
    return ca.vertcat(*rows)


def _switched(margin: ca.SX, active: ca.SX) -> ca.SX:
    return active * margin + (1 - active) * FREE
