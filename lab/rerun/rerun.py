"""`holdfast lab rerun`: a recorded dive's datagrams through today's engine, its commands beside the dive's.

What came and went is taken from the raw ticks (`telemetry.raw = true`), the configuration from the first of
them. The vehicle's answers stay those of the dive: where the commands differ, it is what today's code would
have sent at that moment, not where the vehicle would have gone.
"""

import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.arrays import Array
from companion.config import DEFAULT_FILE, Config, load_config
from companion.engine import Engine
from companion.guidance.orders import ordering
from companion.identify.sample_table import NoDiveError
from companion.mavlink.signing import Signing
from companion.records import AXES, LoopHealth, Request, Setpoint, vector
from companion.steps import finish
from companion.telemetry.operator_commands import parse
from companion.telemetry.schemas import Raw
from dashboard.recording.mcap_file import Reader
from holdfast.child import bounded
from holdfast.command_line import command_parser
from lab.identify.readers import kind_of
from lab.options import add_settings
from lab.studies.promises import steering as demanded

EXAMPLES = """\
examples:
  holdfast run --set telemetry.raw=true          together with `holdfast record`: then the dive can be rerun
  holdfast lab rerun dives/kelp-*.mcap               the files of one dive, in any order
  holdfast lab rerun FILE --set heave.kappa_per_s=8  the commands that other gains would have given

Exit status: 0 every byte is the same, 1 some bytes differ, 2 the dive cannot be rerun.
"""
HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT
HEADER = 10
FOREIGN = "is no recording of Holdfast; `holdfast identify --from` finds the vehicle in it"


@dataclass
class Tape:
    """What was recorded: raw ticks in order, each once, and what was seen amiss."""

    ticks: list[Raw]
    config: Mapping[str, Any]
    notes: list[str] = field(default_factory=list)


@dataclass
class Outcome:
    """What came of it. Commands (n, 4): surge, sway, heave, yaw, -1..1, NaN where none was sent."""

    t_s: Array
    was: Array
    now: Array
    different: list[int]
    """Numbers of the ticks whose bytes are not the same."""
    wall_s: float


def load(files: Sequence[Path]) -> Tape:
    """Read the raw ticks of a dive's files. Raises ValueError where there are none, OSError."""
    ticks: dict[int, Raw] = {}
    config: Mapping[str, Any] = {}
    decoder = msgspec.msgpack.Decoder(Raw)
    notes: list[str] = []
    services: set[str] = set()
    for file in files:
        if kind_of(file) != "MCAP":
            raise NoDiveError(f"{file}: {FOREIGN}")
        reader = Reader(file)
        for item in reader:
            services.add(item.key.partition("/")[0])
            if item.key.startswith("holdfast/") and item.key.endswith("/raw"):
                raw = decoder.decode(item.payload)
                if ticks.setdefault(raw.tick, raw).now_s != raw.now_s:
                    raise NoDiveError(f"{file}: holds more than one run of the companion (tick {raw.tick})")
        config = config or msgspec.json.decode(reader.metadata.get("config", {}).get("json", "{}"))
        if not reader.whole:
            notes.append(f"{file.name} was cut; what is whole of it was used")
    if not ticks and "holdfast" not in services and "mavlink" in services:
        raise NoDiveError(f"{files[0]}: {FOREIGN}")
    if not ticks:
        raise NoDiveError(
            "no raw ticks in it: they are recorded with `holdfast run --set telemetry.raw=true`"
        )
    numbers = sorted(ticks)
    if numbers[0] != 1:
        notes.append(
            f"it begins with tick {numbers[0]}: the engine starts afresh there, so the first seconds differ"
        )
    for previous, following in pairwise(numbers):
        if following != previous + 1:
            notes.append(f"ticks {previous + 1} to {following - 1} are missing: what follows may differ")
    return Tape([ticks[number] for number in numbers], config, notes)


def configured(tape: Tape, overrides: Sequence[str] = ()) -> Config:
    """Return the configuration of the dive, on today's for keys that it did not have.

    Raises ConfigError where today's engine does not take it.
    """
    start = tape.ticks[0].start
    recorded = dict(start.config) if start is not None else dict(tape.config)
    if not recorded:
        tape.notes.append("no configuration was recorded: today's shipped one was used")
    return load_config(DEFAULT_FILE, [*_overlay(recorded, tape.notes), *overrides])


def rerun(
    tape: Tape,
    config: Config,
    *,
    follow: bool = True,
    signing: Signing | None = None,
    aim: Callable[[Engine, Raw], None] | None = None,
) -> Outcome:
    """Step today's engine through the ticks; without `follow` live retunes are left out.

    `signing` as the dive began with: without it signatures are neither checked nor made. `aim` does what a
    script did before a tick.
    """
    start = tape.ticks[0].start
    setpoint = Setpoint(vector(start.setpoint if start is not None else [math.nan] * 4))
    link = config.link if signing else msgspec.structs.replace(config.link, signing_key_file="")
    engine = Engine(
        msgspec.structs.replace(config, link=link),
        setpoint,
        arm=start is not None and start.arm,
        signing=signing,
    )
    was, now, different = [], [], []
    begun_s = time.perf_counter()
    for raw in tape.ticks:
        if aim is not None:
            aim(engine, raw)
        if raw.order is not None and (order := finish(ordering(parse(*raw.order), config))) is not None:
            engine.guide(order)
        if raw.config is not None and follow:
            tuned = load_config(DEFAULT_FILE, _overlay(raw.config, []))
            engine.retune(msgspec.structs.replace(tuned, link=link))
        health = LoopHealth(raw.tick, config.loop.rate_hz, 0.0, 0.0, 0, 0)
        heard = [(t_ns, data) for t_ns, data in raw.heard]
        ground = [(t_ns, frame) for t_ns, frame in raw.ground]
        out, _ = engine.step(raw.now_s, heard, health, [Request[name] for name in raw.requests], ground)
        if [*map(_content, out)] != [*map(_content, raw.out)]:
            different.append(raw.tick)
        was.append(_command(raw.out))
        now.append(_command(out))
    wall_s = time.perf_counter() - begun_s
    t_s = np.array([raw.now_s for raw in tape.ticks])
    return Outcome(t_s, np.array(was), np.array(now), different, wall_s)


