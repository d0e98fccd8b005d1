"""What the firmware's EKF and raw sensors report of the true motion: delay, slow and white noise, scale."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from sim_bridge.config import SensorConfig
from sim_bridge.physics.environment import OrnsteinUhlenbeck
from sim_bridge.physics.plant import GRAVITY, State, Three, between, down_axis, euler, ned_velocity

SURFACE_PRESSURE_HPA = 1013.25
PA_PER_M = 9800.0
"""The firmware's pascals per metre at BARO_SPEC_GRAV = 1."""
NOISE_PERIOD_S = 0.01
PRESSURE_PERIOD_S = 0.1
HISTORY_S = 0.6
ACCEL_FILTER_DELAY_S = 0.01
"""Of the accelerometer inside the firmware: INS_ACCEL_FILTER, 20 Hz."""


class Estimate(NamedTuple):
    """One reading of everything, SI, NED; depths positive down."""

    roll: float
    pitch: float
    yaw: float
    rollspeed: float
    pitchspeed: float
    yawspeed: float
    depth_m: float
    """Relative to home; the EKF's main height."""
    climb_m_s: float
    """Positive up."""
    altitude_m: float
    """Positive up, relative to the EKF's origin: another offset than that of depth_m."""
    raw_altitude_m: float
    """Positive up, straight from the pressure (AHRS2)."""
    pressure_hpa: float
    accel: Three
    """Specific force, body (m/s²)."""
    position: tuple[float, float, float, float]
    """x, y, vx, vy (NED), meaningful with a DVL only."""
    rise_m_s2: float
    """Acceleration upwards over the ground, from the filtered accelerometer, as the depth loop sees it."""


