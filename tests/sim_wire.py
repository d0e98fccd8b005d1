"""A ground station in memory: what the tests of the stand-in vehicle say and hear, in virtual time."""

from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.sim_config import load_config
from sim_bridge.vehicle import Vehicle

CONFIG = Path(__file__).parent.parent / "config" / "sim.toml"
CALM = ("current.enabled=false", "hull.net_buoyancy_n=0.0")
STABILIZE, ALT_HOLD, SURFACE, MANUAL = 0, 2, 9, 19
ARM, SET_MODE, SET_INTERVAL, REQUEST = 400, 176, 511, 512


def vehicle(*overrides, seed=1, config=CONFIG):
    return Vehicle(load_config(config, [*CALM, *overrides]), seed)


def is_finite(rov):
    truth = rov.truth()
    return bool(np.isfinite([*truth.eta, *truth.nu, *truth.thrust_n, truth.voltage_v]).all())


class Station:
    """System 255 on one link of a vehicle; `heard` is every message so far, as (time, message)."""

    def __init__(self, rov, link=0, system=255, component=190):
        self.rov = rov
        self.link = link
        self.packer = mavlink.MAVLink(None, system, component)
        self.parser = mavlink.MAVLink(None)
        self.heard = []
        self.queue = []
        rov.open_link(link)

    def say(self, message):
        self.queue.append((self.link, message.pack(self.packer)))
        self.packer.seq = (self.packer.seq + 1) % 256
        return self

    def command(self, number, *params, target=1):
        rest = [0.0] * (7 - len(params))
        return self.say(mavlink.MAVLink_command_long_message(target, 1, number, 0, *params, *rest))

    def run(self, seconds=0.0, steering=None, every_s=0.02):
        """At least one step. `steering` is a message, or a function from time to a message."""
        heard = []
        period = max(1, round(every_s / self.rov.step_s))
        for count in range(max(1, round(seconds / self.rov.step_s))):
            if steering is not None and count % period == 0:
                self.say(steering(self.rov.time_s) if callable(steering) else steering)
            queue, self.queue = self.queue, []
            for link, data in self.rov.step(queue):
                if link == self.link:
                    heard += [(self.rov.time_s, m) for m in self.parser.parse_buffer(data) or ()]
        self.heard += heard
        return Heard(heard)

    def arm(self, mode=MANUAL):
        """Past the start, armed, in a mode, on a fresh steering message."""
        self.run(2.1)
        self.command(SET_MODE, 1, mode).say(override()).command(ARM, 1).run(0.05)
        assert self.rov.truth().armed
        return self


class Heard(list[tuple[float, Any]]):
    """(time, message) pairs."""

    def of(self, name):
        return [message for _, message in self if message.get_type() == name]

    def times(self, name):
        return [time for time, message in self if message.get_type() == name]

    def last(self, name):
        return self.of(name)[-1]

    def texts(self):
        return [message.text for message in self.of("STATUSTEXT")]

    def result(self, command):
        return [ack.result for ack in self.of("COMMAND_ACK") if ack.command == command][-1]


def override(**axes):
    """RC_CHANNELS_OVERRIDE with offsets in µs by name; all six axes sent, camera left alone."""
    order = ("pitch", "roll", "throttle", "yaw", "forward", "lateral")
    return mavlink.MAVLink_rc_channels_override_message(
        1, 1, *(1500 + axes.get(name, 0) for name in order), 65535, 65535
    )


def manual(x=0, y=0, z=500, r=0, buttons=0, s=0, t=0, target=1):
    return mavlink.MAVLink_manual_control_message(target, x, y, z, r, buttons, 0, 0, s, t)