def _command(frames: Iterable[bytes]) -> list[float]:
    """Return surge, sway, heave (down) and yaw of the last frame that steers, NaN without one."""
    steering = [axes for axes in map(demanded, frames) if axes is not None]
    if not steering:
        return [math.nan] * 4
    surge, sway, up, yaw, *_ = steering[-1]
    return [surge, sway, -up, yaw]


def _content(frame: bytes) -> bytes:
    """Return what a tick decides of a frame.

    Signatures and the sequence numbers of heartbeats also count the frames that the pilot's ground station is
    shown, which are no part of a tick.
    """
    if len(frame) <= HEADER:
        return frame
    heartbeat = int.from_bytes(frame[7:10], "little") == HEARTBEAT
    return frame[:2] + frame[3 : 4 if heartbeat else 5] + frame[5 : HEADER + frame[1]]


def _overlay(recorded: Mapping[str, Any], notes: list[str]) -> list[str]:
    """Return the recorded configuration as overrides of today's, without keys that are no more."""
    known = msgspec.to_builtins(load_config())
    overrides, given = [], set[str]()
    for section, keys in recorded.items():
        for key, value in keys.items():
            name = f"{section}.{key}"
            given.add(name)
            if key in known.get(section, {}):
                overrides.append(f"{name}={msgspec.json.encode(value).decode()}")
            else:
                notes.append(f"{name} = {value!r} of the dive is no key any more")
    newer = [
        name for section, keys in known.items() for key in keys if (name := f"{section}.{key}") not in given
    ]
    notes += [f"{name} is newer than the dive: today's shipped value was used" for name in newer if recorded]
    return overrides


def main(argv: list[str]) -> int:
    """Run the command."""
    parser = command_parser(
        "lab rerun",
        "Runs a recorded dive through the present code: the same datagrams, configuration, requests and "
        "retunes. It compares the bytes that the engine sends with the recorded ones.",
        EXAMPLES,
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="files of one dive, MCAP")
    add_settings(parser)
    options = parser.parse_args(argv)
    tape, outcome = bounded(again, options.files, options.files, options.set)
    sys.stdout.write("\n".join(lines(tape, outcome, changed=bool(options.set))) + "\n")
    return 1 if outcome.different else 0


def again(files: Sequence[Path], overrides: Sequence[str]) -> tuple[Tape, Outcome]:
    """Read a dive and run it again, its retunes only where nothing else changes the configuration."""
    tape = load(files)
    return tape, rerun(tape, configured(tape, overrides), follow=not overrides)


def lines(tape: Tape, outcome: Outcome, *, changed: bool) -> Iterator[str]:
    """Give what came of it in lines; `changed`: the configuration is not the recorded one."""
    count, different = len(tape.ticks), outcome.different
    asked = sum(len(raw.requests) for raw in tape.ticks)
    ordered = sum(raw.order is not None for raw in tape.ticks)
    retuned = sum(raw.config is not None for raw in tape.ticks)
    dived_s = outcome.t_s[-1] - outcome.t_s[0]
    yield (
        f"{count} ticks, {dived_s:.1f} s of diving, "
        f"at {dived_s / outcome.wall_s:.0f} times real time; "
        f"{asked} requests, {ordered} orders and {retuned} retunes by the operator"
    )
    yield from (f"note: {note}" for note in tape.notes)
    if changed and retuned:
        yield f"note: {retuned} retunes of the dive were left out, for the configuration is another"
    if not different:
        yield "every byte sent is the same"
        return
    first = next(raw for raw in tape.ticks if raw.tick == different[0])
    yield (
        f"{len(different)} ticks ({len(different) / count:.1%}) sent other bytes, the first is tick "
        f"{first.tick}, {first.now_s - tape.ticks[0].now_s:.2f} s into it"
    )
    steered = np.isfinite(outcome.was[:, 0]), np.isfinite(outcome.now[:, 0])
    if (only := int(np.sum(steered[0] != steered[1]))) > 0:
        yield f"in {only} ticks only one of the two steered"
    yield f"{'command':8}{'ticks':>8}{'RMS':>10}{'largest':>10}{'at, s':>10}   of full"
    for axis, difference in zip(AXES, (outcome.now - outcome.was).T, strict=True):
        apart = np.abs(np.nan_to_num(difference))
        known = apart[np.isfinite(difference)]
        rms = math.sqrt(float(np.mean(known**2))) if known.size else 0.0
        largest = int(apart.argmax())
        at_s = outcome.t_s[largest] - outcome.t_s[0]
        yield f"{axis:8}{np.count_nonzero(known):8d}{rms:10.2%}{apart[largest]:10.2%}{at_s:10.1f}"
