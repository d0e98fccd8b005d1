"""A rigid body in moving water, six degrees of freedom (Fossen, Handbook of Marine Craft, 2011).

| symbol | meaning | unit | equation |
|---|---|---|---|
| x, y, z | position in NED; z is depth | m | 2.2 |
| q0..q3 | unit quaternion, body to NED | - | 2.68 |
| u, v, w, p, q, r | nu: velocity and rates in the body frame | m/s, rad/s | 2.2 |
| X, Y, Z, K, M, N | tau: force and moment of the thrusters, body frame | N, N·m | 2.2 |
| m, Ix, Iy, Iz | M_RB, origin in the centre of gravity, principal axes | kg, kg·m² | 3.44 |
| Xa..Na | M_A, diagonal, positive | kg, kg·m² | 6.46 |
| Xl..Nl, Xq..Nq | linear and quadratic damping, positive | N·s/m ... | 6.58 |
| W, B, zb | weight, buoyancy, height of the centre of buoyancy over that of gravity | N, N, m | 4.6 |
| nu_r | velocity relative to the water, nu - nu_c | m/s | 8.6 |

    M_RB nu' + C_RB(nu) nu + M_A nu_r' + C_A(nu_r) nu_r + D(nu_r) nu_r + g = tau + R^T f + B/g R^T a_c  (8.8)

The last term is the Froude-Krylov force of water that accelerates with a_c; its rotation is neglected.
Every component is a float (one vehicle) or an array (any number of dives): the same lines serve both.
The attitude is a quaternion, so that a tumbling vehicle meets no singularity.
"""

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_bridge.config import Hull

GRAVITY = 9.80665

Component: TypeAlias = Any
"""A float, or an array with the leading shape of the dives."""
Components: TypeAlias = Sequence[Component]

STILL_WATER = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def split(array: ArrayLike) -> tuple[Component, ...]:
    """Components of the last axis: Python floats for shape (n,), arrays of shape (...) for (..., n)."""
    array = np.asarray(array, dtype=np.float64)
    return tuple(array.tolist()) if array.ndim == 1 else tuple(np.moveaxis(array, -1, 0))


def join(components: Components) -> NDArray[np.float64]:
    """Reverse `split`: shape (..., n)."""
    return np.stack(np.broadcast_arrays(*components), axis=-1).astype(np.float64)


def state_of(eta: ArrayLike, nu: ArrayLike) -> tuple[Component, ...]:
    """Make the 13 components x, y, z, q0..q3, u..r of eta (..., 6) and nu (..., 6)."""
    x, y, z, phi, theta, psi = split(eta)
    ch, sh = np.cos, np.sin
    c1, s1, c2, s2 = ch(phi / 2), sh(phi / 2), ch(theta / 2), sh(theta / 2)
    c3, s3 = ch(psi / 2), sh(psi / 2)
    quaternion = (
        c3 * c2 * c1 + s3 * s2 * s1,
        c3 * c2 * s1 - s3 * s2 * c1,
        s3 * c2 * s1 + c3 * s2 * c1,
        s3 * c2 * c1 - c3 * s2 * s1,
    )
    if np.ndim(x) == 0:
        quaternion = tuple(float(part) for part in quaternion)  # type: ignore[assignment]
    return (x, y, z, *quaternion, *split(nu))


def euler(state: Components) -> tuple[float, float, float]:
    """Roll, pitch and yaw (rad) of one vehicle; at a pitch of ±90° yaw takes all of the rotation."""
    q0, q1, q2, q3 = state[3:7]
    phi = math.atan2(2 * (q0 * q1 + q2 * q3), 1 - 2 * (q1 * q1 + q2 * q2))
    theta = math.asin(max(-1.0, min(1.0, 2 * (q0 * q2 - q3 * q1))))
    psi = math.atan2(2 * (q0 * q3 + q1 * q2), 1 - 2 * (q2 * q2 + q3 * q3))
    return phi, theta, psi


def rotation(state: Components) -> tuple[Component, ...]:
    """R, body to NED (Fossen 2.70), row by row."""
    q0, q1, q2, q3 = state[3:7]
    return (
        1 - 2 * (q2 * q2 + q3 * q3),
        2 * (q1 * q2 - q0 * q3),
        2 * (q1 * q3 + q0 * q2),
        2 * (q1 * q2 + q0 * q3),
        1 - 2 * (q1 * q1 + q3 * q3),
        2 * (q2 * q3 - q0 * q1),
        2 * (q1 * q3 - q0 * q2),
        2 * (q2 * q3 + q0 * q1),
        1 - 2 * (q1 * q1 + q2 * q2),
    )


