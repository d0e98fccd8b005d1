"""The stand-in vehicle: an ArduSub ROV in the water, seen from its MAVLink wire.

One step of `vehicle.Vehicle` (5 ms), read from left to right:

    bytes in -> links -> autopilot (params, pilot, modes, mixer) -> PWM -> thrusters -> plant -> sensors
                  ^                                                           ^           ^         |
               faults                                                      battery   environment    v
                  v                                                                                 |
    bytes out <- links <- messages <- streams, autopilot <------------------------------------------+

- `plant`, `thrusters`, `environment`, `sensors`: the water and what floats in it. Fossen's notation, NED, SI.
- `autopilot` and its parts `params`, `pilot`, `modes`, `mixer`, `streams`, `messages`: the firmware's habits.
- `faults`: what breaks, when, as data. `config`: TOML into frozen records.
- `vehicle`: composes the above; pure, seeded, steps in virtual time.
- `app` and `zenoh_truth`: the only sockets, clocks and threads. `commands`: the `holdfast sim` command.

Nothing here is shared with `companion`: only MAVLink and the facts about the vehicle are.
"""
