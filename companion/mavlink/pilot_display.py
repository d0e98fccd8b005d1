"""What the pilot's ground station shows of Holdfast: texts, numbers to plot, and answers to its commands.

The texts are the events of `EventLog`, in the words of `Condition`; what the autopilot says and what somebody
else commands is left out.
"""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.messages import CHUNK_CHARS, Message, message_type
from companion.mavlink.pilot_frames import COMMAND_ACK
from companion.records import (
    AttitudeTarget,
    Condition,
    ControlSample,
    Event,
    PilotAction,
    PilotCommand,
    PilotHeartbeat,
    PositionTarget,
    Refused,
    State,
    Verdict,
    X,
    Z,
)
from companion.telemetry import schemas
from companion.telemetry.glossary import ENDED, STATES, advised, on_engaging

STATUSTEXT: Final = message_type(mavlink.MAVLINK_MSG_ID_STATUSTEXT)
NAMED_VALUE_FLOAT: Final = message_type(mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT)

SEVERITIES: Final = {
    "info": mavlink.MAV_SEVERITY_INFO,
    "warning": mavlink.MAV_SEVERITY_WARNING,
    "fault": mavlink.MAV_SEVERITY_CRITICAL,
}
STATE_SEVERITIES: Final = {**SEVERITIES, "info": mavlink.MAV_SEVERITY_NOTICE}
MAX_BYTES: Final = 6 * CHUNK_CHARS - 1
MOST, MOST_S = 8, 10.0
"""At most MOST texts are sent within MOST_S seconds."""
REPEAT_S: Final = {"state": 0.0, "condition": 30.0, "command": 5.0}
"""The same words come again after this long at the earliest, by kind of event."""
AWAY_S: Final = 5.0
"""A ground station that was silent for this time is told the state again."""
REFUSALS_S: Final = 1.0
"""Between two texts of why something is not done."""
VALUES_S: Final = 0.5  # ArduSub's own rate of NAMED_VALUE_FLOAT
REMEDIES: Final = {condition.text: condition.remedy for condition in Condition}


class Text(NamedTuple):
    """A text that waits until it may go, on a subject such as the state, or a condition."""

    subject: str
    severity: int
    words: str
    repeat_s: float


class Texts:
    """Which texts may go: MOST within MOST_S, faults beyond it, and no words that the pilot has.

    Of each subject only the newest text waits, and is dropped if it says what was said last. So a condition
    that flickers is told once.
    """

    def __init__(self) -> None:
        self._waiting: dict[str, Text] = {}
        self._told: dict[str, str] = {}
        """The last words on each subject."""
        self._until_s: dict[str, float] = {}
        """Words that may not come again yet, and until when."""
        self._sent_s: deque[float] = deque(maxlen=MOST)

    def put(self, text: Text, *, again: bool = False) -> None:
        """Let a text wait, not an older one on its subject; `again` if it is news in the same words."""
        if again:
            self._told.pop(text.subject, None)
        self._waiting[text.subject] = text

    def end(self, text: Text) -> None:
        """Let the end of something wait, if its beginning was told."""
        self._waiting.pop(text.subject, None)
        if text.subject in self._told:
            self.put(text)

    def mark(self, subject: str) -> None:
        """Take a subject for told, in other words."""
        self._told[subject] = ""

    def due(self, now_s: float) -> Iterator[Text]:
        """Give what may go now."""
        if not self._waiting:
            return
        self._until_s = {words: until_s for words, until_s in self._until_s.items() if until_s > now_s}
        for text in sorted(self._waiting.values(), key=lambda text: text.severity):
            subject, words = text.subject, text.words
            if self._told.get(subject) == words:
                del self._waiting[subject]
            elif words not in self._until_s:
                many = len(self._sent_s) == MOST and now_s - self._sent_s[0] < MOST_S
                if many and text.severity > SEVERITIES["fault"]:
                    return
                del self._waiting[subject]
                self._told[subject], self._until_s[words] = words, now_s + text.repeat_s
                self._sent_s.append(now_s)
                yield text


