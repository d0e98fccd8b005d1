"""Newtons to normalised axis demands and back: thruster curve, dead band, voltage, shared saturation.

ArduSub turns axis demands a (surge, sway, heave, yaw; -1..1) into motor demands t = M a, and motor demands
linearly into PWM; what a motor then pushes is T(t), which is neither linear nor symmetric. So a wrench is
shared out over the motors, the curve is inverted motor by motor, and the result is read back as axes:

    f = B⁺ tau        t = T⁻¹(f)        a = M⁺ t        and what it really gives:  tau = B T(M a)

M holds ArduSub's mixing factors and B = S Mᵀ the geometry, S the force or moment per newton on each axis.
"""

from dataclasses import dataclass

import numpy as np

from lab.batch.legacy.bounds import bounded
from lab.batch.legacy.records import Array, Flags

# T200 at 16 V (ArduSub facts): motor demand t = (PWM - 1500)/400 against newtons.
T200_PWM_US = np.array([1100, 1200, 1300, 1400, 1440, 1472, 1528, 1560, 1600, 1700, 1800, 1900], float)
T200_N = np.array([-39.9, -26.6, -14.1, -4.7, -1.8, 0.0, 0.0, 2.2, 5.9, 17.9, 33.5, 51.5])
T200_DEMAND = (T200_PWM_US - 1500.0) / 400.0
T200_VOLTAGE_V = 16.0
DEAD_BAND_N = 0.02
"""Half-width, per motor, over which the inverted curve crosses the dead band: a slope instead of a jump."""

MIN_REACH = 1e-6
NEWTON_STEPS = 2
SLOPE_STEP = 0.1

_INVERSE_N = T200_N + np.where(T200_N == 0.0, np.sign(T200_DEMAND) * DEAD_BAND_N, 0.0)

# Motor by motor: surge, sway, heave (down), yaw, roll and pitch factors of ArduSub's frames.
_HORIZONTAL = [(-1, 1, 0, 1, 0, 0), (-1, -1, 0, -1, 0, 0), (1, 1, 0, -1, 0, 0), (1, -1, 0, 1, 0, 0)]
_FACTORS = {
    "vectored": [*_HORIZONTAL, (0, 0, 1, 0, 1, 0), (0, 0, 1, 0, -1, 0)],
    "vectored_6dof": [
        *_HORIZONTAL,
        *((0, 0, 1, 0, roll, pitch) for roll, pitch in ((1, -1), (-1, -1), (1, 1), (-1, 1))),
    ],
}
HORIZONTAL = len(_HORIZONTAL)
_UPRIGHT = np.array([False, False, True, False, True, True])
"""Which axes the vertical motors serve."""

_PER_NEWTON = np.array([np.sqrt(0.5), np.sqrt(0.5), 1.0, np.sqrt(0.5) * (0.156 + 0.111), 0.218, 0.12])


@dataclass(frozen=True, slots=True)
class Allocation:
    """`axes` (4,) to send and, by DOF of the body frame, whether more was asked than they can give."""

    axes: Array
    saturated: Flags


