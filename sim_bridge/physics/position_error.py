"""How far the EKF's horizontal position is off: dead reckoning between a DVL and slow USBL fixes.

| symbol | meaning | unit |
|---|---|---|
| e, v | error of one component's position and velocity | m, m/s |
| P_ee, P_ev, P_vv | their covariance, as the filter believes it | m², m²/s, m²/s² |
| q | growth of the velocity's error without a DVL | m/s per √s |
| w | growth of the position's error with one | m per √s |

    without a DVL:  e' = v,          v' = q n
    with one:       e' = v + w n,    v = (R − 1) times the true velocity, R being the turn by a wrong heading
    a fix:          e, v += K (σ n − e),    K = (P_ee, P_ev) / (P_ee + σ²)
    a DVL's report: e, v += K (v_r − v),    K = (P_ev, P_vv) / (P_vv + σ_r²),    v_r: error of what it says

Where single reports are configured, e' = v between them, and P_vv grows as the firmware has it.

Both components share the covariance; each n is unit white noise of its own.
"""

import math

import numpy as np

from sim_bridge.sim_config import SensorConfig

UNAIDED_S = 15.0
"""Without any aid the firmware's EKF gives its position up after this time (tiltDriftTimeMax_ms)."""

ODOMETRY_SIGMA_M_S = 0.1
"""The firmware's noise of odometry with full confidence (its VELERR_MIN)."""
BELIEVED_M_S = 0.35 * math.sqrt(0.012)
"""The firmware's growth of P_vv: EK3_ACC_P_NSE, once in each step of its EKF; m/s per √s."""


class PositionErrors:
    """The errors of north and east; where nothing is configured they stay zero."""

    def __init__(self, config: SensorConfig, step_s: float, rng: np.random.Generator) -> None:
        self.error = [0.0, 0.0]
        self.speed_error = [0.0, 0.0]
        self.aided = not config.dvl_by_mavlink
        """Whether the EKF still has a horizontal position."""
        self._usbl = config.usbl
        self._step_s = step_s
        reports = config.dvl_reports
        self._grow = (reports if reports.enabled else config).unaided_m_s * math.sqrt(step_s)
        self._believed = BELIEVED_M_S * math.sqrt(step_s) if reports.enabled else self._grow
        self._walk = config.dvl_defects.walk_per_sqrt_s * math.sqrt(step_s)
        self._rng = rng
        self.p_ee = self._p_ev = self.p_vv = 0.0
        self._unaided_s = 0.0 if self.aided else UNAIDED_S
        self._until_fix_s = config.usbl.period_s

    def step(self, misled: tuple[float, float], *, locked: bool) -> None:
        """Go on by one step; the DVL measures if it is `locked`.

        A wrong heading makes more of its velocity than is true, by `misled`, north and east (m/s).
        """
        dt, normal = self._step_s, self._rng.standard_normal
        self._unaided_s = 0.0 if locked else self._unaided_s + dt
        if locked:
            self.speed_error = list(misled)
            self._p_ev = self.p_vv = 0.0
            self.p_ee += self._walk**2
            kicks = [self._walk * float(normal()) for _ in misled] if self._walk else [0.0, 0.0]
            self.error = [e + v * dt + kick for e, v, kick in zip(self.error, misled, kicks, strict=True)]
        elif self.aided:
            self.error = [e + v * dt for e, v in zip(self.error, self.speed_error, strict=True)]
            self.speed_error = [v + self._grow * float(normal()) for v in self.speed_error]
            self.p_ee += dt * (2.0 * self._p_ev + dt * self.p_vv)
            self._p_ev += dt * self.p_vv
            self.p_vv += self._believed**2
        if self._usbl.enabled:
            self._until_fix_s -= dt
            if self._until_fix_s <= 0.0:
                self._until_fix_s += self._usbl.period_s
                if self._rng.random() >= self._usbl.missed:
                    self._fix()
        self.aided = self._unaided_s < UNAIDED_S

    def report(self, misled: tuple[float, float]) -> None:
        """Take a single report of a DVL; `misled` as in `step`."""
        share = self.p_vv + ODOMETRY_SIGMA_M_S**2
        k_e, k_v = self._p_ev / share, self.p_vv / share
        for i, v_r in enumerate(misled):
            innovation = v_r - self.speed_error[i]
            self.error[i] += k_e * innovation
            self.speed_error[i] += k_v * innovation
        self.p_ee -= k_e * self._p_ev
        self._p_ev *= 1.0 - k_v
        self.p_vv *= 1.0 - k_v
        self._unaided_s = 0.0

    def _fix(self) -> None:
        sigma_m = self._usbl.sigma_m
        share = self.p_ee + sigma_m**2
        k_e, k_v = (self.p_ee / share, self._p_ev / share) if share else (1.0, 0.0)
        for i in range(2):
            innovation = sigma_m * float(self._rng.standard_normal()) - self.error[i]
            self.error[i] += k_e * innovation
            self.speed_error[i] += k_v * innovation
        self.p_ee, self._p_ev, self.p_vv = (
            (1.0 - k_e) * self.p_ee,
            (1.0 - k_e) * self._p_ev,
            self.p_vv - k_v * self._p_ev,
        )
        self._unaided_s = 0.0
