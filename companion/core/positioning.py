"""Four degrees of freedom: x, y, z, psi in the inertial frame, tau = X, Y, Z, N in the body's.

ROVs keep roll and pitch level by their metacentric height, so the Jacobian J of eq. veli is a rotation by psi
(the paper, sec. 3) and J⁻¹ = Jᵀ. Vectors are four floats in DOF order.

| symbol  | meaning                                     | unit           | source          |
|---------|---------------------------------------------|----------------|-----------------|
| J       | cos ψ and sin ψ: body to inertial           |                | eq. veli        |
| eta_dot | ẋ of the paper: NED velocity, heading rate  | m/s, rad/s     | eq. veli        |
| nu      | u, v, w, r: body velocity                   | m/s, rad/s     | eq. velb        |
| m       | inertia with added mass, body diagonal      | kg, kg·m²      | eq. added       |
| d1, d2  | linear and quadratic damping, body diagonal | N/(m/s), …     | eq. damp        |
| m_bar   | diagonal of J⁻ᵀ M J⁻¹                       | kg, kg·m²      | eq. movi        |
| k, h    | Coriolis and damping, inertial frame        | N, N·m         | eq. movi        |
| σ       | coriolis_share: how much of C(ν)ν is there  |                | measured        |
"""

import math
from typing import NamedTuple

from companion.records import Flags, Vector


class Jacobian(NamedTuple):
    """J (eq. veli), a rotation about the vertical: cos ψ and sin ψ."""

    c: float
    s: float


class Model(NamedTuple):
    """What the controller believes of the vehicle: body diagonals in the order surge, sway, heave, yaw."""

    m: Vector
    d1: Vector
    d2: Vector
    coriolis_share: float = 1.0
    """How much of C(ν)ν is there: 0.3 to 0.5 on a real BlueROV2 Heavy (config/vehicles/tank-heavy.toml)."""


def jacobian(psi: float) -> Jacobian:
    """Return J at heading psi, rad; NaN for a heading that is not finite."""
    if math.isinf(psi):
        return Jacobian(math.nan, math.nan)
    return Jacobian(math.cos(psi), math.sin(psi))


def to_inertial(J: Jacobian, body: Vector) -> Vector:
    """Return J times a body vector."""
    X, Y, Z, N = body
    return (J.c * X - J.s * Y, J.s * X + J.c * Y, Z, N)


def to_body(J: Jacobian, inertial: Vector) -> Vector:
    """Return Jᵀ times an inertial vector."""
    x, y, z, psi = inertial
    return (J.c * x + J.s * y, J.c * y - J.s * x, z, psi)


def inertial_diagonal(J: Jacobian, body: Vector) -> Vector:
    """Return the diagonal of J diag(body) Jᵀ (eq. movi); the rest is disturbance."""
    surge, sway, heave, yaw = body
    cc, ss = J.c * J.c, J.s * J.s
    return (cc * surge + ss * sway, ss * surge + cc * sway, heave, yaw)


def inertia(model: Model, J: Jacobian) -> Vector:
    """Return m_bar."""
    return inertial_diagonal(J, model.m)


def damping(model: Model, nu: Vector) -> Vector:
    """Return D(ν), the body diagonal of the damping matrix at body velocity `nu`."""
    d1, d2 = model.d1, model.d2
    return (
        d1[0] + d2[0] * abs(nu[0]),
        d1[1] + d2[1] * abs(nu[1]),
        d1[2] + d2[2] * abs(nu[2]),
        d1[3] + d2[3] * abs(nu[3]),
    )


def drag_coefficient(model: Model, J: Jacobian, nu: Vector) -> Vector:
    """Return the inertial diagonal of the damping matrix at body velocity `nu`."""
    return inertial_diagonal(J, damping(model, nu))


def coriolis_and_damping(model: Model, J: Jacobian, nu: Vector) -> Vector:
    """Return k + h in the inertial frame (eq. movi).

    k gathers σ C(ν)ν and M d(J⁻¹)/dt ẋ. For a diagonal M and σ = 1 only (m_u − m_v) is left of both: what a
    vehicle of unequal inertia feels while it turns, and the Munk moment that turns it across its path.
    """
    u, v, w, r = nu
    d_u, d_v, d_w, d_r = damping(model, nu)
    m_u, m_v, share = model.m[0], model.m[1], model.coriolis_share
    return to_inertial(
        J,
        (
            u * d_u + (m_u - share * m_v) * r * v,
            v * d_v + (share * m_u - m_v) * r * u,
            w * d_w,
            r * d_r - share * (m_u - m_v) * u * v,
        ),
    )


def by_dof(by_axis: Flags) -> Flags:
    """Return flags of surge, sway, heave and yaw for x, y, z, psi: x and y have those of either."""
    horizontal = by_axis[0] or by_axis[1]
    return (horizontal, horizontal, by_axis[2], by_axis[3])
