"""`holdfast foxglove`: what a vehicle publishes over Zenoh, live on a Foxglove WebSocket."""

import argparse
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

import foxglove
import msgspec

from companion.telemetry import schemas as telemetry
from companion.telemetry.schemas import State
from dashboard.arguments import add_connect, listen_address
from dashboard.foxglove.poses import NS_PER_S, channels
from dashboard.recording.json_schema import schema_of
from dashboard.zenoh_client import Stamped, Subscription
from holdfast import DONE, FAILED, REFUSED
from holdfast.arguments import command_parser
from holdfast.port_holder import holder, taken

LAYOUT = Path(__file__).parent / "layout.json"
LAYOUT_VEHICLE = "bluerov2"
PERIOD_S = 0.02
MAX_CHANNELS = 256

EXAMPLES = """\
examples:
  holdfast foxglove --layout holdfast.json    once: a layout, which Foxglove and Lichtblick import
  holdfast foxglove                           then open "Foxglove WebSocket" there, ws://127.0.0.1:8765
  holdfast foxglove --name kelp               one of several vehicles; a layout is for one name, too
  holdfast foxglove --listen 0.0.0.0:8765     for others on the network: whoever reaches the port can read

The channels are those of a recording, and poses for the 3D panel. Nothing can be sent to the vehicle.
"""


class LiveChannels:
    """The channels of one vehicle: the named one, or else the first that is heard."""

    def __init__(self, vehicle: str, context: foxglove.Context) -> None:
        self._vehicle = vehicle
        self._context = context
        self._channels: dict[tuple[str, str], foxglove.Channel | None] = {}

    def take(self, messages: Iterable[Stamped]) -> None:
        """Pass on what came: each at its sender's time, or else at ours."""
        for key, payload, stamp_s, encoding in messages:
            _, vehicle, _ = f"{key}//".split("/", 2)
            self._vehicle = self._vehicle or vehicle
            if vehicle != self._vehicle:
                continue
            log_ns = time.time_ns() if stamp_s is None else round(stamp_s * NS_PER_S)
            self._log(key, encoding, payload, log_ns)
            if encoding == telemetry.encoding(State):
                self._log_poses(key, payload, log_ns)

    def _log_poses(self, key: str, payload: bytes, log_ns: int) -> None:
        try:
            state = telemetry.decode(key, payload)
        except ValueError:
            return
        if isinstance(state, State):
            for topic, encoding, content in channels(state, self._vehicle, log_ns):
                self._log(topic, encoding, msgspec.json.encode(content), log_ns)

    def _log(self, topic: str, encoding: str, payload: bytes, log_ns: int) -> None:
        known = topic, encoding
        if known not in self._channels and len(self._channels) < MAX_CHANNELS:
            self._channels[known] = self._channel(topic, encoding, payload)
        channel = self._channels.get(known)
        if channel is not None:
            channel.log(payload, log_time=log_ns)

    def _channel(self, topic: str, encoding: str, payload: bytes) -> foxglove.Channel | None:
        """Return a new channel; None for what is not JSON, such as raw ticks."""
        if "json" not in encoding:
            return None
        try:
            name, schema = schema_of(encoding, payload)
        except ValueError:
            return None
        described = foxglove.Schema(name=name, encoding="jsonschema", data=schema)
        return foxglove.Channel(topic, message_encoding="json", schema=described, context=self._context)


def main(argv: list[str]) -> int:
    """Serve until Ctrl-C; return 1 if the port is taken."""
    options = _parser().parse_args(argv)
    if options.layout:
        options.layout.write_text(layout(options.name or LAYOUT_VEHICLE), encoding="utf-8")
        return DONE
    try:
        host, port = listen_address(options.listen)
        _serve(options.name, options.connect, host, port)
    except ValueError as error:
        sys.stderr.write(f"holdfast foxglove: {error}\n")
        return REFUSED
    except RuntimeError as error:  # of the SDK: it could not listen
        said = taken("tcp", port) if holder("tcp", port) else f"--listen {options.listen}: {error}"
        sys.stderr.write(f"holdfast foxglove: {said}\n")
        return FAILED


def layout(vehicle: str) -> str:
    """Return the layout for a vehicle of this name."""
    return LAYOUT.read_text(encoding="utf-8").replace(LAYOUT_VEHICLE, vehicle)


def _serve(name: str, endpoint: str, host: str, port: int) -> NoReturn:
    with (
        Subscription(f"holdfast/{name or '*'}/**", endpoint) as samples,
        Subscription(f"sim/{name or '*'}/truth", endpoint) as truth,
    ):
        context = foxglove.Context()
        server = foxglove.start_server(name="Holdfast", host=host, port=port, context=context)
        sys.stdout.write(f"foxglove: ws://{f'[{host}]' if ':' in host else host}:{server.port}\n")
        sys.stdout.flush()
        live = LiveChannels(name, context)
        try:
            while True:
                live.take([*samples.take_stamped(), *truth.take_stamped()])
                time.sleep(PERIOD_S)
        finally:
            server.stop()


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "foxglove",
        "Serves what a vehicle publishes over Zenoh as a live Foxglove WebSocket, for Foxglove and "
        "Lichtblick. Ctrl-C ends it.",
        EXAMPLES,
    )
    parser.add_argument("--name", metavar="NAME", default="", help="vehicle to show; default: the first one")
    parser.add_argument(
        "--listen",
        metavar="HOST:PORT",
        default="127.0.0.1:8765",
        help="address of the WebSocket (default %(default)s: this machine only)",
    )
    add_connect(parser)
    parser.add_argument(
        "--layout", type=Path, metavar="FILE", help="write the layout for this vehicle's name, and end"
    )
    return parser
