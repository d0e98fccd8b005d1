"""The vehicle on Zenoh: `sim/{vehicle}/truth`, a `TruthSample` in JSON, which no companion reads."""

import threading
from collections import deque

import msgspec
import zenoh

from holdfast import RefusedError
from sim_bridge.physics.plant import Six
from sim_bridge.vehicle import Truth

RETRY_S = 1.0
MAX_MESSAGE_BYTES = 1 << 16
SCHEMA = "application/json;holdfast.sim.Truth.v1"


class TruthSample(msgspec.Struct, frozen=True):
    """What is published of `Truth`, in its units."""

    t_s: float
    eta: Six
    nu: Six
    nu_dot: Six
    thrust_n: tuple[float, ...]
    tau: Six
    disturbance: Six
    motor_pwm: tuple[int, ...]
    armed: bool
    mode: int
    load_on: bool
    voltage_v: float


def encode(truth: Truth) -> bytes:
    """One JSON object of a stable shape: the fields of `TruthSample`, no nulls."""
    fields = {name: getattr(truth, name) for name in TruthSample.__struct_fields__}
    return msgspec.json.encode(fields, enc_hook=lambda array: array.tolist())


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
    """A client of a Zenoh router or peer in its own thread: retries to connect, drops what it cannot send."""

    def __init__(self, endpoint: str, vehicle: str) -> None:
        """Start to connect to `endpoint` (such as tcp/127.0.0.1:7447) in the background."""
        client(endpoint)  # refused here, not in the thread
        self._endpoint = endpoint
        self._vehicle = vehicle
        self._samples: deque[bytes] = deque(maxlen=4)
        self._wake = threading.Condition()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="zenoh", daemon=True)
        self._thread.start()

    def put(self, truth: Truth) -> None:
        """Hand over one sample; never waits."""
        with self._wake:
            self._samples.append(encode(truth))
            self._wake.notify()

    def close(self) -> None:
        """Stop and disconnect."""
        with self._wake:
            self._stopping = True
            self._wake.notify()
        self._thread.join(timeout=3.0)

    def _run(self) -> None:
        while not self._stopping:
            try:
                with zenoh.open(client(self._endpoint)) as session:
                    self._publish(session)
            except zenoh.ZError:
                with self._wake:
                    self._wake.wait_for(lambda: self._stopping, timeout=RETRY_S)

    def _publish(self, session: zenoh.Session) -> None:
        publisher = session.declare_publisher(
            f"sim/{self._vehicle}/truth",
            encoding=zenoh.Encoding(SCHEMA),
            congestion_control=zenoh.CongestionControl.DROP,
        )
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._stopping or self._samples)
                if self._stopping:
                    return
                sample = self._samples.popleft()
            publisher.put(sample)
