"""Whether the vehicle is fit to be held: the pre-dive list, looked at again and again while it runs."""

import math
from collections.abc import Sequence

from companion.config import Config
from companion.mavlink.autopilot import Autopilot
from companion.predive.check import CheckRow, refusals, rows
from companion.predive.survey import Survey
from companion.records import ENGAGE_S, Condition, Event, StatusText, VehicleState

CHECK_S = 0.25
"""Between two lists of a vehicle that is heard: a refusal is reported within a quarter of a second."""
MAV_SEVERITY_INFO = 6


class Fitness:
    """Keeps what was seen of the vehicle; the list is made again every CHECK_S."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._survey = Survey(autopilot)
        self._checked_s = -math.inf
        self._about = self._failure = ""
        self.listed: list[CheckRow] = []
        """The list as it was made last, as far as it is known without trying anything."""
        self._hears: bool | None = None
        self._read_s = math.nan
        """Since when the list is being read."""
        self.reads = True
        """Whether what the list needs is still being read: for ENGAGE_S that is no refusal, nor an event."""

    def step(
        self,
        events: Sequence[Event],
        state: VehicleState,
        config: Config,
        conditions: Condition,
        *,
        holding: bool,
    ) -> str:
        """Take one tick's events and the last one's conditions; return what forbids engaging, in words."""
        self._survey.take(events)
        now_s = state.t_s
        if now_s - self._checked_s >= CHECK_S or not self._hears:
            self._checked_s = now_s
            self.listed = rows(self._survey.observed(state, conditions), config)
            self._failure = refusals(self.listed, holding=holding)
            hears, unread = len(self.listed) > 1, any(row.unread for row in self.listed)
            if not unread or hears is not self._hears:
                self._hears, self._read_s = hears, now_s
            self.reads = unread and now_s - self._read_s < ENGAGE_S
        return self._failure

    def introduced(self, now_s: float) -> tuple[StatusText, ...]:
        """Say, once it is known and whenever it changes, which autopilot this is."""
        if now_s != self._checked_s or (about := self._autopilot.about) == self._about:
            return ()
        self._about = about
        return (StatusText(now_s, MAV_SEVERITY_INFO, about),) if about else ()
