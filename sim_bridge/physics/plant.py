"""A rigid body in moving water, six degrees of freedom (Fossen, Handbook of Marine Craft, 2011).

| symbol | meaning | unit | equation |
|---|---|---|---|
| x, y, z | position in NED; z is depth | m | 2.2 |
| q0..q3 | unit quaternion, body to NED | - | 2.68 |
| u, v, w, p, q, r | nu: velocity and rates in the body frame | m/s, rad/s | 2.2 |
| X, Y, Z, K, M, N | tau: force and moment of the thrusters, body frame | N, N·m | 2.2 |
| m, Ix, Iy, Iz | M_RB, origin in the centre of gravity, principal axes | kg, kg·m² | 3.44 |
| Xa..Na | M_A, diagonal, positive | kg, kg·m² | 6.46 |
| Mx..Mn | M_RB + M_A | kg, kg·m² | 6.40 |
| Xl..Nl, Xq..Nq | linear and quadratic damping, positive | N·s/m ... | 6.58 |
| W, B, zb | weight, buoyancy, height of the centre of buoyancy over that of gravity | N, N, m | 4.6 |
| nu_r | velocity relative to the water, nu - nu_c | m/s | 8.6 |

    M_RB nu' + C_RB(nu) nu + M_A nu_r' + C_A(nu_r) nu_r + D(nu_r) nu_r + g = tau + R^T f + B/g R^T a_c  (8.8)

The last term is the Froude-Krylov force of water that accelerates with a_c; its rotation is neglected.
A real vehicle showed less than C_RB and C_A of a diagonal M say of what r v does to surge, r u to sway and
u v to yaw: `coriolis_share` scales these three.
The attitude is a quaternion, so that a tumbling vehicle meets no singularity.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from sim_bridge.sim_config import Hull

GRAVITY = 9.80665

Three: TypeAlias = tuple[float, float, float]
Six: TypeAlias = tuple[float, float, float, float, float, float]
Nine: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]
State: TypeAlias = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float, float
]
"""x, y, z, q0..q3, u..r."""

STILL_WATER = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NO_WRENCH = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Body(NamedTuple):
    """What the equations need to know of a vehicle."""

    m: float
    M: Six
    added_mass: Six
    linear: Six
    quadratic: Six
    W: float
    B: float
    """Buoyancy of the submerged vehicle (N)."""
    zb: float
    height: float
    """Over which buoyancy is lost above the surface (m)."""
    coriolis_share: Three
    """What there is of r v in surge, r u in sway, u v in yaw."""


def body_of(hull: Hull) -> Body:
    """Make the parameters of a configured vehicle."""
    m, W = hull.mass_kg, hull.mass_kg * GRAVITY
    Ix, Iy, Iz = hull.inertia_kg_m2
    Xa, Ya, Za, Ka, Ma, Na = hull.added_mass
    return Body(
        m,
        (m + Xa, m + Ya, m + Za, Ix + Ka, Iy + Ma, Iz + Na),
        hull.added_mass,
        hull.linear_damping,
        hull.quadratic_damping,
        W,
        W + hull.net_buoyancy_n,
        hull.centre_of_buoyancy_up_m,
        hull.height_m,
        hull.coriolis_share,
    )


def state_of(eta: Sequence[float], nu: Sequence[float]) -> State:
    """Make the state of eta (x, y, z, phi, theta, psi) and nu (6)."""
    x, y, z, phi, theta, psi = map(float, eta)
    u, v, w, p, q, r = map(float, nu)
    c1, s1 = math.cos(phi / 2), math.sin(phi / 2)
    c2, s2 = math.cos(theta / 2), math.sin(theta / 2)
    c3, s3 = math.cos(psi / 2), math.sin(psi / 2)
    return (
        x,
        y,
        z,
        c3 * c2 * c1 + s3 * s2 * s1,
        c3 * c2 * s1 - s3 * s2 * c1,
        s3 * c2 * s1 + c3 * s2 * c1,
        s3 * c2 * c1 - c3 * s2 * s1,
        u,
        v,
        w,
        p,
        q,
        r,
    )


def euler(state: State) -> Three:
    """Roll, pitch and yaw (rad); at a pitch of ±90° yaw takes all of the rotation."""
    q0, q1, q2, q3 = state[3:7]
    phi = math.atan2(2 * (q0 * q1 + q2 * q3), 1 - 2 * (q1 * q1 + q2 * q2))
    theta = math.asin(max(-1.0, min(1.0, 2 * (q0 * q2 - q3 * q1))))
    psi = math.atan2(2 * (q0 * q3 + q1 * q2), 1 - 2 * (q2 * q2 + q3 * q3))
    return phi, theta, psi


def rotation(state: State) -> Nine:
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


def down_axis(state: State) -> Three:
    """Return NED's down in body axes: the last row of R."""
    q0, q1, q2, q3 = state[3:7]
    return 2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1 * q1 + q2 * q2)


