"""The vehicle on Zenoh: it publishes `sim/{vehicle}/truth`, and may take faults at `sim/{vehicle}/fault`.

Both are JSON: FIELDS of a `Truth`, which no companion may read; a `Fault` in a query, with its `FaultReply`.
"""

import threading
from collections.abc import Callable

import msgspec
import zenoh

from holdfast import RefusedError
from sim_bridge.fault_kinds import Fault
from sim_bridge.faults import checked
from sim_bridge.vehicle import Truth

RETRY_S = 1.0
ANSWER_S = 3.0
MAX_MESSAGE_BYTES = 1 << 16
SCHEMA = "application/json;holdfast.sim.Truth.v1"


FIELDS = (
    *("t_s", "eta", "nu", "nu_dot", "thrust_n", "tau"),
    *("disturbance", "motor_pwm", "armed", "mode", "load_on", "voltage_v"),
)


def encode(truth: Truth) -> bytes:
    """One JSON object of a stable shape, no nulls."""
    fields = {name: getattr(truth, name) for name in FIELDS}
    return msgspec.json.encode(fields, enc_hook=lambda array: array.tolist())


class FaultReply(msgspec.Struct, frozen=True):
    """The answer to a fault."""

    done: bool
    """It is on the script now; otherwise nothing was changed."""
    said: str


def answer(payload: bytes, take: Callable[[Fault], None]) -> FaultReply:
    """Take a fault out of a query's payload, whatever the bytes."""
    try:
        fault = checked(msgspec.json.decode(payload, type=Fault))
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        return FaultReply(done=False, said=f"no fault: {error}")
    take(fault)
    return FaultReply(done=True, said=f"{fault.kind} begins in {fault.at_s:g} s")


def inject(endpoint: str, vehicle: str, fault: Fault) -> FaultReply:
    """Ask a running simulator for a fault that begins `at_s` from now. Blocks for some seconds at most."""
    try:
        session = zenoh.open(client(endpoint))
    except zenoh.ZError:
        said = f"nobody listens at {endpoint}: the simulator itself does not; "
        return FaultReply(done=False, said=said + "start `holdfast run`, or a router")
    try:
        with session:
            payload = msgspec.json.encode(fault)
            for reply in session.get(f"sim/{vehicle}/fault", payload=payload, timeout=ANSWER_S):
                if reply.ok is not None:
                    return msgspec.json.decode(reply.ok.payload.to_bytes(), type=FaultReply)
    except (zenoh.ZError, msgspec.MsgspecError, RecursionError) as error:
        return FaultReply(done=False, said=f"{endpoint}: {error}")
    said = f"no simulator takes faults for '{vehicle}' at {endpoint}; start it with --live-faults"
    return FaultReply(done=False, said=said)


def client(endpoint: str) -> zenoh.Config:
    """Return the configuration of a client of one endpoint; raise RefusedError for what is none."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("transport/link/rx/max_message_size", str(MAX_MESSAGE_BYTES))
    try:
        config.insert_json5("connect/endpoints", msgspec.json.encode([endpoint]).decode())
    except zenoh.ZError as error:
        raise RefusedError(f"'{endpoint}' is no Zenoh endpoint, such as tcp/127.0.0.1:7447") from error
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")
    return config


class ZenohLink:
    """A client of a Zenoh router or peer, joined by a thread once it is there; drops what it cannot send."""

    def __init__(self, endpoint: str, vehicle: str, take: Callable[[Fault], None] | None = None) -> None:
        """Start to connect to `endpoint` (such as tcp/127.0.0.1:7447) in the background.

        `take` gets each fault that somebody asks for, in a thread of Zenoh's. None: nobody may.
        """
        client(endpoint)  # refused here, not in the thread
        self._endpoint = endpoint
        self._vehicle = vehicle
        self._take = take
        self._publisher: zenoh.Publisher | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="zenoh", daemon=True)
        self._thread.start()

    def put(self, truth: Truth) -> None:
        """Publish one sample, if somebody is there; never waits."""
        if self._publisher is not None:
            self._publisher.put(encode(truth))

    def close(self) -> None:
        """Stop and disconnect."""
        self._closing.set()
        self._thread.join(timeout=3.0)

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                with zenoh.open(client(self._endpoint)) as session:
                    self._declare(session)
                    self._closing.wait()
                    self._publisher = None
            except zenoh.ZError:
                self._closing.wait(RETRY_S)

    def _declare(self, session: zenoh.Session) -> None:
        if take := self._take:
            key = f"sim/{self._vehicle}/fault"

            def on_query(query: zenoh.Query) -> None:
                with query:
                    payload = query.payload.to_bytes() if query.payload is not None else b""
                    reply = msgspec.json.encode(answer(payload, take))
                    query.reply(key, reply, encoding=zenoh.Encoding.APPLICATION_JSON)

            session.declare_queryable(key, on_query)
        self._publisher = session.declare_publisher(
            f"sim/{self._vehicle}/truth",
            encoding=zenoh.Encoding(SCHEMA),
            congestion_control=zenoh.CongestionControl.DROP,
        )
