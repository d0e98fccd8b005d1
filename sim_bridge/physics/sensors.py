"""What the firmware's EKF and raw sensors report of the true motion: delay, noise, scale, defects."""

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from sim_bridge.physics.defects import Defective
from sim_bridge.physics.dvl import DELAY_S as REPORT_DELAY_S
from sim_bridge.physics.dvl import DvlReporter
from sim_bridge.physics.ekf_height import NO_HEIGHT_ERROR, drawn_off
from sim_bridge.physics.environment import OrnsteinUhlenbeck
from sim_bridge.physics.plant import GRAVITY, State, Three, between, down_axis, euler, ned_velocity
from sim_bridge.physics.position_error import PositionErrors
from sim_bridge.physics.rangefinder import LIMITS_M, RangeFault, Rangefinder
from sim_bridge.sim_config import Seabed, SensorConfig, Steel

SURFACE_PRESSURE_HPA = 1013.25
PA_PER_M = 9800.0
"""The firmware's pascals per metre at BARO_SPEC_GRAV = 1."""
NOISE_PERIOD_S = 0.01
PRESSURE_PERIOD_S, PRESSURE_DELAY_S = 0.1, 0.065
ACCEL_DELAY_S, ACCEL_WHITE_M_S2 = 0.038, 0.004
"""Delays and noise of SCALED_PRESSURE and RAW_IMU (docs/ardusub.md, "Telemetry")."""
HISTORY_S = 0.6
ACCEL_FILTER_DELAY_S = 0.01
"""Delay of the firmware's accelerometer filter: INS_ACCEL_FILTER, 20 Hz."""


EARTH_NORTH_UT = 21.9
"""Horizontal part of the earth's field, as the firmware's compasses have it."""
COMPASS_TAU_S = 12.5
"""How slowly the EKF follows the compass away from its gyros: docs/ardusub.md."""
LAGGING_SHARE, LAGGING_FROM_S = 0.71, 20.0
"""With GPS the EKF's depth showed this share of the motion; how slow a motion it shows whole is assumed."""
NEAREST_M = 0.3
"""A dipole's field is not a dipole's nearer than this."""
ODOMETRY_LASTS_S = 0.2
"""The firmware takes odometry that is older for none."""
NORMALS_OF_A_READING = 16
"""At most so many normal numbers go into a reading."""

Sample: TypeAlias = tuple[State, Three]
"""State, and acceleration over the ground in body axes (m/s²)."""


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
    range_m: float
    """The rangefinder's range; NaN: no echo."""
    rise_m_s2: float
    """Acceleration upwards over the ground, from the filtered accelerometer, as the depth loop sees it."""


KEPT_WITHOUT_DEPTH = ("depth_m", "climb_m_s", "altitude_m")
KEPT_WITHOUT_ATTITUDE = ("roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed")


def deviation(steel: Steel, state: State) -> float:
    """Return by how much steel turns magnetic north clockwise (rad) where the vehicle is.

    The field of a dipole m at r: (3 (m r̂) r̂ − m) / |r|³.
    """
    r = [here - there for here, there in zip(state[:3], steel.place_m, strict=True)]
    distance = max(math.sqrt(sum(part * part for part in r)), NEAREST_M)
    along = 3.0 * sum(m * part for m, part in zip(steel.moment_ut_m3, r, strict=True)) / distance**2
    north, east, _ = ((along * part - m) / distance**3 for m, part in zip(steel.moment_ut_m3, r, strict=True))
    return math.atan2(east, EARTH_NORTH_UT + north)


