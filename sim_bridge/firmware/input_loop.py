"""ArduSub as seen from its links: who may steer, its input loop, telemetry, parameters, routing."""

import math
from collections import deque
from operator import attrgetter

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_bridge.firmware import absent, reports
from sim_bridge.firmware import mode_behaviour as modes
from sim_bridge.firmware.board import NOWHERE, Board, Origin
from sim_bridge.firmware.failsafes import Failsafes
from sim_bridge.firmware.mav_cmd import CommandHandler
from sim_bridge.firmware.mixer import mix, motor_pwm
from sim_bridge.firmware.packing import Message
from sim_bridge.firmware.params import DEFAULTS
from sim_bridge.firmware.result_texts import BOOT_TEXTS, INFO, WARNING
from sim_bridge.firmware.stream_schedule import TRANSFER_SLOWDOWN

INPUT_PERIOD_S = 0.02
TIMESYNC_PERIOD_S = 10.0
PARAMETERS_PER_STEP = 10
ORIGIN_SHIFT_M = 0.1
"""How far relative_alt is off for good when the origin is set while dived."""
EXTERNAL_NAVIGATION = 6
LEAST_DELTA_S, LEAST_APART_S = 0.01, 0.02
"""VISION_POSITION_DELTA: shortest time that it may span, and that has to lie between two."""
DIRECTIONS = tuple(f"MOT_{motor}_DIRECTION" for motor in range(1, 9))
CHANNELS_RAW = attrgetter(*(f"chan{channel}_raw" for channel in range(1, 19)))
PARAMETERS = tuple(f"param{number}" for number in range(1, 8))
DEEPEST_M = 1000.0
STICK = 1000
"""MANUAL_CONTROL of a full stick; z goes from 0 to this."""
NO_POSITION, NO_Z = 0b111, 1 << 2
"""Bits of a type_mask: what to ignore."""


