"""Configuration of the controllers to compare with; see docs/history/studies-0.1.md."""

from __future__ import annotations

from pydantic import Field

from mavlink_bridge.shared.settings import StrictModel


class TrackingConfig(StrictModel):
    """Tracking of a velocity by body rates and thrust; the same for every rule."""

    velocity_gain: float = Field(2.5, gt=0, description="Acceleration per velocity error [1/s].")
    acceleration_max: float = Field(5.0, gt=0, description="m/s², horizontal: 27° of tilt.")
    attitude_gain: float = Field(6.0, gt=0, description="Rate per attitude error [1/s].")
    yaw_gain: float = Field(2.0, gt=0, description="Rate per yaw error [1/s].")
    climb_gain: float = Field(1.0, gt=0, description="Climb per height error [1/s].")
    climb_max: float = Field(0.8, gt=0, description="m/s.")


class ReynoldsConfig(StrictModel):
    """Separation, cohesion and migration of vision-based flocks."""

    separation: float = Field(8.0, ge=0, description="k_sep [m²/s].")
    cohesion: float = Field(2.0, ge=0, description="k_coh [1/s]; rest at sqrt(k_sep/k_coh) m.")
    obstacle: float = Field(1.5, ge=0, description="k_sep of obstacles, as virtual agents [m²/s].")
    obstacle_range: float = Field(3.0, gt=0, description="Farther obstacles [m] do not count.")


class VasarhelyiConfig(StrictModel):
    """Repulsion, friction and shill agents, scaled from 4 m/s outdoors to 1.5 m/s in a forest."""

    r0_rep: float = Field(2.0, gt=0, description="Repulsion begins [m].")
    p_rep: float = Field(1.0, ge=0, description="Repulsion per metre [1/s].")
    r0_frict: float = Field(1.5, ge=0, description="Stopping point off this distance [m].")
    c_frict: float = Field(0.3, ge=0, description="Strength of alignment [-].")
    v_frict: float = Field(0.4, ge=0, description="Velocity slack of alignment [m/s].")
    p_frict: float = Field(1.5, gt=0, description="Gain of the braking curve [1/s].")
    a_frict: float = Field(1.5, gt=0, description="Acceleration of the braking curve [m/s²].")
    r0_shill: float = Field(0.8, ge=0, description="Stopping point before obstacles [m].")
    v_shill: float = Field(1.5, ge=0, description="Speed of shill agents [m/s].")
    p_shill: float = Field(1.5, gt=0, description="Gain of the braking curve [1/s].")
    a_shill: float = Field(2.0, gt=0, description="Acceleration of the braking curve [m/s²].")


class PotentialFieldConfig(StrictModel):
    """Attraction to the goal, repulsion from drones and obstacles within reach."""

    eta_agent: float = Field(3.0, ge=0, description="Strength between drones [m⁴/s].")
    rho_agent: float = Field(3.0, gt=0, description="Reach between surfaces of drones [m].")
    eta_obstacle: float = Field(2.0, ge=0, description="Strength of obstacles [m⁴/s].")
    rho_obstacle: float = Field(1.5, gt=0, description="Reach of obstacles [m].")


class OrcaConfig(StrictModel):
    """Optimal reciprocal collision avoidance."""

    radius: float = Field(0.5, gt=0, description="Radius of a drone, with margin [m].")
    horizon: float = Field(3.0, gt=0, description="Time free of collision with drones [s].")
    horizon_obstacle: float = Field(
        3.0, gt=0, description="Time free of collision with obstacles [s]."
    )
    aside: float = Field(
        0.05,
        ge=0,
        description="The preferred velocity is turned right by this [rad], against ties.",
    )


class RblConfig(StrictModel):
    """Rule-based Lloyd: the cell, its weight, and when it is changed."""

    reach: float = Field(3.0, gt=0, description="Radius of the sensed disc [m].")
    margin: float = Field(0.25, ge=0, description="Room [m] kept beyond the drone's radius.")
    gain: float = Field(1.5, gt=0, description="Velocity per metre to the centroid [1/s].")
    at_goal: float = Field(
        0.5, gt=0, description="Asked for less speed [m/s], a drone is near its goal."
    )
    beta: float = Field(0.5, gt=0, description="Distance [m] over which the weight falls.")
    beta_least: float = Field(
        0.15, gt=0, description="The same where the drone rests in a cut cell."
    )
    rests: float = Field(0.3, gt=0, description="A centroid nearer than this [m] is at rest.")
    cut: float = Field(0.3, gt=0, description="A centroid moved by more than this [m] is cut.")
    turn_rate: float = Field(1.0, gt=0, description="Of the goal to the right meanwhile [rad/s].")


class AvocadoConfig(OrcaConfig):
    """Avoidance by opinion; symbols and values of its paper, radius and obstacles as of ORCA."""

    a: float = Field(0.3, ge=0, description="How far the opinion upholds itself [-].")
    b: float = Field(0.0, ge=-1, le=1, description="Bias of the opinion [1/s].")
    c: float = Field(0.7, ge=0, description="How far the opinion follows what is seen [-].")
    d: float = Field(2.0, gt=0, le=10, description="Decay of the opinion [1/s].")
    kappa: float = Field(
        14.15, gt=0, description="Collisions sooner than about this [s] have all attention."
    )
    epsilon: float = Field(
        3.22, gt=0, description="How sharply half of the needed change divides those who help [-]."
    )
    delta: float = Field(
        0.57, gt=0, le=1, description="Share of attention that is new at each tick [-]."
    )
    horizon: float = Field(2.5, gt=0, description="Time free of collision with drones [s].")
    reach: float = Field(2.5, gt=0, description="Farther neighbours [m] do not count.")


class BaselinesConfig(StrictModel):
    """One section for each rule."""

    radius: float = Field(0.2, gt=0, description="Radius of a drone [m].")
    tracking: TrackingConfig = TrackingConfig()
    reynolds: ReynoldsConfig = ReynoldsConfig()
    vasarhelyi: VasarhelyiConfig = VasarhelyiConfig()
    potential_field: PotentialFieldConfig = PotentialFieldConfig()
    orca: OrcaConfig = OrcaConfig()
    rbl: RblConfig = RblConfig()
    avocado: AvocadoConfig = AvocadoConfig()