class Sensors:
    """Keeps a short history of the true motion and reports from it."""

    def __init__(
        self,
        config: SensorConfig,
        step_s: float,
        rng: np.random.Generator,
        seabed: Seabed | None = None,
        steel: Steel | None = None,
    ) -> None:
        """Begin without a reading. DVL and rangefinder measure over `seabed`; `steel` turns the compass."""
        self._config = config
        self._step_s = step_s
        slow_rng, self._white_rng, offset_rng, *defect_rngs, range_rng, report_rng = rng.spawn(10)
        self._odometry: tuple[float, float] = (0.0, 0.0)
        self._odometry_age_s = math.inf
        self._seabed = seabed
        self._rangefinder = Rangefinder(config, step_s, range_rng, seabed)
        self._steel = steel
        self._deviation_rad = self._turned_north_rad = 0.0
        self._dvl_silenced = False
        self._noise_m = self._lag_s = self._mean_depth_m = 0.0
        self._depth_defects, self._attitude_defects, self._dvl_defects = (
            Defective(defects, NOISE_PERIOD_S, one)
            for defects, one in zip(
                (config.depth_defects, config.attitude_defects, config.dvl_defects),
                defect_rngs,
                strict=False,
            )
        )
        self._errors = PositionErrors(config, NOISE_PERIOD_S, defect_rngs[3]) if config.positioned else None
        reports = config.dvl_reports
        self._reports = DvlReporter(reports, NOISE_PERIOD_S, report_rng) if reports.enabled else None
        self._white: list[float] = []
        self._history: deque[Sample] = deque(maxlen=int(HISTORY_S / step_s))
        self._height_error = NO_HEIGHT_ERROR

        def noise(sigma: float, tau_s: float) -> OrnsteinUhlenbeck:
            return OrnsteinUhlenbeck(sigma, tau_s, NOISE_PERIOD_S, slow_rng)

        self._depth = noise(config.depth_slow_m, config.slow_tau_s)
        self._climb = noise(config.climb_slow_m_s, config.slow_tau_s)
        self._drift = noise(config.drift_m, config.drift_tau_s)
        self._angles = [noise(config.attitude_slow_rad, 5.0) for _ in range(3)]
        self._unit_noise = OrnsteinUhlenbeck(1.0, config.slow_tau_s, NOISE_PERIOD_S, defect_rngs[4])
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
        self._last: Estimate | None = None
        spoilt = self._depth_defects.active or self._attitude_defects.active or self._dvl_defects.active
        self._is_spoilt = bool(steel or self._errors or spoilt)

    def record(self, state: State, acceleration: Three, wave_m: float) -> None:
        """Take in the truth of one step: acceleration (body, m/s²), pressure of the waves (m of water)."""
        if self._config.wave_pressure and wave_m:
            x, y, z, q0, q1, q2, q3, u, v, w, p, q, r = state
            state = (x, y, z + wave_m, q0, q1, q2, q3, u, v, w, p, q, r)
        self._history.append((state, acceleration))
        deeper_m = self._depth_before(self._config.barometer_late_s) - state[2]
        self._height_error = drawn_off(self._height_error, deeper_m, self._step_s)
        if self._lag_s:
            self._mean_depth_m += (state[2] - self._mean_depth_m) * self._step_s / LAGGING_FROM_S
        self._estimate = None
        if self._count % self._noise_steps == 0:
            for signal in self._slow:
                signal.step()
            if self._noise_m:
                self._unit_noise.step()
            if self._is_spoilt:
                self._step_defects(state)
        self._rangefinder.step(self._count, state)
        if self._count % self._pressure_steps == 0:
            depth = self._delayed(PRESSURE_DELAY_S)[2]
            raw = self._config.depth_scale * depth + self._config.pressure_white_m * self._normal()
            if not self._depth_defects.out:
                self._raw_depth = self._depth_defects.rounded(raw + self._depth_defects.bias)
        self._count += 1

    @property
    def aided(self) -> bool:
        """Whether the EKF has a horizontal position."""
        return self._errors is not None and self._errors.aided

    @property
    def barometer_without_home(self) -> bool:
        """Whether relative_alt is the pressure's until there is a home."""
        return self._config.barometer_without_home

    @property
    def dead_reckons(self) -> bool:
        """Whether the EKF gets velocities and no position."""
        return self._config.dvl_by_mavlink and not self._config.usbl.enabled

    @property
    def range_limits_m(self) -> tuple[float, float]:
        """Least and largest range of the rangefinder; 0 without one."""
        return LIMITS_M if self._config.rangefinder else (0.0, 0.0)

    def disturb(
        self,
        turned_rad: float,
        *,
        dvl_out: bool,
        ranges: RangeFault,
        depth_noise_m: float,
        depth_lag_s: float,
    ) -> None:
        """Turn magnetic north clockwise (rad), silence the DVL, spoil the rangefinder and the EKF's depth."""
        self._rangefinder.fault = ranges
        if depth_lag_s and not self._lag_s and self._history:
            self._mean_depth_m = self._history[-1][0][2]
        self._noise_m, self._lag_s = depth_noise_m, depth_lag_s
        if turned_rad:
            self._is_spoilt = True
        self._turned_north_rad, self._dvl_silenced = turned_rad, dvl_out

    def _step_defects(self, state: State) -> None:
        for defects in (self._depth_defects, self._attitude_defects, self._dvl_defects):
            defects.step()
        north_rad = self._turned_north_rad + (deviation(self._steel, state) if self._steel else 0.0)
        if north_rad or self._deviation_rad:
            behind = math.remainder(north_rad - self._deviation_rad, math.tau)
            self._deviation_rad += behind * NOISE_PERIOD_S / COMPASS_TAU_S
        if self._errors:
            self._odometry_age_s += NOISE_PERIOD_S
            self._step_position(self._errors, state)

    def _step_position(self, errors: PositionErrors, state: State) -> None:
        config, misled, locked = self._config, self._odometry, self._is_locked(state)
        north, east, _ = ned_velocity(state)
        if self._heading_error() and not (config.dvl_by_mavlink or config.dvl_knows_north):
            seen_north, seen_east = self._as_measured(state, state[7:10])
            misled = (seen_north - north, seen_east - east)
        if self._reports:
            off = self._reports.step(math.hypot(*state[10:]))
            if locked and off is not None:
                late = self._delayed(REPORT_DELAY_S)
                said_north, said_east = self._as_measured(state, late[7:10])
                errors.report((said_north - north + off[0], said_east - east + off[1]))
        errors.step(misled, locked=locked and not self._reports)

    def hear_odometry(self, way_m: Three, lasted_s: float) -> None:
        """Take how far a DVL says the vehicle came in its own axes (m) in a time, as the EKF fuses it."""
        now, before = self._delayed(0.0), self._delayed(lasted_s)
        north, east = self._as_measured(now, way_m)
        came_north, came_east = now[0] - before[0], now[1] - before[1]
        self._odometry = ((north - came_north) / lasted_s, (east - came_east) / lasted_s)
        self._odometry_age_s = 0.0

    def _as_measured(self, state: State, body: Three) -> tuple[float, float]:
        """Turn a velocity in the vehicle's axes to north and east, as the EKF does with a wrong heading."""
        north, east, _ = ned_velocity((*state[:7], *body, *state[10:]))
        c, s = math.cos(self._heading_error()), math.sin(self._heading_error())
        return c * north - s * east, s * north + c * east

    def _heading_error(self) -> float:
        return self._attitude_defects.bias - self._deviation_rad

    def _is_locked(self, state: State) -> bool:
        config = self._config
        over_m = math.nan if self._seabed is None else self._seabed.depth_at(state[0], state[1]) - state[2]
        in_range = math.isnan(over_m) or config.dvl_min_altitude_m <= over_m <= config.dvl_max_altitude_m
        out = self._dvl_defects.out or self._dvl_silenced
        if config.dvl_by_mavlink:
            return not out and self._odometry_age_s <= ODOMETRY_LASTS_S
        return config.dvl and not out and in_range

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
            if self._is_spoilt:
                self._last = self._estimate = self._spoilt(self._estimate)
        return self._estimate

    def _spoilt(self, fresh: Estimate) -> Estimate:
        """Return a reading as defects and the compass leave it."""
        last = self._last or fresh
        depth, attitude, dvl = self._depth_defects, self._attitude_defects, self._dvl_defects
        position = last.position
        if self._errors and self._errors.aided:
            x, y, vx, vy = fresh.position
            (e_x, e_y), (e_vx, e_vy) = self._errors.error, self._errors.speed_error
            position = (x + e_x, y + e_y, dvl.rounded(vx + e_vx), dvl.rounded(vy + e_vy))
        bias = attitude.bias - self._deviation_rad
        spoilt = fresh._replace(
            depth_m=depth.rounded(fresh.depth_m + depth.bias),
            altitude_m=depth.rounded(fresh.altitude_m - depth.bias),
            roll=attitude.rounded(fresh.roll),
            pitch=attitude.rounded(fresh.pitch),
            yaw=attitude.rounded(math.remainder(fresh.yaw + bias, math.tau)),
            position=position,
        )
        kept = (KEPT_WITHOUT_DEPTH if depth.out else ()) + (KEPT_WITHOUT_ATTITUDE if attitude.out else ())
        return spoilt._replace(**{name: getattr(last, name) for name in kept})

    def _read(self, specific_gravity: float) -> Estimate:
        config = self._config
        normal = self._white.pop if len(self._white) >= NORMALS_OF_A_READING else self._normal
        scale = config.depth_scale / specific_gravity
        attitude = self._delayed(config.attitude_delay_s + self._attitude_defects.late_s)
        motion = self._delayed(config.climb_delay_s + self._depth_defects.late_s)
        late_s = config.depth_delay_s + self._depth_defects.late_s
        z = self._depth_before(late_s + self._lag_s) + self._height_error.depth_m
        if self._lag_s:
            z = self._mean_depth_m + LAGGING_SHARE * (z - self._mean_depth_m)
        roll, pitch, yaw = euler(attitude)
        roll += self._angles[0].value + config.attitude_white_rad * normal()
        pitch += self._angles[1].value + config.attitude_white_rad * normal()
        yaw += self._angles[2].value + config.attitude_white_rad * normal()
        rollspeed = attitude[10] + config.gyro_white_rad_s * normal()
        pitchspeed = attitude[11] + config.gyro_white_rad_s * normal()
        yawspeed = attitude[12] + config.gyro_white_rad_s * normal()
        r31, r32, r33 = down_axis(motion)
        sink = r31 * motion[7] + r32 * motion[8] + r33 * motion[9] + self._height_error.sink_m_s
        depth = (
            scale * z
            + self._noise_m * self._unit_noise.value
            + self._depth.value
            + self._drift.value
            + config.depth_white_m * normal()
        )
        climb = -scale * sink + self._climb.value + config.climb_white_m_s * normal()
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
            accel=self._accelerometer(normal),
            position=self._place(normal),
            range_m=self._rangefinder.range_m,
            rise_m_s2=self._rise(),
        )

    def _place(self, normal: Callable[[], float]) -> tuple[float, float, float, float]:
        if not self._errors:
            return 0.0, 0.0, 0.0, 0.0
        white, seen = self._config.dvl_white_m, self._delayed(self._config.dvl_delay_s)
        north, east, _ = ned_velocity(seen)
        x, y = self._turned(seen[0], seen[1])
        vx, vy = self._turned(north, east)
        return (
            x + self._north_m + self._position[0].value + white * normal(),
            y + self._east_m + self._position[1].value + white * normal(),
            vx + white * normal(),
            vy + white * normal(),
        )

    def _rise(self) -> float:
        """Acceleration upwards from the filtered accelerometer (m/s²)."""
        (a, b, c), (forward, right, down) = self._felt(ACCEL_FILTER_DELAY_S)
        return -(a * forward + b * right + c * down)

    def _accelerometer(self, normal: Callable[[], float]) -> Three:
        """Specific force, body (m/s²)."""
        (a, b, c), (forward, right, down) = self._felt(ACCEL_DELAY_S)
        white = ACCEL_WHITE_M_S2
        return (
            a - GRAVITY * forward + white * normal(),
            b - GRAVITY * right + white * normal(),
            c - GRAVITY * down + white * normal(),
        )

    def _felt(self, delay_s: float) -> tuple[Three, Three]:
        """Acceleration over the ground (m/s²) and NED's down `delay_s` ago, both in body axes."""
        (newer, (a, b, c)), (older, (d, e, f)), part = self._around(delay_s)
        state = between(newer, older, part) if part else newer
        return (a + part * (d - a), b + part * (e - b), c + part * (f - c)), down_axis(state)

    def _delayed(self, delay_s: float) -> State:
        """State `delay_s` ago."""
        (newer, _), (older, _), part = self._around(delay_s)
        return between(newer, older, part) if part else newer

    def _depth_before(self, delay_s: float) -> float:
        """Depth `delay_s` ago."""
        (newer, _), (older, _), part = self._around(delay_s)
        return newer[2] + part * (older[2] - newer[2])

    def _around(self, delay_s: float) -> tuple[Sample, Sample, float]:
        """Return what was recorded just after and before a time `delay_s` ago, and how far back it lies."""
        back = delay_s / self._step_s
        whole = int(back)
        part = back - whole
        history = self._history
        newest = len(history) - 1
        newer = history[max(0, newest - whole)]
        if part < 1e-9:
            return newer, newer, 0.0
        return newer, history[max(0, newest - whole - 1)], part

    def _normal(self) -> float:
        if not self._white:
            self._white = self._white_rng.standard_normal(512).tolist()
        return self._white.pop()
