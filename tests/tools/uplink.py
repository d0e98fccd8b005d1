"""From ground stations' logs to what tests/unit/test_uplink.py replays: system 255's frames, and the answers.

usage: python -m tests.tools.uplink LOG.tlog...    writes tests/data/LOG-uplink.tlog.xz and LOG-answers.json
"""

import json
import lzma
import struct
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TypedDict

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from tools.telemetry_log import TlogRecord, read

from lab.loop.lockstep import SteppedVehicle

DATA = Path(__file__).parents[1] / "data"
STATION, VEHICLE = 255, (1, 1)
UNLISTED = 65535
"""The index of a parameter that is told because somebody set it."""
LOGS = ("bluerov2-4.1.0-bench", "bluerov2-4.1.1-pool")
ANSWER_S = 3.0
LINK, BOOT_S = 1, 5.0
STEADY_S = (20.0, 40.0)
"""When the ground station has set all rates, and asks for nothing."""


class Answers(TypedDict):
    """What came back."""

    answered: dict[str, list[str]]
    """By request: which component answered, with which kind, and what tells that from others of its kind."""
    rates_hz: dict[str, float]


def answers(records: Iterable[tuple[float, Any]]) -> Answers:
    """Tell from (time in s, message) which request got which answers."""
    answered: dict[str, set[str]] = {}
    waiting: list[tuple[float, Any]] = []
    unacknowledged: list[Any] = []
    rates: Counter[str] = Counter()
    for t_s, message in records:
        kind = message.get_type()
        if message.get_srcSystem() == STATION:
            waiting.append((t_s, message))
            answered.setdefault(name(message), set())
            if kind == "COMMAND_LONG":
                unacknowledged.append(message)
            continue
        sender = message.get_srcSystem(), message.get_srcComponent()
        if sender == VEHICLE and STEADY_S[0] <= t_s < STEADY_S[1]:
            rates[kind] += 1
        waiting = [(asked_s, request) for asked_s, request in waiting if t_s - asked_s < ANSWER_S]
        if kind == "COMMAND_ACK":  # of the oldest command of its number
            found = [
                one
                for one in unacknowledged
                if (one.command, one.target_component) == (message.command, sender[1])
            ]
            if found:
                unacknowledged.remove(found[0])
                answered[name(found[0])].add(f"{sender[1]}: {kind} {message.result}")
        for _, request in waiting:
            if said := answer(request, message):
                answered[name(request)].add(f"{sender[1]}: {said}")
    span_s = STEADY_S[1] - STEADY_S[0]
    return {
        "answered": {request: sorted(said) for request, said in sorted(answered.items())},
        "rates_hz": {kind: round(count / span_s, 1) for kind, count in sorted(rates.items())},
    }


def name(request: Any) -> str:
    """Name a request by what it asks."""
    kind = request.get_type()
    if kind == "COMMAND_LONG":
        return f"{kind} {request.command} of {request.param1:g} for {request.target_component}"
    if kind in ("MISSION_REQUEST_LIST", "MISSION_ACK"):
        return f"{kind} of {request.mission_type}"
    if kind == "PARAM_SET":
        return f"{kind} {request.param_id}"
    if kind == "REQUEST_DATA_STREAM":
        return f"{kind} {request.req_stream_id} at {request.req_message_rate}"
    return str(kind)


def answer(request: Any, message: Any) -> str:
    """Tell in which way a message answers a request; empty where it does not."""
    asked, kind = request.get_type(), message.get_type()
    if asked == "COMMAND_LONG" and request.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
        return str(kind) if message.get_msgId() == request.param1 else ""
    if asked == "PARAM_REQUEST_LIST" and kind in ("PARAM_VALUE", "STATUSTEXT"):
        return "" if kind == "PARAM_VALUE" and message.param_index == UNLISTED else str(kind)
    if asked == "PARAM_SET" and kind == "PARAM_VALUE" and message.param_id == request.param_id:
        return f"PARAM_VALUE {message.param_value:g}"
    if (
        asked == "MISSION_REQUEST_LIST"
        and kind == "MISSION_COUNT"
        and message.mission_type == request.mission_type
    ):
        return f"MISSION_COUNT {message.count}"
    if asked == "PARAM_EXT_REQUEST_LIST" and kind == "PARAM_EXT_VALUE":
        return str(kind)
    return ""


def messages(records: Iterable[TlogRecord]) -> Iterator[tuple[float, Any]]:
    """Parse the frames of a log."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    for record in records:
        for message in parser.parse_buffer(record.data) or ():
            if message.get_type() != "BAD_DATA":
                yield record.t_s, message


def replay(vehicle: SteppedVehicle, log: str) -> Answers:
    """Send a log's uplink to a vehicle that has booted, and tell what it answered."""
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "uplink.tlog"
        path.write_bytes(lzma.decompress((DATA / f"{log}-uplink.tlog.xz").read_bytes()))
        return answers(replayed(vehicle, list(read(path))))


def replayed(vehicle: SteppedVehicle, records: list[TlogRecord]) -> Iterator[tuple[float, Any]]:
    """Send at the recorded times; once nothing but sticks and heartbeats comes, a frame each step."""
    vehicle.open_link(LINK)
    begin_s = vehicle.time_s + BOOT_S
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True

    def step(data: bytes | None = None) -> Iterator[tuple[float, Any]]:
        for link, said in vehicle.step([(LINK, data)] if data else []):
            heard = parser.parse_buffer(said) if link == LINK else None
            yield from ((vehicle.time_s - begin_s, message) for message in heard or ())

    for record in records:
        while vehicle.time_s - begin_s < min(record.t_s, STEADY_S[1]):
            yield from step()
        yield from ((vehicle.time_s - begin_s, message) for _, message in messages([record]))
        yield from step(record.data)
    end_s = vehicle.time_s + 1.0
    while vehicle.time_s < end_s:
        yield from step()


def main() -> None:
    """Write the two files of each log."""
    for path in map(Path, sys.argv[1:]):
        records = list(read(path))
        sent = [record for record in records if record.system == STATION]
        raw = b"".join(struct.pack(">Q", round(record.t_s * 1e6)) + record.data for record in sent)
        (DATA / f"{path.stem}-uplink.tlog.xz").write_bytes(lzma.compress(raw, preset=9))
        text = json.dumps(answers(messages(records)), indent=1)
        (DATA / f"{path.stem}-answers.json").write_text(text + "\n", encoding="ascii")


if __name__ == "__main__":
    main()