class Plant:
    """The equations of motion. Parameters may be floats or arrays that broadcast with the dives."""

    def __init__(
        self,
        mass: Component,
        inertia: Components,
        added_mass: Components,
        linear: Components,
        quadratic: Components,
        net_buoyancy: Component,
        zb: Component,
        height: Component,
    ) -> None:
        self.m = mass
        self.added_mass = tuple(added_mass)
        self.linear = tuple(linear)
        self.quadratic = tuple(quadratic)
        self.Ix, self.Iy, self.Iz = inertia
        self.W = mass * GRAVITY
        self.B = self.W + net_buoyancy
        self.zb = zb
        self.height = height
        Xa, Ya, Za, Ka, Ma, Na = self.added_mass
        self.M = (mass + Xa, mass + Ya, mass + Za, self.Ix + Ka, self.Iy + Ma, self.Iz + Na)

    @classmethod
    def of(cls, hull: Hull) -> "Plant":
        """One vehicle from its configuration."""
        return cls(
            hull.mass_kg,
            hull.inertia_kg_m2,
            hull.added_mass,
            hull.linear_damping,
            hull.quadratic_damping,
            hull.net_buoyancy_n,
            hull.centre_of_buoyancy_up_m,
            hull.height_m,
        )

    def buoyancy(self, z: Component) -> Component:
        """Buoyancy (N): whole below the surface, lost over `height` above it."""
        lost = 0.5 * (abs(z) - z) / self.height
        return self.B * (1 - 0.5 * (lost + 1 - abs(lost - 1)))

    def derivative(
        self, state: Components, tau: Components, force: Components, flow: Components
    ) -> tuple[Component, ...]:
        """Time derivative of the 13 components.

        Args:
            state: x, y, z, q0..q3, u, v, w, p, q, r.
            tau: X, Y, Z, K, M, N of the thrusters, body frame (N, N·m).
            force: external force at the centre of gravity, NED (N).
            flow: velocity and acceleration of the water, NED (m/s, m/s²).

        """
        _, _, z, q0, q1, q2, q3, u, v, w, p, q, r = state
        X, Y, Z, K, M, N = tau
        Xa, Ya, Za = self.added_mass[:3]
        Xl, Yl, Zl, Kl, Ml, Nl = self.linear
        Xq, Yq, Zq, Kq, Mq, Nq = self.quadratic
        Mx, My, Mz, Mk, Mm, Mn = self.M
        m = self.m
        r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation(state)

        vn, ve, vd, an, ae, ad = flow
        uc = r11 * vn + r21 * ve + r31 * vd
        vc = r12 * vn + r22 * ve + r32 * vd
        wc = r13 * vn + r23 * ve + r33 * vd
        au = r11 * an + r21 * ae + r31 * ad
        av = r12 * an + r22 * ae + r32 * ad
        aw = r13 * an + r23 * ae + r33 * ad
        ur, vr, wr = u - uc, v - vc, w - wc

        B = self.buoyancy(z)
        fn, fe, fd = force
        fd = fd + self.W - B
        displaced = B / GRAVITY
        fx = r11 * fn + r21 * fe + r31 * fd + displaced * au
        fy = r12 * fn + r22 * fe + r32 * fd + displaced * av
        fz = r13 * fn + r23 * fe + r33 * fd + displaced * aw

        return (
            r11 * u + r12 * v + r13 * w,
            r21 * u + r22 * v + r23 * w,
            r31 * u + r32 * v + r33 * w,
            -0.5 * (q1 * p + q2 * q + q3 * r),
            0.5 * (q0 * p + q2 * r - q3 * q),
            0.5 * (q0 * q + q3 * p - q1 * r),
            0.5 * (q0 * r + q1 * q - q2 * p),
            (
                X + fx - m * (q * w - r * v)
                + Xa * (au - q * wc + r * vc) - (q * Za * wr - r * Ya * vr) - (Xl + Xq * abs(ur)) * ur
            ) / Mx,
            (
                Y + fy - m * (r * u - p * w)
                + Ya * (av - r * uc + p * wc) - (r * Xa * ur - p * Za * wr) - (Yl + Yq * abs(vr)) * vr
            ) / My,
            (
                Z + fz - m * (p * v - q * u)
                + Za * (aw - p * vc + q * uc) - (p * Ya * vr - q * Xa * ur) - (Zl + Zq * abs(wr)) * wr
            ) / Mz,
            (K - self.zb * B * r32 - (Mn - Mm) * q * r - (Za - Ya) * vr * wr - (Kl + Kq * abs(p)) * p) / Mk,
            (M + self.zb * B * r31 - (Mk - Mn) * r * p - (Xa - Za) * ur * wr - (Ml + Mq * abs(q)) * q) / Mm,
            (N - (Mm - Mk) * p * q - (Ya - Xa) * ur * vr - (Nl + Nq * abs(r)) * r) / Mn,
        )  # fmt: skip

    def step(
        self, state: Components, tau: Components, force: Components, flow: Components, dt: float
    ) -> tuple[tuple[Component, ...], tuple[Component, ...]]:
        """One midpoint (RK2) step; returns the new state and nu' (body, at the middle of the step)."""
        half = 0.5 * dt
        slope = self.derivative(state, tau, force, flow)
        middle = [a + half * b for a, b in zip(state, slope, strict=True)]
        slope = self.derivative(middle, tau, force, flow)
        x, y, z, q0, q1, q2, q3, *nu = [a + dt * b for a, b in zip(state, slope, strict=True)]
        norm = (q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3) ** -0.5
        return (x, y, z, q0 * norm, q1 * norm, q2 * norm, q3 * norm, *nu), slope[7:]

    def disturbance(self, state: Components, force: Components, flow: Components) -> tuple[Component, ...]:
        """Tell what acts besides thrusters and still-water model: NED force (N), body moment (N·m).

        The wrench of this water, these forces and the net buoyancy, less that of still water on a neutrally
        buoyant vehicle at the same state (added mass, Coriolis, damping, righting moment).
        Level: (m + Za) z'' = Z - (Zl + Zq |z'|) z' + disturbance[2]; the paper's d is its negative.
        """
        none = (0.0,) * 6
        neutral = (0.0, 0.0, self.buoyancy(state[2]) - self.W)
        real = self.derivative(state, none, force, flow)[7:]
        still = self.derivative(state, none, neutral, STILL_WATER)[7:]
        X, Y, Z, K, M, N = (mass * (a - b) for mass, a, b in zip(self.M, real, still, strict=True))
        r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation(state)
        return (
            r11 * X + r12 * Y + r13 * Z,
            r21 * X + r22 * Y + r23 * Z,
            r31 * X + r32 * Y + r33 * Z,
            K,
            M,
            N,
        )
