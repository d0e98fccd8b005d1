"""What the stand-in vehicle makes of axes: its mixer and its geometry share no line with `allocation`."""

import numpy as np
from sim_wire import CONFIG

from sim_bridge.firmware.mixer import mix, motor_pwm
from sim_bridge.physics.thrusters import each_motor, static_thrust, thrusters_of, wrench
from sim_bridge.sim_config import load_config

FRAMES = {"vectored_6dof": CONFIG, "vectored": CONFIG.with_name("sim-bluerov2.toml")}


def true_wrench(frame, axes, voltage_v=16.0, dead=0, turned=0):
    """Surge, sway, heave, yaw, roll, pitch after its lag; `dead` gives nothing, `turned` the opposite."""
    vehicle = thrusters_of(load_config(FRAMES[frame]).thrusters)
    surge, sway, heave, yaw, roll, pitch = (*axes, 0.0, 0.0)[:6]
    ways = [-1.0 if motor == turned else 1.0 for motor in range(1, vehicle.number + 1)]
    pwm = motor_pwm(mix(frame, (roll, pitch, yaw, -heave, surge, sway)), ways)
    a, b, c, d, e, f, g, h = (float(motor != dead) for motor in range(1, 9))
    given = static_thrust(vehicle, (a, b, c, d, e, f, g, h), each_motor(pwm), voltage_v)
    X, Y, Z, K, M, N = wrench(vehicle, given)
    return np.array((X, Y, Z, N, K, M))
