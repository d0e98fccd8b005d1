"""The pilot's input as ArduSub treats it: joystick gain, buttons, trims, RC overrides and their latching."""

import math
from collections.abc import Callable, Sequence

from sim_bridge.firmware.params import Parameters

NEUTRAL = 1500
CHANNELS = 18
PITCH, ROLL, THROTTLE, YAW, FORWARD, LATERAL, PAN, TILT = range(8)

FN_SHIFT, FN_ARM_TOGGLE, FN_ARM, FN_DISARM = 1, 2, 3, 4
FN_MODES = {5: 19, 6: 0, 7: 2, 8: 16, 9: 3, 10: 7, 11: 4, 12: 1}
"""Button functions that set a mode, and the mode's number."""
FN_GAIN_TOGGLE, FN_GAIN_INC, FN_GAIN_DEC = 41, 42, 43
FN_INPUT_HOLD, FN_ROLL_PITCH = 48, 49


class Pilot:
    """Channels in µs. `pending` holds overrides since the last input loop; `channels` what is in force.

    `params` are read live, but JS_GAIN_DEFAULT counts at boot only. `press` gets a button's function on the
    edge of its press, if it is not the pilot's own. `say` sends a STATUSTEXT of severity INFO.
    """

    def __init__(self, params: Parameters, press: Callable[[int], None], say: Callable[[str], None]) -> None:
        self._params = params
        self._press = press
        self._say = say
        self.gain = max(params["JS_GAIN_MIN"], min(params["JS_GAIN_MAX"], params["JS_GAIN_DEFAULT"]))
        self.channels = [NEUTRAL] * CHANNELS
        self.pending: dict[int, int] = {}
        self.input_hold = False
        self.roll_pitch = False
        self.held_buttons = 0
        self._last = (0, 0, 500)
        self._trim = (0, 0, 0)
        self._pitch_roll_trim = (0.0, 0.0)
        self._centred_since_hold = True

    def override(self, channels: Sequence[int]) -> None:
        """RC_CHANNELS_OVERRIDE: 65535 leaves a channel alone; 0 clears its override."""
        for index, value in enumerate(channels[:CHANNELS]):
            if value == 65535 or (index >= 8 and value in (0, 65534)):
                continue
            if value == 0:
                self.pending.pop(index, None)
            else:
                self.pending[index] = value

    def manual_control(self, x: int, y: int, z: int, r: int, buttons: int, s: int, t: int) -> None:
        """MANUAL_CONTROL, after `transform_manual_control_to_rc_override`. Camera channels are centred."""
        pending = self.pending
        pending[PAN] = pending[TILT] = NEUTRAL
        self._handle_buttons(buttons, (x, y, z))
        scale = 0.4 * self.gain
        throttle_scale = 0.8 * self.gain * self._params["JS_THR_GAIN"]
        if self.roll_pitch:
            self._pitch_roll_trim = (-x * scale, y * scale)
        if not self._centred_since_hold:
            held = (0, 0, 500)
            self._centred_since_hold = abs(z - 500) < 50 and abs(y) < 50 and abs(x) < 50
        else:
            held = (x, y, z)
        tx, ty, tz = self._trim
        pitch_trim, roll_trim = self._pitch_roll_trim
        pending[PITCH] = _pwm(s + pitch_trim)
        pending[ROLL] = _pwm(t + roll_trim)
        pending[THROTTLE] = _pwm((held[2] + tz - 500) * throttle_scale)
        pending[YAW] = _pwm(r * scale)
        pending[FORWARD] = _pwm((tx if self.roll_pitch else held[0] + tx) * scale)
        pending[LATERAL] = _pwm((ty if self.roll_pitch else held[1] + ty) * scale)
        self._last = (x, y, z)

    def input_loop(self) -> None:
        """Put new overrides in force, 50 times a second. With none, the last values stay."""
        for index, value in self.pending.items():
            self.channels[index] = value
        self.pending.clear()

    def neutralise(self) -> None:
        """Centre the six axes at once. An override that still waits for the input loop will undo it."""
        self.channels[:6] = [NEUTRAL] * 6
        self._pitch_roll_trim = (0.0, 0.0)

    def stick(self, channel: int) -> float:
        """Normalised input in -1..1, no dead band."""
        return max(-1.0, min(1.0, (self.channels[channel] - NEUTRAL) / 400.0))

    def angle_stick(self, channel: int) -> float:
        """Input in -1..1 outside the channel's dead zone (RCn_DZ)."""
        return _outside(self.channels[channel], self._params[f"RC{channel + 1}_DZ"])

    def yaw_stick(self) -> float:
        """Yaw in -1..1 outside a dead zone that shrinks with the gain."""
        return _outside(self.channels[YAW], int(self._params["RC4_DZ"] * self.gain))

    def climb_stick(self, dead_band: float, up_m_s: float, down_m_s: float) -> float:
        """Climb rate (m/s) that the throttle asks for.

        The stick counts from 0 at RC3_MIN plus the dead zone to 1000; `dead_band` (THR_DZ) is in these units
        and shrinks with the gain.
        """
        low, high = self._params["RC3_MIN"] + self._params["RC3_DZ"], self._params["RC3_MAX"]
        stick = max(0.0, min(1000.0, 1000.0 * (self.channels[THROTTLE] - low) / (high - low)))
        middle = 1000.0 * (self._params["RC3_TRIM"] - low) / (high - low)
        top, bottom = middle + dead_band * self.gain, middle - dead_band * self.gain
        if stick > top:
            return up_m_s * (stick - top) / (1000.0 - top)
        return down_m_s * (stick - bottom) / bottom if stick < bottom else 0.0

    def off_centre(self, channel: int) -> bool:
        """Whether a channel is outside its dead zone (RCn_DZ)."""
        return abs(self.channels[channel] - NEUTRAL) > self._params[f"RC{channel + 1}_DZ"]

    def _handle_buttons(self, buttons: int, axes: tuple[int, int, int]) -> None:
        previous, self.held_buttons = self.held_buttons, buttons
        functions = {
            bit: round(self._params[f"BTN{bit}_FUNCTION"]) for bit in range(16) if buttons >> bit & 1
        }
        if FN_SHIFT in functions.values():
            return
        for bit, function in functions.items():
            if not previous >> bit & 1:
                self._pressed(function, axes)

    def _pressed(self, function: int, axes: tuple[int, int, int]) -> None:
        low, high = self._params["JS_GAIN_MIN"], self._params["JS_GAIN_MAX"]
        step = (high - low) / max(1.0, self._params["JS_GAIN_STEPS"] - 1)
        if function in (FN_GAIN_INC, FN_GAIN_DEC):
            self.gain = max(low, min(high, self.gain + (step if function == FN_GAIN_INC else -step)))
            self._say(f"#Gain is {self.gain * 100:2.0f}%")
        elif function == FN_GAIN_TOGGLE:
            self.gain = low if self.gain == high else high
            self._say(f"#Gain is {self.gain * 100:2.0f}%")
        elif function == FN_INPUT_HOLD:
            x, y, z = self._last
            self._trim = (_beyond(x), _beyond(y), _beyond(z - 500))
            was_held, self.input_hold = self.input_hold, any(self._trim)
            if self.input_hold or was_held:
                self._say("#Input Hold Set" if self.input_hold else "#Input Hold Disabled")
            self._centred_since_hold = not self.input_hold
        elif function == FN_ROLL_PITCH:
            self.roll_pitch = not self.roll_pitch
            self._say(f"#{'Attitude Control' if self.roll_pitch else 'Movement Control'}")
        else:
            self._press(function)


def _outside(pwm: int, dead_us: float) -> float:
    """-1..1 outside a dead band around 1500."""
    offset = max(-400, min(400, pwm - NEUTRAL))
    beyond = max(0.0, abs(offset) - dead_us)
    return math.copysign(beyond / (400.0 - dead_us), offset)


def _beyond(value: int) -> int:
    return value if abs(value) > 50 else 0


def _pwm(offset: float) -> int:
    return int(max(1100.0, min(1900.0, NEUTRAL + offset)))
