"""Anybody may publish under a vehicle's keys: no sample ends whoever hears it, or makes it grow."""

import json
from collections.abc import Callable, Iterator
from io import StringIO
from pathlib import Path

import msgspec
import pytest
from builders import RECORDING, plan
from rich.console import Console

from companion.records import ControlSample
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry
from dashboard.heard_vehicles import Fleet, Vehicle
from dashboard.recording.mcap_file import MAX_CHANNELS, MAX_SAMPLE_BYTES, Reader
from dashboard.recording.record import readable
from dashboard.recording.recorder import DiveRecorder, FileLimits
from dashboard.terminal.watch import Look, picture
from dashboard.web.app import MOST_BEHIND, message_text
from dashboard.web.fleet import Histories
from dashboard.zenoh_client import Message
from sim_bridge.zenoh_link import answer

MakeSample = Callable[..., ControlSample]
Sample = tuple[str, str, bytes]
UTC_NS = 1_795_000_000_000_000_000
DEEP = "[" * 100_000
NO_PARAMETER = '{"kind":"parameter","parameter":"FS_PILOT_INPT","value":0}'
WILD = (
    *(str(number) for number in (2**53, -(2**53), 2**63, 2**64, 10**30, "9" * 5000)),
    *("1e300", "-1e300", "1e400", "5e-324", "null", "true", "[]", "{}", '""', '"x"', "[1e300,1e300]"),
    *('"\\ud800"', '"\\u0000"', "[" * 10_000, '{"a":' * 10_000),
)
EVENT = telemetry.Event(t_s=12.0, boot_s=1.0, severity="info", kind="state", text="READY to ACTIVE")


@pytest.fixture(scope="module")
def genuine(make_sample: MakeSample) -> list[Sample]:
    """One sample of every key, with a position so that a map is drawn."""
    sample = make_sample()
    rest: dict[str, telemetry.Schema] = {"event": EVENT, "plan": plan(), "recorder": RECORDING}
    return [
        *samples.encode(sample, "kelp"),
        *(
            (f"holdfast/kelp/{tail}", telemetry.encoding(type(one)), telemetry.to_json(one))
            for tail, one in rest.items()
        ),
    ]


def wild(genuine: list[Sample]) -> Iterator[list[Sample]]:
    """Every field of every key with every wild value, and objects that are none; a list per field."""
    for key, encoding, payload in genuine:
        fields = json.loads(payload)
        for field in fields:
            text = json.dumps({**fields, field: "?wild?"})
            yield [(key, encoding, text.replace('"?wild?"', value).encode()) for value in WILD]
        odd = (b"", b"\xff", b'{"\xff":1}', b'{"t_s":"\xff"}', f'{{"x":{DEEP}'.encode(), b"{" * 100_000)
        yield [(key, encoding, text) for text in odd]
        yield [(f"{key}/x", "application/json", b'{"t_s":1e300,"boot_s":1}')]


def test_watch_goes_on(genuine: list[Sample]) -> None:
    fleet = Fleet(Vehicle)
    console = Console(file=StringIO(), width=80)

    def take(some: list[Sample]) -> None:
        fleet.take([Message(key, payload) for key, _, payload in some], now_s=1.0)
        console.print(picture(Look(fleet, 1.0)))

    for some in wild(genuine):
        take(some)
    take(genuine)
    assert fleet.complete


def test_the_dashboard_goes_on(genuine: list[Sample]) -> None:
    fleet = Histories()

    def take(some: list[Sample]) -> None:
        truth = '{"t_s":%s,"disturbance":[%s,0,0,0,0,0]}'
        messages = [Message(key, payload) for key, _, payload in some]
        messages += [Message("sim/kelp/truth", (truth % (value, value)).encode()) for value in WILD]
        fleet.take(messages, now_s=1.0)

    for some in wild(genuine):
        take(some)
        take(genuine)
        vehicle = fleet.vehicles["kelp"]
        message_text(
            status={"vehicles": fleet.briefs(1.0), **vehicle.status(1.0)},
            events=vehicle.events_from(0),
            plan=vehicle.plan,
        )
        vehicle.ring.frame(0, MOST_BEHIND)
    assert vehicle.status(1.0)["model"].keys() == {"x", "y", "z", "psi"}


