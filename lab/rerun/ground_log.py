"""A ground station's log (.tlog) through today's engine and relay: what Holdfast would have thought.

Frames of the ground station go to the relay's pilot side, all others to the vehicle's side, at the moments of
the log. The engine is never asked to engage, and nothing is sent to anybody.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.config import Config, load_config
from companion.engine import Engine
from companion.mavlink.relay import Relay
from companion.predive.check import CheckRow
from companion.records import PSI, Condition, LinkCounters, LoopHealth, Setpoint, Z
from lab.logs.telemetry_log import TlogError, TlogRecord

START_S = 1000.0
"""The engine's clock at the first record."""

CHECK_S = 1.0
_PILOT_BEHIND_US = (
    "vehicle.thrust_path=manual_control",
    "ground_station.endpoint=udp-listen:127.0.0.1:14551",
)


class StateInterval(NamedTuple):
    """The supervisor's state and reason, and from when to when (s since the first record)."""

    begin_s: float
    end_s: float
    state: str
    reason: str


@dataclass
class Thoughts:
    """What came of it. Arrays have a row each tick; depth (m) and heading (rad) are NaN before they came."""

    t_s: NDArray[np.float64]
    depth_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    innovation: NDArray[np.float64]
    """Shape (ticks, 4): by how much measurements missed the estimate; m, and rad for the heading."""

    spans: list[StateInterval]
    held_s: dict[str, float]
    """How long each condition held."""

    checked: list[CheckRow]
    """The pre-dive list as it stood when the vehicle was last heard."""

    counters: LinkCounters
    relayed: tuple[int, int]
    """Bytes that passed the relay, to the ground station and to the vehicle."""

    notes: list[str] = field(default_factory=list)


def think(records: Iterator[TlogRecord], overrides: Sequence[str] = ()) -> Thoughts:
    """Step engine and relay through `records` at the loop's rate. Raises ConfigError for bad `overrides`."""
    config = load_config(overrides=[*_PILOT_BEHIND_US, *overrides])
    engine, relay = Engine(config, Setpoint((np.nan,) * 4)), Relay(config)
    tick_s = 1.0 / config.loop.rate_hz
    rows: list[tuple[float, ...]] = []
    spans: list[StateInterval] = []
    held: Counter[Condition] = Counter()
    relayed = [0, 0]
    heard: list[tuple[int, bytes]] = []
    checked: list[CheckRow] = []
    sample = None
    pending = next(records, None)
    tick = 0
    while pending is not None:
        tick += 1
        t_s = tick * tick_s
        while pending is not None and pending.t_s <= t_s:
            t_ns = round((START_S + pending.t_s) * 1e9)
            if pending.system == config.link.system:
                relayed[1] += sum(map(len, relay.to_vehicle(t_ns, pending.data)))
            else:
                relayed[0] += sum(map(len, relay.to_ground(t_ns, pending.data)))
                heard.append((t_ns, pending.data))
            pending = next(records, None)
        health = LoopHealth(tick, config.loop.rate_hz, 0.0, 0.0, 0, 0)
        _, sample = engine.step(START_S + t_s, heard, health, (), relay.take())
        heard = []
        state, verdict = sample.state, sample.verdict
        known = [
            value if age_s <= limit_s else np.nan
            for value, age_s, limit_s in (
                (state.eta[Z], state.ages.depth_s, config.supervisor.depth_timeout_s),
                (state.eta[PSI], state.ages.attitude_s, config.supervisor.attitude_timeout_s),
            )
        ]
        rows.append((t_s, *known, *state.innovation))
        if tick % round(CHECK_S / tick_s) == 0 and state.ages.link_s < CHECK_S:
            checked = engine.checked(state)
        held.update(verdict.conditions)
        if not spans or (spans[-1].state, spans[-1].reason) != (str(verdict.state), verdict.reason):
            spans.append(StateInterval(t_s, t_s, str(verdict.state), verdict.reason))
        spans[-1] = spans[-1]._replace(end_s=t_s)
    if sample is None:
        raise TlogError("holds no record")
    table = np.array(rows)
    return Thoughts(
        t_s=table[:, 0],
        depth_m=table[:, 1],
        heading_rad=table[:, 2],
        innovation=table[:, 3:],
        spans=spans,
        held_s={str(one.name): count * tick_s for one, count in held.most_common()},
        checked=checked,
        counters=sample.counters,
        relayed=(relayed[0], relayed[1]),
        notes=_notes(config),
    )


def lines(thoughts: Thoughts) -> Iterator[str]:
    """Say in lines what came of it."""
    counters = thoughts.counters
    yield (
        f"{thoughts.t_s[-1]:.0f} s of telemetry: {counters.messages} messages of the vehicle used, "
        f"{counters.foreign} of others left alone, {counters.garbage} stretches of garbage, "
        f"{counters.implausible} implausible values"
    )
    yield (
        f"relay: {thoughts.relayed[0]} bytes to the ground station, {thoughts.relayed[1]} to the vehicle; "
        "nothing was steered"
    )
    known = np.isfinite(thoughts.depth_m)
    missed_m = thoughts.innovation[known & (thoughts.innovation[:, Z] != 0.0), Z]
    if missed_m.size:
        depth_m, rms_m = thoughts.depth_m[known], float(np.sqrt(np.mean(missed_m**2)))
        yield (
            f"depth {depth_m.min():.2f} to {depth_m.max():.2f} m, known {known.mean():.0%} of the time; "
            f"{missed_m.size} samples missed the estimate by {1e3 * rms_m:.0f} mm RMS"
        )
    yield "the supervisor:"
    yield from (
        f"  {span.begin_s:7.1f} to {span.end_s:7.1f} s  {span.state}: {span.reason}"
        for span in _lasting(thoughts.spans)
    )
    yield "conditions, seconds: " + ", ".join(f"{name} {s:.0f}" for name, s in thoughts.held_s.items())
    yield from (f"note: {note}" for note in thoughts.notes)


def _lasting(spans: Sequence[StateInterval], least_s: float = 0.5) -> Iterator[StateInterval]:
    """Give the spans that lasted; a shorter one counts as a part of the one before it."""
    open_span: StateInterval | None = None
    for span in spans:
        same = open_span is not None and (open_span.state, open_span.reason) == (span.state, span.reason)
        if open_span is None or not (same or span.end_s - span.begin_s < least_s):
            if open_span is not None:
                yield open_span
            open_span = span
        else:
            open_span = open_span._replace(end_s=span.end_s)
    if open_span is not None:
        yield open_span


def _notes(config: Config) -> list[str]:
    return [
        f"streams came as the ground station asked for them; Holdfast asks for {config.loop.rate_hz:g} Hz",
        "the log has no answers to our TIMESYNC: delays are the configured ones",
    ]
