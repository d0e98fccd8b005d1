"""Four degrees of freedom: x, y, z, psi in the inertial frame, tau = X, Y, Z, N in the body's.

ROVs keep roll and pitch level by their metacentric height, so the Jacobian J of eq. veli is a rotation by psi
(the paper, sec. 3). All functions take arrays of shape (…, 4) and scalar or (…)-shaped psi.

| symbol  | meaning                                     | unit           | source          |
|---------|---------------------------------------------|----------------|-----------------|
| eta_dot | ẋ of the paper: NED velocity and heading rate | m/s, rad/s   | eq. veli        |
| nu      | u, v, w, r: body velocity                   | m/s, rad/s     | eq. velb        |
| m       | inertia with added mass, body diagonal      | kg, kg·m²      | eq. added       |
| d1, d2  | linear and quadratic damping, body diagonal | N/(m/s), …     | eq. damp        |
| m_bar   | diagonal of J⁻ᵀ M J⁻¹                       | kg, kg·m²      | eq. movi        |
| k, h    | Coriolis and damping, inertial frame        | N, N·m         | eq. movi        |
"""

from dataclasses import dataclass

import numpy as np

from companion.types import PSI, Array


def wrap(angle: Array) -> Array:
    """Return `angle` brought to [−π, π)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def pose_error(eta: Array, eta_d: Array) -> Array:
    """Return eta − eta_d with the heading's error wrapped, shape (…, 4)."""
    e = eta - eta_d
    e[..., PSI] = wrap(e[..., PSI])
    return e


def rotate(vector: Array, psi: Array | float) -> Array:
    """Turn the horizontal part of `vector` (…, 4) by `psi`: body to inertial; with −psi the way back."""
    cos, sin = np.cos(psi), np.sin(psi)
    turned = vector.copy()
    turned[..., 0] = cos * vector[..., 0] - sin * vector[..., 1]
    turned[..., 1] = sin * vector[..., 0] + cos * vector[..., 1]
    return turned


def inertial_diagonal(body: Array, psi: Array | float) -> Array:
    """Return the diagonal of R diag(body) Rᵀ (eq. movi), shape (…, 4); the rest is disturbance."""
    cos2 = np.cos(psi) ** 2
    turned = body.copy()
    turned[..., 0] = cos2 * body[..., 0] + (1.0 - cos2) * body[..., 1]
    turned[..., 1] = (1.0 - cos2) * body[..., 0] + cos2 * body[..., 1]
    return turned


@dataclass(frozen=True, slots=True)
class Model:
    """What the controller believes of the vehicle: body diagonals in the order surge, sway, heave, yaw."""

    m: Array
    d1: Array
    d2: Array

    def inertia(self, psi: Array | float) -> Array:
        """Return m_bar, shape (…, 4)."""
        return inertial_diagonal(self.m, psi)

    def drag_coefficient(self, nu: Array, psi: Array | float) -> Array:
        """Return the inertial diagonal of the damping matrix at body velocity `nu`, shape (…, 4)."""
        return inertial_diagonal(self.d1 + self.d2 * np.abs(nu), psi)

    def coriolis_and_damping(self, nu: Array, psi: Array | float) -> Array:
        """Return k + h in the inertial frame (eq. movi), shape (…, 4).

        k gathers C(ν)ν and M d(J⁻¹)/dt ẋ; for a diagonal M only (m_u − m_v) is left of both: what a vehicle
        of unequal inertia feels while it turns, and the Munk moment that turns it across its path.
        """
        u, v, r = nu[..., 0], nu[..., 1], nu[..., 3]
        unequal = self.m[..., 0] - self.m[..., 1]
        force = self.d1 * nu + self.d2 * nu * np.abs(nu)
        force[..., 0] += unequal * r * v
        force[..., 1] += unequal * r * u
        force[..., 3] -= unequal * u * v
        return rotate(force, psi)
