"""A DVL's BlueOS extension as it speaks to the vehicle: VISION_POSITION_DELTA of the truth."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

PERIOD_S = 0.1


class DvlExtension:
    """Says how far the vehicle came, in its own axes, every PERIOD_S; `sent` are its frames.

    It speaks as system 255, component 0, as the extension does by mavlink2rest.
    """

    def __init__(self):
        self._mavlink = mavlink.MAVLink(None, 255, 0)
        self._next_s = 0.0
        self.sent = []

    def says(self, truth, t_s):
        """Return what it says now, a frame or nothing."""
        if t_s < self._next_s - 1e-9:
            return []
        self._next_s = t_s + PERIOD_S
        way, turn = ([float(one) * PERIOD_S for one in truth.nu[part]] for part in (slice(3), slice(3, 6)))
        message = mavlink.MAVLink_vision_position_delta_message(
            round(t_s * 1e6), round(PERIOD_S * 1e6), turn, way, 90.0
        )
        frame = message.pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        self.sent.append(frame)
        return [frame]