def ned_velocity(state: State) -> Three:
    """Velocity over the ground (m/s)."""
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation(state)
    u, v, w = state[7:10]
    return r11 * u + r12 * v + r13 * w, r21 * u + r22 * v + r23 * w, r31 * u + r32 * v + r33 * w


def relative_velocity(state: State, flow: Six) -> Six:
    """nu_r: velocity relative to the water (m/s, rad/s, body)."""
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation(state)
    u, v, w, p, q, r = state[7:]
    n, e, d = flow[:3]
    return (
        u - (r11 * n + r21 * e + r31 * d),
        v - (r12 * n + r22 * e + r32 * d),
        w - (r13 * n + r23 * e + r33 * d),
        p,
        q,
        r,
    )


def buoyancy(body: Body, z: float) -> float:
    """Buoyancy (N): whole below the surface, lost over `height` above it."""
    if z >= 0.0:
        return body.B
    return body.B * max(0.0, 1.0 + z / body.height)


def derivative(body: Body, state: State, tau: Six, force: Three, flow: Six) -> State:
    """Time derivative of the state under the thrusters' wrench `tau` (body; N, N·m).

    `force` acts from outside at the centre of gravity (NED, N); `flow` is velocity and acceleration of the
    water (NED; m/s, m/s²).
    """
    m, total_mass, added_mass, linear, quadratic, W, _, zb, _, (s_u, s_v, s_n) = body
    _, _, z, q0, q1, q2, q3, u, v, w, p, q, r = state
    X, Y, Z, K, M, N = tau
    Xa, Ya, Za, _, _, _ = added_mass
    Xl, Yl, Zl, Kl, Ml, Nl = linear
    Xq, Yq, Zq, Kq, Mq, Nq = quadratic
    Mx, My, Mz, Mk, Mm, Mn = total_mass
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation(state)

    vn, ve, vd, an, ae, ad = flow
    uc = r11 * vn + r21 * ve + r31 * vd
    vc = r12 * vn + r22 * ve + r32 * vd
    wc = r13 * vn + r23 * ve + r33 * vd
    au = r11 * an + r21 * ae + r31 * ad
    av = r12 * an + r22 * ae + r32 * ad
    aw = r13 * an + r23 * ae + r33 * ad
    ur, vr, wr = u - uc, v - vc, w - wc

    B = buoyancy(body, z)
    fn, fe, fd = force
    fd = fd + W - B
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
            X + fx - m * (q * w - s_u * r * v)
            + Xa * (au - q * wc + r * vc) - (q * Za * wr - s_u * r * Ya * vr) - (Xl + Xq * abs(ur)) * ur
        ) / Mx,
        (
            Y + fy - m * (s_v * r * u - p * w)
            + Ya * (av - r * uc + p * wc) - (s_v * r * Xa * ur - p * Za * wr) - (Yl + Yq * abs(vr)) * vr
        ) / My,
        (
            Z + fz - m * (p * v - q * u)
            + Za * (aw - p * vc + q * uc) - (p * Ya * vr - q * Xa * ur) - (Zl + Zq * abs(wr)) * wr
        ) / Mz,
        (K - zb * B * r32 - (Mn - Mm) * q * r - (Za - Ya) * vr * wr - (Kl + Kq * abs(p)) * p) / Mk,
        (M + zb * B * r31 - (Mk - Mn) * r * p - (Xa - Za) * ur * wr - (Ml + Mq * abs(q)) * q) / Mm,
        (N - (Mm - Mk) * p * q - s_n * (Ya - Xa) * ur * vr - (Nl + Nq * abs(r)) * r) / Mn,
    )  # fmt: skip


