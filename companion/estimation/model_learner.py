"""Holds what is found of the vehicle in all four axes (`vehicle_model.py`), and the model that is in use."""

import math
from collections.abc import Sequence

from companion.control.positioning import Jacobian
from companion.estimation import vehicle_model
from companion.estimation.observer import ObserverParameters
from companion.estimation.vehicle_model import (
    NO_EVIDENCE,
    Evidence,
    Found,
    Scheduled,
    Tables,
    Used,
)
from companion.records import PSI, Flags, VehicleModel, X, Y, Z, vector

AXES = 4
TOLD_TICKS = 10
"""What was found is told every so many ticks: nothing steers by it."""


class ModelLearner:
    """Learns surge, sway, heave and yaw from x, y, z and psi: surge and sway share x and y by the heading.

    Log gain and lag of a degree of freedom are those of its axes by cos² and sin² of the heading. All
    thrusters have the lag that heave shows, which moves most: with a lag of its own each, an axis in a limit
    cycle may take a strong vehicle for a late one.
    """

    def __init__(self, tables: Sequence[Tables], lag_s: float, *, adapts: bool) -> None:
        """Take observers by degree of freedom, the nominal lag, and whether what is found is used."""
        self._lag_s, self._adapts = lag_s, adapts
        self._tables = tables
        self.reset()

    def retune(self, tables: Sequence[Tables]) -> None:
        """Go on with other tables."""
        self._tables = tables
        self._look_up()

    def reset(self) -> None:
        """Forget what was found: the nominal vehicle again."""
        self._found = [vehicle_model.nothing_found(self._lag_s)] * AXES
        self._used = [Used(0.0, self._lag_s)] * AXES
        self._states = [vehicle_model.start(0.0)] * AXES
        self._share = (1.0, 0.0)
        self._evidence = [NO_EVIDENCE] * AXES
        self._ticks, self._moved = 0, False
        self._look_up()
        self._record()

    def begin(self, dof: int, position: float) -> None:
        """Observe a degree of freedom from a known place; what was found stays."""
        self._states[dof] = vehicle_model.start(position)

    def turn(self, J: Jacobian) -> None:
        """Take the heading of this tick, and look observers up where the model has moved."""
        share = (J.c * J.c, J.s * J.s)
        if not math.isfinite(share[0]):
            return
        self._share = share
        if not self._moved and not self._heading_counts():
            return
        self._moved = False
        used = [self._of_dof(self._used, dof) for dof in range(AXES)]
        for dof in range(AXES):
            if not vehicle_model.is_near(self._scheduled[dof], used[dof]):
                self._scheduled[dof] = vehicle_model.schedule(self._tables[dof], used[dof])
        self._dof_gain = [math.exp(one.log_gain) for one in used]

    def gain(self, dof: int) -> float:
        """Return the gain in use of a degree of freedom."""
        return self._dof_gain[dof]

    def parameters(self, dof: int) -> ObserverParameters:
        """Return those of the control's observer for the model in use."""
        return self._scheduled[dof].control

    def observe(
        self, dof: int, u: float, m: float, c: float, dt_s: float, position: float, rate: float
    ) -> None:
        """Take what was measured under thrust `u`; m and c are the nominal vehicle's."""
        found, here = self._of_dof(self._found, dof), self._scheduled[dof].here
        g = math.exp(found.log_gain)
        parameters = ObserverParameters(found.lag_s, here.slow_time_s, here.by_position, here.by_rate)
        self._states[dof], self._evidence[dof] = vehicle_model.observe(
            parameters, self._states[dof], u, m / g, c / g, dt_s, position, rate, dof == PSI
        )

    def learn(self, learns: Flags, dt_s: float) -> None:
        """Learn from what all degrees of freedom have shown in this tick, axis by axis where allowed."""
        cos, sin = self._share
        x, y, z, psi = self._evidence
        by_axis: tuple[Evidence, ...] = (
            vehicle_model.mixed(x, cos, y, sin),
            vehicle_model.mixed(x, sin, y, cos),
            z,
            psi,
        )
        self._evidence = [NO_EVIDENCE] * AXES
        before = list(self._used)
        for axis, evidence in enumerate(by_axis):
            if learns[axis] and evidence.gain_gain > 0.0:
                self._found[axis] = self._learnt(axis, evidence, dt_s)
                if self._adapts:
                    self._used[axis] = vehicle_model.follow(self._used[axis], self._found[axis])
        self._ticks += 1
        self._moved = self._moved or self._used != before
        if self._moved or self._heading_counts() or self._ticks % TOLD_TICKS == 0:
            self._record()

    def _learnt(self, axis: int, evidence: Evidence, dt_s: float) -> Found:
        if axis == Z:
            return vehicle_model.learn(self._found[Z], evidence, dt_s)
        return vehicle_model.learn_gain(self._found[axis], evidence, self._found[Z], dt_s)

    def _of_dof(self, each: Sequence[Found] | Sequence[Used], dof: int) -> Used:
        """Return what a list by axis says of a degree of freedom."""
        if dof in (Z, PSI):
            return Used(each[dof].log_gain, each[dof].lag_s)
        cos, sin = self._share if dof == X else (self._share[1], self._share[0])
        surge, sway = each[X], each[Y]
        return Used(
            cos * surge.log_gain + sin * sway.log_gain,
            cos * surge.lag_s + sin * sway.lag_s,
        )

    def _heading_counts(self) -> bool:
        """Tell whether x and y are moved by unlike axes, so that their models turn with the heading."""
        return self._used[X] != self._used[Y]

    def _look_up(self) -> None:
        used = [self._of_dof(self._used, dof) for dof in range(AXES)]
        self._scheduled: list[Scheduled] = [
            vehicle_model.schedule(tables, one) for tables, one in zip(self._tables, used, strict=True)
        ]
        self._dof_gain = [math.exp(one.log_gain) for one in used]
        self._moved = False

    def _record(self) -> None:
        doubts = [vehicle_model.doubt(found) for found in self._found]
        used = [self._of_dof(self._used, dof) for dof in range(AXES)]
        self.model = VehicleModel(
            gain=vector(math.exp(one.log_gain) for one in self._used),
            lag_s=vector(one.lag_s for one in self._used),
            found_gain=vector(math.exp(one.log_gain) for one in self._found),
            found_lag_s=vector(one.lag_s for one in self._found),
            log_gain_doubt=vector(gain for gain, _ in doubts),
            lag_doubt_s=vector(lag_s for _, lag_s in doubts),
            dof_gain=vector(math.exp(one.log_gain) for one in used),
            dof_later_s=vector(vehicle_model.later_s(one, self._lag_s) for one in used),
            longest_lag_s=vehicle_model.longest_lag_s(self._found[Z]) if self._adapts else self._lag_s,
        )
        """What is in use and what was found."""