def test_the_recorder_goes_on(genuine: list[Sample], tmp_path: Path) -> None:
    kept = recorder(tmp_path)
    raw_key, raw_encoding = telemetry.published("kelp", "raw")
    raw = telemetry.Raw(tick=1, now_s=12.0, heard=[(2**62, b"\xfe\x00")], out=[], ground=[(-1, b"a")])
    sides = [(raw_key, raw_encoding, msgspec.msgpack.encode(raw)), (raw_key, raw_encoding, b"\x91" * 100_000)]
    count = bad = 0
    for some in [*wild(genuine), sides]:
        for sample in (*some, *genuine[:1]):
            kept.take(*sample, UTC_NS, 0.0)
        kept.each_second(UTC_NS)
        status = kept.status(0.0, 0)
        msgspec.json.encode(status)
        assert status.recording, status.said
        count += 1
        bad = status.left_out
    kept.stop()
    (path,) = tmp_path.glob("*.mcap")
    items = list(Reader(path))
    assert sum(item[:3] == genuine[0] for item in items) >= count
    assert bad > 0
    assert f"{bad} bad samples" in kept.said


def recorder(directory: Path) -> DiveRecorder:
    kept = DiveRecorder("kelp", FileLimits(directory, reserve_bytes=1), {})
    assert kept.start(UTC_NS)
    return kept


@pytest.mark.parametrize(
    ("encoding", "payload", "publish_ns"),
    [
        ("application/json", b'{"t_s":1e300,"boot_s":1}', UTC_NS),
        ("application/json", b'{"t_s":12,"boot_s":1e300}', UTC_NS),
        ("application/json", f'{{"x":{DEEP}'.encode(), UTC_NS),
        ("application/json;\ud800", b"{}", UTC_NS),
        ("application/json;" + 255 * "x", b"{}", UTC_NS),
        ("application/json", b"{}", 2**64),
        ("application/json", b"{}", -1),
        ("bytes", bytes(MAX_SAMPLE_BYTES + 1), UTC_NS),
    ],
)
def test_a_bad_sample_is_counted_and_left_out(
    tmp_path: Path, genuine: list[Sample], encoding: str, payload: bytes, publish_ns: int
) -> None:
    kept = recorder(tmp_path)
    kept.take(*genuine[0], UTC_NS, 0.0)
    for key in ("holdfast/kelp/x", "holdfast/kelp/state"):
        kept.take(key, encoding, payload, publish_ns, 0.0)
    kept.take(*genuine[0], UTC_NS + 1, 0.0)
    status = kept.status(0.0, 0)
    assert (status.recording, status.messages, status.left_out) == (True, 2, 2)
    kept.stop()
    (path,) = tmp_path.glob("*.mcap")
    reader = Reader(path)
    assert [item[:3] for item in reader] == [genuine[0], genuine[0]]
    assert reader.whole
    assert f"{path.name} is complete, but for 2 bad samples" in kept.said


def test_many_keys_leave_the_vehicle_s_own_their_place(tmp_path: Path, genuine: list[Sample]) -> None:
    kept = recorder(tmp_path)
    for number in range(1000):
        kept.take(f"holdfast/kelp/{number}", "application/json", b"{}", UTC_NS, 0.0)
    for sample in genuine:
        kept.take(*sample, UTC_NS, 0.0)
    status = kept.status(0.0, 0)
    assert status.recording
    assert status.messages == MAX_CHANNELS + len(genuine)
    assert status.left_out == 1000 - MAX_CHANNELS
    assert f"more than {MAX_CHANNELS} keys" in status.said
    kept.stop()
    (path,) = tmp_path.glob("*.mcap")
    assert [item[:3] for item in Reader(path)][-len(genuine) :] == genuine


def test_a_stranger_s_clock_is_not_the_vehicle_s(tmp_path: Path, genuine: list[Sample]) -> None:
    kept = recorder(tmp_path)
    kept.take(*genuine[0], UTC_NS, 0.0)
    kept.take("holdfast/kelp/x", "application/json", b'{"t_s":1e8,"boot_s":1}', UTC_NS + 5, 0.0)
    assert kept.status(0.0, 0).t_s == 12.0
    kept.stop()
    (path,) = tmp_path.glob("*.mcap")
    assert [item.log_ns for item in Reader(path)] == [UTC_NS, UTC_NS + 5]


@pytest.mark.parametrize("payload", [DEEP, '{"a":' * 100_000, '{"a":NaN}', '{"a":"\ud800"}', "[1]"])
def test_a_configuration_that_nobody_can_read_is_none(payload: str) -> None:
    assert readable(payload.encode(errors="surrogatepass")) == ""


@pytest.mark.parametrize(
    "payload", [DEEP, '{"kind":' + DEEP, '{"kind":"leak","at_s":1e400}', NO_PARAMETER, "\xff"]
)
def test_a_fault_that_nobody_can_read_is_answered(payload: str) -> None:
    assert not answer(payload.encode("latin-1"), lambda fault: None).done