class Autopilot(Board):
    """The firmware's behaviour from one boot to the next; `_on_heartbeat` takes HEARTBEAT, and so on."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._next_input_s = 0.0
        self._next_timesync_s = TIMESYNC_PERIOD_S
        self._withheld: Origin | None = None
        """What the origin will be once it may be set."""
        self._boot_texts = deque(BOOT_TEXTS if self.rebooted else ())
        self._commands = CommandHandler(self)
        self.failsafes = Failsafes(self)
        self._delta_s = -math.inf
        """When the EKF last took a VISION_POSITION_DELTA."""

    def receive(self, link: int, data: bytes) -> None:
        """Take in bytes from a link. Garbage is skipped; messages for others are forwarded."""
        for message in self.links[link].parse(data):
            kind = message.get_type()
            if kind == "BAD_DATA" or kind.startswith("UNKNOWN"):
                continue
            self.links[link].heard.add((message.get_srcSystem(), message.get_srcComponent()))
            name = "mission" if kind in absent.MISSION_PROTOCOL else kind.lower()
            if self._routed(link, message) and (handler := getattr(self, f"_on_{name}", None)):
                handler(link, message)

    def update(self, boot_s: float, dt: float) -> list[int]:
        """Input loop, failsafes and control of one step; returns the motors' PWM (µs)."""
        self.boot_s = boot_s
        if boot_s >= self._next_input_s - 1e-9:
            self._next_input_s += INPUT_PERIOD_S
            self.pilot.input_loop()
            self.input_is_new = True
            self.failsafes.check()
            self._say_what_is_due()
        if not self.armed:
            self.motor_pwm, self.last_demand = self.idle, None
            return self.motor_pwm
        if self.mode == modes.SURFACE and self.estimate().depth_m < -self.params["SURFACE_DEPTH"] / 100.0:
            self.set_mode(modes.ALT_HOLD)
        if self.mode == modes.MANUAL and not self.input_is_new:
            return self.motor_pwm
        self.input_is_new = False
        estimate = None if self.mode == modes.MANUAL else self.estimate()
        demand = self.control.demand(self.pilot, estimate, boot_s, dt)
        if demand != self.last_demand:
            self.last_demand = demand
            ways = [-1.0 if self.params[name] < 0 else 1.0 for name in DIRECTIONS[: len(self.idle)]]
            self.motor_pwm = motor_pwm(mix(self.frame, demand), ways)
        return self.motor_pwm

    def telemetry(self) -> list[tuple[int, bytes]]:
        """All that leaves after a step: answers first, then what the streams owe."""
        for number, link in self.links.items():
            for message in link.streams.due(self.boot_s, TRANSFER_SLOWDOWN if link.parameters else 1.0):
                for built in reports.build(message, self):
                    self.send(number, built)
            for _ in range(min(PARAMETERS_PER_STEP, len(link.parameters))):
                self.send(number, self._param_value(link.parameters.popleft(), listed=True))
        if self.boot_s >= self._next_timesync_s:
            self._next_timesync_s += TIMESYNC_PERIOD_S
            self.broadcast(mavlink.MAVLink_timesync_message(0, self._boot_ns()))
        out, self.out = self.out, []
        return out

    def yaw_was_reset(self, turn_rad: float) -> None:
        """Say so, and hold the same true heading."""
        self.say(INFO, "EKF3 IMU0 MAG0 in-flight yaw alignment complete")
        self.control.yaw_was_reset(turn_rad)

    def move_stick(self, axis: str, deflection: float) -> None:
        """Hear MANUAL_CONTROL of a ground station with its own link; a router shows it to all others."""
        x, y, r = (round(STICK * deflection) if axis == name else 0 for name in "xyr")
        z = round(STICK / 2 * (1.0 + (deflection if axis == "z" else 0.0)))
        message = mavlink.MAVLink_manual_control_message(self.system, x, y, z, r, buttons=0)
        system = int(self.params["MAV_GCS_SYSID"])
        self.failsafes.hear_pilot()
        self.pilot.manual_control(x, y, z, r, buttons=0, s=0, t=0)
        self.out += [(number, link.pack(message, system)) for number, link in self.links.items()]

    def withhold_origin(self, held: bool) -> None:
        """Have no origin and take none, or get one again."""
        if held and self._withheld is None:
            self._withheld, self.origin = self.origin or NOWHERE, None
        elif not held and self._withheld is not None:
            origin, self._withheld = self._withheld, None
            self._set_origin(origin)

    def aid(self, aided: bool) -> None:
        """Lose the horizontal position, or have it again, and say so."""
        if aided != self.has_position:
            self.has_position = aided
            if aided:
                relative = self.sensors.dead_reckons
                self.say(
                    INFO,
                    f"EKF3 IMU0 {'started relative aiding' if relative else 'is using external nav data'}",
                )
            else:
                self.say(WARNING, "EKF3 IMU0 stopped aiding")

    # Steering

    def _steers(self, message: Message) -> bool:
        """Whether the sender may steer; if so it is pilot input and the ground station's sign of life."""
        if message.get_srcSystem() != int(self.params["MAV_GCS_SYSID"]):
            return False
        self.failsafes.hear_pilot()
        return True

    def _on_heartbeat(self, _: int, message: Message) -> None:
        if message.get_srcSystem() == int(self.params["MAV_GCS_SYSID"]):
            self.failsafes.hear_ground_station()

    def _on_manual_control(self, _: int, message: Message) -> None:
        if message.target == self.system and self._steers(message):
            self.pilot.manual_control(
                message.x, message.y, message.z, message.r, message.buttons, message.s, message.t
            )

    def _on_rc_channels_override(self, _: int, message: Message) -> None:
        if self._steers(message):
            self.pilot.override(CHANNELS_RAW(message))

    # Commands

    def _on_command_long(self, link: int, message: Message) -> None:
        p = [float(getattr(message, name, math.nan)) for name in PARAMETERS]
        if message.get_type() == "COMMAND_INT":
            p[4:] = [message.x, message.y, message.z]
        result = self._commands.obey(link, message.command, p)
        peer = (message.get_srcSystem(), message.get_srcComponent())
        self.send(link, mavlink.MAVLink_command_ack_message(message.command, result, 0, 0, *peer))

    _on_command_int = _on_command_long

    def _say_what_is_due(self) -> None:
        while self._boot_texts and self._boot_texts[0][0] <= self.boot_s:
            self.say(INFO, self._boot_texts.popleft()[1])

    def _on_set_mode(self, _: int, message: Message) -> None:
        """Change the mode; the firmware acknowledges only the command of that purpose."""
        if message.base_mode & 1:
            self.set_mode(message.custom_mode)

    def _on_request_data_stream(self, link: int, message: Message) -> None:
        rate = float(message.req_message_rate) if message.start_stop else 0.0
        self.links[link].streams.set_group(message.req_stream_id, rate, self.boot_s)

    def _on_timesync(self, link: int, message: Message) -> None:
        if message.tc1 == 0:
            self.send(link, mavlink.MAVLink_timesync_message(self._boot_ns(), message.ts1))

    def _on_set_gps_global_origin(self, _: int, message: Message) -> None:
        if self.origin is None and self._withheld is None:
            self._set_origin(Origin(message.latitude, message.longitude, message.altitude))

    def _set_origin(self, origin: Origin) -> None:
        if self.estimate().depth_m > 0.2:
            self.sensors.shift_relative(ORIGIN_SHIFT_M)
        self.origin = origin
        self.broadcast(mavlink.MAVLink_gps_global_origin_message(*origin, round(self.boot_s * 1e6)))

    def _on_vision_position_delta(self, _: int, message: Message) -> None:
        """Give the EKF what is sound, no faster than it takes them, where it is set up for them."""
        configured = self.params["VISO_TYPE"] and self.params["EK3_SRC1_VELXY"] == EXTERNAL_NAVIGATION
        lasted_s = message.time_delta_usec * 1e-6
        numbers = (*message.angle_delta, *message.position_delta, message.confidence)
        sound = lasted_s >= LEAST_DELTA_S and all(map(math.isfinite, numbers))
        if configured and sound and self.boot_s - self._delta_s >= LEAST_APART_S:
            self._delta_s = self.boot_s
            self.sensors.hear_odometry(tuple(message.position_delta), lasted_s)

    def _on_file_transfer_protocol(self, link: int, message: Message) -> None:
        if answer := absent.file_answer(message):
            self.send(link, answer)

    def _on_mission(self, link: int, message: Message) -> None:
        answer = absent.mission_answer(message)
        self.send(link, answer)
        if getattr(answer, "type", None) == mavlink.MAV_MISSION_NO_SPACE:
            self.say(WARNING, absent.NO_SPACE_TEXT)

    def _on_set_position_target_global_int(self, _: int, message: Message) -> None:
        """Take a depth over the EKF's origin in ALT_HOLD, where it comes alone."""
        altitude_m = message.alt - (self.origin.alt_mm / 1000.0 if self.origin else 0.0)
        is_depth_alone = message.coordinate_frame == mavlink.MAV_FRAME_GLOBAL_INT and (
            message.type_mask & NO_POSITION == NO_POSITION & ~NO_Z
        )
        if self.mode == modes.ALT_HOLD and is_depth_alone and math.isfinite(altitude_m):
            self.control.depth_target = max(0.0, min(DEEPEST_M, -altitude_m))

    def _on_log_request_list(self, link: int, _: Message) -> None:
        self.send(link, mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))

    def _on_autopilot_version_request(self, link: int, _: Message) -> None:
        self._commands.request(link, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)

    def _on_setup_signing(self, _: int, message: Message) -> None:
        """Take a key from whoever may speak; all zero takes it away. The firmware never tells it on."""
        self.keys.set_up(bytes(message.secret_key), message.initial_timestamp)
        for number, link in self.links.items():
            link.sign(self.keys, number)

    # Parameters

    def _on_param_request_read(self, link: int, message: Message) -> None:
        if message.param_index < 0:
            name = _text(message.param_id)
        elif message.param_index < len(self.params.names):
            name = self.params.names[message.param_index]
        else:
            return
        if name in self.params:
            self.send(link, self._param_value(name, listed=message.param_index >= 0))

    def _on_param_request_list(self, link: int, _: Message) -> None:
        self.say_banner(link)
        self.links[link].parameters = deque(self.params.names)

    def _on_param_set(self, _: int, message: Message) -> None:
        name = _text(message.param_id)
        if name in self.params and math.isfinite(message.param_value):
            self.params.set(name, message.param_value)
            self.last_demand, self.input_is_new = None, True
            self.broadcast(self._param_value(name, listed=False))

    def _param_value(self, name: str, *, listed: bool) -> Message:
        """Tell a parameter; its place in the list only where it was asked by that."""
        return mavlink.MAVLink_param_value_message(
            name.encode(),
            self.params[name],
            DEFAULTS[name].type,
            len(self.params.names),
            self.params.index[name] if listed else 65535,
        )

    def _routed(self, source: int, message: Message) -> bool:
        """Forward a message to other links; tell whether the autopilot takes it too.

        Broadcasts go to all links that have been heard, others to where their target was heard. What is for
        a component of our system that nobody has heard of is the autopilot's.
        """
        system = getattr(message, "target_system", getattr(message, "target", 0))
        component = getattr(message, "target_component", 0)
        ours = system == self.system
        if ours and component == mavlink.MAV_COMP_ID_AUTOPILOT1:
            return True
        forwarded = False
        for number, link in self.links.items():
            if number != source and any(
                system in (0, heard) and (not ours or component in (0, part)) for heard, part in link.heard
            ):
                self.out.append((number, bytes(message.get_msgbuf())))
                forwarded = True
        return system == 0 or (ours and (component == 0 or not forwarded))

    def _boot_ns(self) -> int:
        return round(self.boot_s * 1e9)


def _text(raw: str | bytes) -> str:
    return raw.decode(errors="replace") if isinstance(raw, bytes) else raw