def step(body: Body, state: State, tau: Six, force: Three, flow: Six, dt: float) -> tuple[State, Six]:
    """One midpoint (RK2) step; returns the new state and nu' (body, at the middle of the step)."""
    middle = _advanced(state, derivative(body, state, tau, force, flow), 0.5 * dt)
    slope = derivative(body, middle, tau, force, flow)
    x, y, z, q0, q1, q2, q3, u, v, w, p, q, r = _advanced(state, slope, dt)
    norm = 1.0 / math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    return (x, y, z, q0 * norm, q1 * norm, q2 * norm, q3 * norm, u, v, w, p, q, r), slope[7:]


def between(newer: State, older: State, part: float) -> State:
    """Return the state that lies `part` of the way from `newer` to `older`; quaternion as it comes."""
    x, y, z, q0, q1, q2, q3, u, v, w, p, q, r = newer
    X, Y, Z, Q0, Q1, Q2, Q3, U, V, W, P, Q, R = older
    return (
        x + part * (X - x),
        y + part * (Y - y),
        z + part * (Z - z),
        q0 + part * (Q0 - q0),
        q1 + part * (Q1 - q1),
        q2 + part * (Q2 - q2),
        q3 + part * (Q3 - q3),
        u + part * (U - u),
        v + part * (V - v),
        w + part * (W - w),
        p + part * (P - p),
        q + part * (Q - q),
        r + part * (R - r),
    )


def _advanced(state: State, slope: State, dt: float) -> State:
    x, y, z, q0, q1, q2, q3, u, v, w, p, q, r = state
    dx, dy, dz, d0, d1, d2, d3, du, dv, dw, dp, dq, dr = slope
    return (
        x + dt * dx,
        y + dt * dy,
        z + dt * dz,
        q0 + dt * d0,
        q1 + dt * d1,
        q2 + dt * d2,
        q3 + dt * d3,
        u + dt * du,
        v + dt * dv,
        w + dt * dw,
        p + dt * dp,
        q + dt * dq,
        r + dt * dr,
    )


def disturbance(body: Body, state: State, force: Three, flow: Six) -> Six:
    """Tell what acts besides thrusters and still-water model: NED force (N), body moment (N·m).

    The wrench of this water, these forces and the net buoyancy, less that of still water on a neutrally
    buoyant vehicle at the same state (added mass, Coriolis, damping, righting moment).
    Level: (m + Za) z'' = Z - (Zl + Zq |z'|) z' + disturbance[2]; the paper's d is its negative.
    """
    neutral = (0.0, 0.0, buoyancy(body, state[2]) - body.W)
    real = derivative(body, state, NO_WRENCH, force, flow)[7:]
    still = derivative(body, state, NO_WRENCH, neutral, STILL_WATER)[7:]
    X, Y, Z, K, M, N = (mass * (a - b) for mass, a, b in zip(body.M, real, still, strict=True))
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation(state)
    return (
        r11 * X + r12 * Y + r13 * Z,
        r21 * X + r22 * Y + r23 * Z,
        r31 * X + r32 * Y + r33 * Z,
        K,
        M,
        N,
    )