class Sensors:
    """Keeps a short history of the true motion and reports from it."""

    def __init__(self, config: SensorConfig, step_s: float, rng: np.random.Generator) -> None:
        self._config = config
        self._step_s = step_s
        slow_rng, self._white_rng, offset_rng = rng.spawn(3)
        self._white: list[float] = []
        self._history: deque[tuple[State, Three]] = deque(maxlen=int(HISTORY_S / step_s))

        def noise(sigma: float, tau_s: float) -> OrnsteinUhlenbeck:
            return OrnsteinUhlenbeck(sigma, tau_s, NOISE_PERIOD_S, slow_rng)

        self._depth = noise(config.depth_slow_m, config.slow_tau_s)
        self._climb = noise(config.climb_slow_m_s, config.slow_tau_s)
        self._drift = noise(config.drift_m, config.drift_tau_s)
        self._angles = [noise(config.attitude_slow_rad, 5.0) for _ in range(3)]
        self._position = [noise(config.dvl_drift_m, 60.0) for _ in range(2)]
        slow = [self._depth, self._climb, self._drift, *self._angles, *self._position]
        self._slow = [signal for signal in slow if signal.varies]
        self._noise_steps = max(1, round(NOISE_PERIOD_S / step_s))
        self._pressure_steps = max(1, round(PRESSURE_PERIOD_S / step_s))
        self._count = 0
        self._offset_rng = offset_rng
        self._relative_offset, self._altitude_offset, self._raw_offset = (
            config.offset_m * float(n) for n in offset_rng.standard_normal(3)
        )
        self._turned_rad, self._north_m, self._east_m = 0.0, 0.0, 0.0
        self._raw_depth = 0.0
        self._estimate: Estimate | None = None

    def record(self, state: State, acceleration: Three, wave_m: float) -> None:
        """Take in the truth of one step.

        Args:
            state: x, y, z, quaternion, nu (SI, NED and body).
            acceleration: over the ground, in body axes (m/s²).
            wave_m: dynamic wave pressure there, in metres of water.

        """
        if self._config.wave_pressure and wave_m:
            x, y, z, q0, q1, q2, q3, u, v, w, p, q, r = state
            state = (x, y, z + wave_m, q0, q1, q2, q3, u, v, w, p, q, r)
        self._history.append((state, acceleration))
        self._estimate = None
        if self._count % self._noise_steps == 0:
            for signal in self._slow:
                signal.step()
        if self._count % self._pressure_steps == 0:
            depth = self._delayed(self._config.pressure_delay_s)[0][2]
            self._raw_depth = (
                self._config.depth_scale * depth + self._config.pressure_white_m * self._normal()
            )
        self._count += 1

    def rezero(self) -> None:
        """Arming moves the zero of relative_alt."""
        self._relative_offset = self._config.offset_m * float(self._offset_rng.standard_normal())
        self._estimate = None

    def shift_relative(self, offset_m: float) -> None:
        """Put relative_alt off for good, as an origin that is set while dived does."""
        self._relative_offset += offset_m
        self._estimate = None

    def reset_yaw(self, turn_rad: float, x_m: float, y_m: float) -> None:
        """Turn yaw and all further motion over ground; where it is, truly (x, y), stays what it was."""
        x_before, y_before = self._turned(x_m, y_m)
        self._turned_rad += turn_rad
        x_after, y_after = self._turned(x_m, y_m)
        self._north_m += x_before - x_after
        self._east_m += y_before - y_after
        self._estimate = None

    def reset_position(self, north_m: float) -> None:
        """Put the estimated position further north."""
        self._north_m += north_m
        self._estimate = None

    def _turned(self, north: float, east: float) -> tuple[float, float]:
        c, s = math.cos(self._turned_rad), math.sin(self._turned_rad)
        return c * north - s * east, s * north + c * east

    def estimate(self, specific_gravity: float) -> Estimate:
        """Read everything. `specific_gravity` is BARO_SPEC_GRAV: depths are divided by it."""
        if self._estimate is None:
            self._estimate = self._read(specific_gravity)
        return self._estimate

    def _read(self, specific_gravity: float) -> Estimate:
        config, normal = self._config, self._normal
        scale = config.depth_scale / specific_gravity
        attitude, _ = self._delayed(config.attitude_delay_s)
        height, _ = self._delayed(config.depth_delay_s)
        motion, _ = self._delayed(config.climb_delay_s)
        roll, pitch, yaw = euler(attitude)
        roll += self._angles[0].value + config.attitude_white_rad * normal()
        pitch += self._angles[1].value + config.attitude_white_rad * normal()
        yaw += self._angles[2].value + config.attitude_white_rad * normal()
        rollspeed = attitude[10] + config.gyro_white_rad_s * normal()
        pitchspeed = attitude[11] + config.gyro_white_rad_s * normal()
        yawspeed = attitude[12] + config.gyro_white_rad_s * normal()
        north, east, sink = ned_velocity(motion)
        depth = scale * height[2] + self._depth.value + self._drift.value + config.depth_white_m * normal()
        climb = -scale * sink + self._climb.value + config.climb_white_m_s * normal()
        felt, push = self._delayed(ACCEL_FILTER_DELAY_S)
        down = down_axis(felt)
        rise = -(push[0] * down[0] + push[1] * down[1] + push[2] * down[2])
        accel = self._accelerometer()
        position = (0.0, 0.0, 0.0, 0.0)
        if config.dvl:
            x, y = self._turned(height[0], height[1])
            vx, vy = self._turned(north, east)
            position = (
                x + self._north_m + self._position[0].value + config.dvl_white_m * normal(),
                y + self._east_m + self._position[1].value + config.dvl_white_m * normal(),
                vx + config.dvl_white_m * normal(),
                vy + config.dvl_white_m * normal(),
            )
        return Estimate(
            roll=roll,
            pitch=pitch,
            yaw=math.remainder(yaw + self._turned_rad, math.tau),
            rollspeed=rollspeed,
            pitchspeed=pitchspeed,
            yawspeed=yawspeed,
            depth_m=depth + self._relative_offset,
            climb_m_s=climb,
            altitude_m=-depth + self._altitude_offset,
            raw_altitude_m=-self._raw_depth / specific_gravity + self._raw_offset,
            pressure_hpa=SURFACE_PRESSURE_HPA + PA_PER_M * self._raw_depth / 100.0,
            accel=accel,
            position=position,
            rise_m_s2=rise,
        )

    def _accelerometer(self) -> Three:
        """Specific force, body (m/s²)."""
        shaken, (ax, ay, az) = self._delayed(self._config.accel_delay_s)
        forward, right, down = down_axis(shaken)
        white, normal = self._config.accel_white_m_s2, self._normal
        return (
            ax - GRAVITY * forward + white * normal(),
            ay - GRAVITY * right + white * normal(),
            az - GRAVITY * down + white * normal(),
        )

    def _delayed(self, delay_s: float) -> tuple[State, Three]:
        """State and acceleration `delay_s` ago, between two steps of the history."""
        back = delay_s / self._step_s
        whole = int(back)
        part = back - whole
        history = self._history
        newest = len(history) - 1
        state, accel = history[max(0, newest - whole)]
        if part < 1e-9:
            return state, accel
        older, older_accel = history[max(0, newest - whole - 1)]
        ax, ay, az = accel
        bx, by, bz = older_accel
        mixed = (ax + part * (bx - ax), ay + part * (by - ay), az + part * (bz - az))
        return between(state, older, part), mixed

    def _normal(self) -> float:
        if not self._white:
            self._white = self._white_rng.standard_normal(512).tolist()
        return self._white.pop()
