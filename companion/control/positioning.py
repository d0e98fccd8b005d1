"""Four degrees of freedom: x, y, z, psi in the inertial frame, tau = X, Y, Z, N in the body's.

ROVs keep roll and pitch level by their metacentric height, so the Jacobian J of eq. veli is a rotation by psi
(the paper, sec. 3) and J⁻¹ = Jᵀ. All functions take arrays of shape (…, 4), J of shape (…, 4, 4).

| symbol  | meaning                                     | unit           | source          |
|---------|---------------------------------------------|----------------|-----------------|
| eta_dot | ẋ of the paper: NED velocity, heading rate  | m/s, rad/s     | eq. veli        |
| nu      | u, v, w, r: body velocity                   | m/s, rad/s     | eq. velb        |
| m       | inertia with added mass, body diagonal      | kg, kg·m²      | eq. added       |
| d1, d2  | linear and quadratic damping, body diagonal | N/(m/s), …     | eq. damp        |
| m_bar   | diagonal of J⁻ᵀ M J⁻¹                       | kg, kg·m²      | eq. movi        |
| k, h    | Coriolis and damping, inertial frame        | N, N·m         | eq. movi        |
"""

from dataclasses import dataclass

import numpy as np

from companion.control.bounds import wrap
from companion.records import PSI, Array, Flags


def pose_error(eta: Array, eta_d: Array) -> Array:
    """Return eta − eta_d with the heading's error wrapped, shape (…, 4)."""
    e = eta - eta_d
    e[..., PSI] = wrap(e[..., PSI])
    return e


def jacobian(psi: Array | float) -> Array:
    """Return J (eq. veli), shape (…, 4, 4): body to inertial."""
    J = np.zeros((*np.shape(psi), 4, 4))
    J[..., 0, 0] = J[..., 1, 1] = np.cos(psi)
    J[..., 1, 0] = np.sin(psi)
    J[..., 0, 1] = -J[..., 1, 0]
    J[..., 2, 2] = J[..., 3, 3] = 1.0
    return J


def to_inertial(J: Array, body: Array) -> Array:
    """Return J times a body vector, shape (…, 4)."""
    return np.asarray(np.matvec(J, body))


def to_body(J: Array, inertial: Array) -> Array:
    """Return Jᵀ times an inertial vector, shape (…, 4)."""
    return np.asarray(np.vecmat(inertial, J))


def inertial_diagonal(J: Array, body: Array) -> Array:
    """Return the diagonal of J diag(body) Jᵀ (eq. movi), shape (…, 4); the rest is disturbance."""
    return np.asarray(np.matvec(J * J, body))


# (m_u − m_v) times r v, r u, 0 and −u v: which velocities meet on which axis.
_SIGN = np.array([1.0, 1.0, 0.0, -1.0])
_FIRST, _SECOND = np.array([3, 3, 0, 0]), np.array([1, 0, 0, 1])


@dataclass(frozen=True, slots=True)
class Model:
    """What the controller believes of the vehicle: body diagonals in the order surge, sway, heave, yaw."""

    m: Array
    d1: Array
    d2: Array

    def inertia(self, J: Array) -> Array:
        """Return m_bar, shape (…, 4)."""
        return inertial_diagonal(J, self.m)

    def drag_coefficient(self, J: Array, nu: Array) -> Array:
        """Return the inertial diagonal of the damping matrix at body velocity `nu`, shape (…, 4)."""
        return inertial_diagonal(J, self.d1 + self.d2 * np.abs(nu))

    def coriolis_and_damping(self, J: Array, nu: Array) -> Array:
        """Return k + h in the inertial frame (eq. movi), shape (…, 4).

        k gathers C(ν)ν and M d(J⁻¹)/dt ẋ; for a diagonal M only (m_u − m_v) is left of both: what a vehicle
        of unequal inertia feels while it turns, and the Munk moment that turns it across its path.
        """
        damping = nu * (self.d1 + self.d2 * np.abs(nu))
        unequal = (self.m[..., 0] - self.m[..., 1])[..., None] * _SIGN
        return to_inertial(J, damping + unequal * nu[..., _FIRST] * nu[..., _SECOND])


def by_dof(by_axis: Flags) -> Flags:
    """Surge and sway turn into x and y: what either lacks, both lack."""
    horizontal = by_axis[0] | by_axis[1]
    return np.array((horizontal, horizontal, by_axis[2], by_axis[3]))