class PilotDisplay:
    """Makes the messages of each tick."""

    def __init__(self) -> None:
        self._texts = Texts()
        self._text_id = 0
        self._values_s = -math.inf
        self._heard_s = math.nan
        self._refused_s, self._refusal = -math.inf, ""
        """When a refusal was told last, and the newest that was not."""

    def step(
        self,
        sample: ControlSample,
        events: Sequence[schemas.Event],
        reports: Sequence[Event],
    ) -> list[Message]:
        """Return answers and texts; `events` are what happened in this tick, `reports` what came in."""
        now_s = sample.state.t_s
        messages = [message for report in reports for message in answers(report, sample)]
        for report in reports:
            self._refusal = refusal(report, sample) or self._refusal
        if self._refusal and now_s - self._refused_s >= REFUSALS_S:
            self._put_command(f"refused: {self._refusal}", mavlink.MAV_SEVERITY_WARNING)
            self._refused_s, self._refusal = now_s, ""
        if math.isnan(self._heard_s):
            self._heard_s = now_s  # the first tick: what it still waits for comes within seconds
            self._put_pending(sample)
        else:
            self._tell(sample.verdict, events)
        if any(isinstance(report, PilotHeartbeat) for report in reports):
            if now_s - self._heard_s > AWAY_S:
                verdict = sample.verdict
                words = f"{verdict.state}: {verdict.reason}"
                self._put_state(words, STATES[verdict.state].severity, verdict.remedy, again=True)
                self._put_pending(sample)
            self._heard_s = now_s
        for text in self._texts.due(now_s):
            messages += self.text(text.severity, text.words)
        return messages

    def plots(self, now_s: float) -> bool:
        """Tell whether `values` are due: once in VALUES_S."""
        due = now_s - self._values_s >= VALUES_S
        self._values_s = now_s if due else self._values_s
        return due

    def _tell(self, verdict: Verdict, events: Sequence[schemas.Event]) -> None:
        """Put what happened. A grave state gives the reason: what begins with it is left out."""
        conditions = [event for event in events if event.kind == "condition"]
        if any(event.kind == "state" and event.severity != "info" for event in events):
            for cause in [event for event in conditions if event.text in REMEDIES][:1]:
                self._texts.mark(cause.text)
            conditions = [event for event in conditions if event.text in ENDED]
        for event in conditions:
            self._put_condition(event, steers=verdict.authority > 0.0)
        for event in events:
            if event.kind == "state":
                self._put_state(event.text, event.severity, verdict.remedy)
            elif event.kind == "command" and event.severity != "info":
                self._put_command(event.text, SEVERITIES[event.severity])

    def text(self, severity: int, words: str) -> list[Message]:
        """Return STATUSTEXTs, in chunks with a common id if the words are longer than one.

        The last one is never full: by that the receiver knows that it is the last.
        """
        raw = words.replace("°", " deg").encode("ascii", "replace")
        if len(raw) > MAX_BYTES:
            raw = raw[: MAX_BYTES - 3] + b"..."
        if len(raw) <= CHUNK_CHARS:
            return [STATUSTEXT(severity=severity, text=raw.decode())]
        raw += b" " * (len(raw) % CHUNK_CHARS == 0)
        self._text_id = self._text_id % 0xFFFF + 1
        return [
            STATUSTEXT(
                severity=severity, text=raw[at : at + CHUNK_CHARS].decode(), id=self._text_id, chunk_seq=n
            )
            for n, at in enumerate(range(0, len(raw), CHUNK_CHARS))
        ]

    def last_words(self, words: str) -> list[Message]:
        """Return a text that does not wait."""
        return self.text(mavlink.MAV_SEVERITY_WARNING, f"Holdfast {words}")

    def _put_state(self, words: str, severity: str, remedy: str, *, again: bool = False) -> None:
        """Tell a new state, or a new course."""
        course = words.partition(":")[0] not in STATES
        todo = remedy if severity != "info" else ""
        text = _text("course" if course else "state", STATE_SEVERITIES[severity], "state", f" {words}", todo)
        self._texts.put(text, again=again or course)

    def _put_command(self, words: str, severity: int) -> None:
        self._texts.put(_text("command", severity, "command", f": {words}"), again=True)

    def _put_pending(self, sample: ControlSample) -> None:
        if words := on_engaging(sample.guided.pending):
            self._put_state(words, "info", "")

    def _put_condition(self, event: schemas.Event, *, steers: bool) -> None:
        """Tell a condition that begins while Holdfast `steers`, and its end."""
        words, severity = event.text, SEVERITIES[event.severity]
        if words in ENDED:
            self._texts.end(_text(ENDED[words], severity, "condition", f": {words}"))
        elif steers and words in REMEDIES:
            self._texts.put(_text(words, severity, "condition", f": {words}", REMEDIES[words]))
        elif steers:
            self._texts.put(_text("condition", severity, "condition", f": {words}"), again=True)


def _text(subject: str, severity: int, kind: str, words: str, remedy: str = "") -> Text:
    return Text(subject, severity, advised(f"Holdfast{words}", remedy), REPEAT_S[kind])


def answers(report: Event, sample: ControlSample) -> Iterator[Message]:
    """Give MAVLink's own answer, where there is one."""
    if isinstance(report, PilotCommand):
        engages, holds = report.action is PilotAction.ENGAGE, report.action is PilotAction.HOLD
        rejected = (engages and sample.refused) or (holds and not any(sample.dofs.engaged))
        result = mavlink.MAV_RESULT_TEMPORARILY_REJECTED if rejected else mavlink.MAV_RESULT_ACCEPTED
        yield COMMAND_ACK(command=mavlink.MAV_CMD_USER_1, result=result)
    elif isinstance(report, Refused) and report.answer is not None:
        yield report.answer


def refusal(report: Event, sample: ControlSample) -> str:
    """Return why a ground station's message is not done, or not all of it; empty if it is."""
    engaged, verdict = sample.dofs.engaged, sample.verdict
    match report:
        case Refused():
            return report.words
        case PilotCommand(action=PilotAction.HOLD) if not any(engaged):
            return "nothing is held: engage first"
        case PositionTarget() | AttitudeTarget() if verdict.authority < 1.0:
            return f"targets are followed with full authority alone, not in {verdict.state}"
        case PositionTarget(place=(x, y, *_), velocity=(u, v, *_)) if not engaged[X]:
            sideways = not (math.isnan(x) and math.isnan(y)) or abs(u) > 0.0 or abs(v) > 0.0
            return "a place north and east needs a position, which does not come" if sideways else ""
    return ""


def values(sample: ControlSample, reserve: float) -> list[Message]:
    """Return the numbers to plot, as docs/wiring.md lists them; `reserve` is what thrust is left, 0..1."""
    state = sample.state
    north, east, down, turning = state.disturbance
    boot_ms = int(1e3 * state.boot_s) & 0xFFFFFFFF if math.isfinite(state.boot_s) else 0
    numbers = {
        "HfState": tuple(State).index(sample.verdict.state),
        "HfDepthErr": sample.dofs.e[Z],
        "HfDistN": north,
        "HfDistE": east,
        "HfDistD": down,
        "HfDistYaw": turning,
        "HfReserve": 100.0 * reserve,
    }
    return [
        NAMED_VALUE_FLOAT(time_boot_ms=boot_ms, name=name, value=float(number))
        for name, number in numbers.items()
    ]
