"""Scripted faults: what breaks, when, for how long; between the autopilot and its links, or on the vehicle.

FAULT_KINDS tells what each kind does from at_s for duration_s.
"""

import copy
import heapq
import math
from collections.abc import Iterable, Sequence
from difflib import get_close_matches

import msgspec
import numpy as np

from sim_bridge.fault_kinds import Fault
from sim_bridge.firmware.packing import Message
from sim_bridge.firmware.params import DEFAULTS
from sim_bridge.physics.thrusters import Eight

Datagram = tuple[int, bytes]

_LARGEST = {"int8_t": 127, "int16_t": 32767, "int32_t": 2147483647}


class Faults:
    """The script and its progress. Times are seconds of the simulation."""

    def __init__(self, script: Iterable[Fault], rng: np.random.Generator) -> None:
        self._script = [part for fault in script for part in _each(checked(fault))]
        self._pending = sorted(self._script, key=lambda fault: fault.at_s)
        self._active: list[Fault] = []
        self._change_s = self._pending[0].at_s if self._pending else math.inf
        self._last_said: dict[str, Message] = {}
        self._rng = rng
        self._order = 0
        self._waiting: dict[str, list[tuple[float, int, Datagram]]] = {"in": [], "out": []}

    def add(self, fault: Fault) -> None:
        """Put one more fault on the script, while the simulation runs."""
        parts = _each(fault)
        self._script += parts
        self._pending = sorted([*self._pending, *parts], key=lambda item: item.at_s)
        self._change_s = min(self._change_s, fault.at_s)

    def advance(self, t_s: float) -> list[Fault]:
        """Move to time t; returns the faults that begin now."""
        if t_s < self._change_s - 1e-9:
            return []
        begun = [fault for fault in self._pending if fault.at_s <= t_s + 1e-9]
        self._pending = self._pending[len(begun) :]
        last_clear = max((i for i, fault in enumerate(begun) if fault.kind == "clear"), default=None)
        active = [*self._active, *begun] if last_clear is None else begun[last_clear + 1 :]
        self._active = [fault for fault in active if t_s < fault.at_s + fault.duration_s - 1e-9]
        ends = [fault.at_s + fault.duration_s for fault in self._active]
        self._change_s = min([*ends, *(fault.at_s for fault in self._pending)], default=math.inf)
        return begun

    def health(self) -> Eight:
        """Health -1..1 of each thruster."""
        health = [1.0] * 8
        for fault in self._active:
            if fault.kind == "thruster":
                health[fault.thruster - 1] = fault.value
        a, b, c, d, e, f, g, h = health
        return a, b, c, d, e, f, g, h

    def stuck(self) -> dict[int, int]:
        """PWM (µs) of each motor that does not obey, by its index."""
        return {
            fault.thruster - 1: round(fault.value) for fault in self._active if fault.kind == "thruster_stuck"
        }

    def holds(self, kind: str) -> Fault | None:
        """Return the fault of this kind that holds now."""
        return next((fault for fault in self._active if fault.kind == kind), None)

    def value(self, kind: str, otherwise: float = 0.0) -> float:
        """Return the value of the fault of this kind that holds now."""
        fault = self.holds(kind)
        return otherwise if fault is None else fault.value

    @property
    def falsifies_messages(self) -> bool:
        """Whether telemetry has to pass through `alter`, now or later in the script."""
        return any(fault.kind.startswith("message") for fault in self._script)

    def alter(self, message: Message) -> Message | None:
        """Return a telemetry message as the faults leave it; None if it is not sent."""
        name = message.get_type()
        kinds = {
            fault.kind: fault
            for fault in self._active
            if fault.kind.startswith("message") and fault.message in ("", name)
        }
        if "message_stopped" in kinds:
            return None
        if "message_frozen" in kinds and name in self._last_said:
            return self._last_said[name]
        self._last_said[name] = message
        if "message_nan" in kinds:
            return _falsified(message, math.nan, False)
        if "message_extreme" in kinds:
            return _falsified(message, kinds["message_extreme"].value, True)
        return message

    def carry(self, way: str, datagrams: Sequence[Datagram], t_s: float) -> list[Datagram]:
        """Datagrams that get through now, `way` being "in" or "out", delayed ones included."""
        waiting = self._waiting[way]
        faults = {fault.kind: fault.value for fault in self._active if fault.kind.startswith("link")}
        if not faults and not waiting:
            return list(datagrams)
        through = []
        for datagram in datagrams:
            if "link_cut" in faults or self._chance(faults.get("link_lossy", 0.0)):
                continue
            for _ in range(2 if self._chance(faults.get("link_duplicating", 0.0)) else 1):
                self._order += 1
                heapq.heappush(waiting, (t_s + faults.get("link_delayed", 0.0), self._order, datagram))
        while waiting and waiting[0][0] <= t_s + 1e-9:
            through.append(heapq.heappop(waiting)[2])
        return through

    def _chance(self, probability: float) -> bool:
        return probability > 0.0 and bool(self._rng.random() < probability)


def checked(fault: Fault) -> Fault:
    """Return a fault; raise ValueError for a parameter that ArduSub does not have."""
    if fault.kind == "parameter" and fault.parameter not in DEFAULTS:
        near = " or ".join(get_close_matches(fault.parameter.upper(), DEFAULTS, 3))
        said = f"parameter = '{fault.parameter}': ArduSub has none of this name"
        raise ValueError(f"{said}{f'; is it {near}?' if near else ''}")
    return fault


def _each(fault: Fault) -> list[Fault]:
    """Return the single events of a fault that happens `count` times."""
    apart_s = fault.duration_s / fault.count
    return [
        msgspec.structs.replace(fault, count=1, at_s=fault.at_s + n * apart_s) for n in range(fault.count)
    ]


def _falsified(message: Message, value: float, integers: bool) -> Message:
    false = copy.copy(message)
    for field, kind in zip(message.fieldnames, message.fieldtypes, strict=True):
        if kind in ("float", "double") and not isinstance(getattr(message, field), (list, tuple)):
            setattr(false, field, value)
        elif integers and kind in _LARGEST and not isinstance(getattr(message, field), (list, tuple)):
            setattr(false, field, _LARGEST[kind])
    return false