class Thrusters:
    """One frame's thrusters. Arrays of shape (…, axes) in the order surge, sway, heave, yaw, roll, pitch.

    `frame` is "vectored" or "vectored_6dof"; `max_tau` bounds what is asked of each axis, N and N·m, and its
    length says how many axes are ours: 4, with roll 5, with roll and pitch 6 (which `vectored` cannot).
    """

    def __init__(self, frame: str, max_tau: Array) -> None:
        self.factors = np.array(_FACTORS[frame], float)
        """(n, 6): what each motor does for a demand on surge, sway, heave, yaw, roll, pitch."""
        self.levers = _PER_NEWTON[:, None] * self.factors.T
        """(6, n): the wrench of one newton of each motor; N, and N·m for yaw, roll, pitch."""
        self.axes = axes = max_tau.shape[-1]
        self._M, self._B = self.factors[:, :axes], self.levers[:axes]
        self._M_inverse = np.linalg.pinv(self._M)
        self._B_inverse = np.linalg.pinv(self._B)
        self._upright = _UPRIGHT[:axes]
        self._tilts = axes > 4
        self._max_tau = max_tau
        self._groups = (HORIZONTAL, len(self.factors) - HORIZONTAL)

    def allocate(self, tau: Array, voltage_v: float, reach: Array) -> Allocation:
        """Return the axes that give body wrench `tau`, each within ±`reach`, motors within ±1.

        Where a motor group (horizontal, vertical) would exceed the end of its curve or its reach, the whole
        group is scaled, as the firmware does, so that the direction of the force is kept.
        """
        asked = bounded(tau, self._max_tau)
        short = asked != tau
        forces = asked @ self._B_inverse.T / _strength(voltage_v)
        load = np.maximum(forces / T200_N[-1], forces / T200_N[0])
        if load.max() > 1.0:
            scale = self._by_axis(load[..., :HORIZONTAL].max(-1), load[..., HORIZONTAL:].max(-1))
            forces = forces / np.repeat(scale[..., [0, 2]], self._groups, axis=-1)
            short |= scale > 1.0
        axes = np.interp(forces, _INVERSE_N, T200_DEMAND) @ self._M_inverse.T
        if self._tilts or asked[..., :2].any():
            axes = self._refined(axes, forces)
        over = np.abs(axes) / np.maximum(reach, MIN_REACH)
        load = np.abs(axes @ self._M.T)
        if over.max() > 1.0 or load.max() > 1.0:
            across = np.maximum(over[..., ~self._upright].max(-1), load[..., :HORIZONTAL].max(-1))
            upright = np.maximum(over[..., self._upright].max(-1), load[..., HORIZONTAL:].max(-1))
            scale = self._by_axis(across, upright)
            axes = axes / scale
            short |= scale > 1.0
        return Allocation(axes, short)

    def _refined(self, axes: Array, forces: Array) -> Array:
        """Newton steps on B T(M a) = B f: mends what averaging motors of unequal curves costs."""
        wanted = forces @ self._B.T
        for _ in range(NEWTON_STEPS):
            motors = axes @ self._M.T
            missing = wanted - np.interp(motors, T200_DEMAND, _INVERSE_N) @ self._B.T
            slope = np.interp(motors + SLOPE_STEP, T200_DEMAND, _INVERSE_N)
            slope -= np.interp(motors - SLOPE_STEP, T200_DEMAND, _INVERSE_N)
            J = (self._B * (slope / (2.0 * SLOPE_STEP))[..., None, :]) @ self._M
            axes = axes + np.linalg.solve(J, missing[..., None])[..., 0]
        return axes

    def delivered(self, axes: Array, voltage_v: float) -> Array:
        """Return the body wrench (…, axes) that the axes really give, N and N·m, at the nominal curve."""
        motors = axes @ self._M.T
        return np.asarray(np.interp(motors, T200_DEMAND, T200_N) @ self._B.T * _strength(voltage_v))

    def motors(self, axes: Array) -> Array:
        """Return the demand (…, n) on each motor that the firmware makes of axes (…, axes)."""
        return np.asarray(axes @ self._M.T)

    def overloaded(self, axes: Array) -> Flags:
        """Tell by axis (axes,) whether its motor group is asked more than a motor can give."""
        load = [abs(motor) > 1.01 for motor in self.motors(axes).tolist()]
        return np.where(self._upright, any(load[HORIZONTAL:]), any(load[:HORIZONTAL]))

    def axes_from_motors(self, motors: Array) -> Array:
        """Return the axes (…, axes) that make the firmware ask `motors` (…, n) of its thrusters: M⁺ t."""
        return np.asarray(motors @ self._M_inverse.T)

    @property
    def count(self) -> int:
        """How many motors the frame has."""
        return len(self._M)

    def _by_axis(self, across: Array, upright: Array) -> Array:
        """Return by how much to divide each axis, at least 1: the axes of a group share their motors."""
        by_group = np.stack((np.maximum(across, 1.0), np.maximum(upright, 1.0)), axis=-1)
        return np.asarray(by_group[..., self._upright.astype(int)])


def _strength(voltage_v: float) -> float:
    """Thrust goes about with the square of the voltage (ArduSub facts)."""
    return (voltage_v / T200_VOLTAGE_V) ** 2
