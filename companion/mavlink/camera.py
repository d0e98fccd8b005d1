"""Pictures that the autopilot is asked for, and what became of them (docs/ardusub.md, "Camera").

A question is not repeated: a second picture would be of another place.
"""

from collections.abc import Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.encode import Commands
from companion.mavlink.messages import Message
from companion.records import CommandAck, Event

ANSWER_S: Final = 2.0
NONE_TAKEN: Final = (
    "ArduSub took no picture: CAM1_TYPE names no camera, or CAM1_INTRVAL_MIN has not passed since the last"
)
OLD: Final = (
    "this ArduSub knows no MAV_CMD_IMAGE_START_CAPTURE: from now on it is asked by DO_DIGICAM_CONTROL"
)


class Camera:
    """Every camera that the autopilot triggers."""

    def __init__(self, commands: Commands) -> None:
        self._commands = commands
        self._old = False
        """Whether this firmware knows DO_DIGICAM_CONTROL alone, which it accepts without a camera too."""
        self._asked_s: float | None = None
        self.failure = ""
        """Why the last picture was not taken; empty where it was, or where there is no answer yet."""

    def ask(self, now_s: float) -> Message:
        """Return what asks for a picture now."""
        if self._asked_s is None:
            self._asked_s = now_s
        return self._commands.take_picture(old=self._old)

    def take(self, now_s: float, events: Sequence[Event]) -> None:
        """Take the answers among what came."""
        for event in events:
            if not isinstance(event, CommandAck) or self._asked_s is None:
                continue
            if event.command == mavlink.MAV_CMD_IMAGE_START_CAPTURE:
                self._old |= event.result == mavlink.MAV_RESULT_UNSUPPORTED
                failure = OLD if self._old else NONE_TAKEN
                self._answered("" if event.result == mavlink.MAV_RESULT_ACCEPTED else failure)
            elif event.command == mavlink.MAV_CMD_DO_DIGICAM_CONTROL:
                accepted = event.result == mavlink.MAV_RESULT_ACCEPTED
                self._answered(
                    "" if accepted else f"ArduSub refused to take a picture: result {event.result}"
                )
        if self._asked_s is not None and now_s - self._asked_s > ANSWER_S:
            self._answered("ArduSub did not answer the question for a picture")

    def _answered(self, failure: str) -> None:
        self._asked_s, self.failure = None, failure
