"""The stand-in vehicle: an ArduSub ROV in the water, seen from its MAVLink wire.

One step of `vehicle.Vehicle` (5 ms), read from left to right:

    bytes in -> links -> autopilot (params, pilot, modes, mixer) -> PWM -> thrusters -> plant -> sensors
                  ^                                                           ^           ^         |
               faults                                                      battery   environment    v
                  v                                                                                 |
    bytes out <- links <- messages <- streams, autopilot <------------------------------------------+

- `physics`: the water (`environment`, `waves`), what floats in it (`body`, `plant`, `thrusters`) and what it
  feels (`sensors`, `defects`, `position`). Fossen's notation, NED, SI.
- `autopilot` and its parts `params`, `pilot`, `modes`, `mixer`, `streams`, `messages`: the firmware's habits.
- `fault_kinds`, `faults`: what can break; what breaks, and when. `config`: TOML into frozen records.
- `vehicle`: composes the above; pure, seeded, steps in virtual time.
- `app` and `zenoh_link`: the only sockets, clocks and threads. `commands`: the `holdfast sim` command.

Nothing here is shared with `companion`: only MAVLink and the facts about the vehicle are.
"""
