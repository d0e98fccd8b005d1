"""`holdfast sim` and `holdfast fault`. Nothing heavy is imported before one is called."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from holdfast.arguments import command_parser, removed_option

if TYPE_CHECKING:
    from sim_bridge.fault_kinds import Fault

DEFAULT_CONFIG = Path(__file__).parent.parent / "config" / "sim.toml"

EXAMPLES = """\
examples:
  holdfast sim                                    call udp 127.0.0.1:14550 and serve tcp 127.0.0.1:5760
  holdfast sim --set waves.enabled=true --set sensors.depth_scale=1.025
  holdfast sim --set 'load={enabled=true, weight_n=15, on_s=20, off_s=60}'
  holdfast sim --fault message_frozen,message=ATTITUDE,at_s=30,duration_s=5 --fault leak,at_s=60
  holdfast sim --list                             vehicles, dives and kinds of faults, a line each
  holdfast sim --live-faults                      and, from another terminal:
  holdfast fault thruster,thruster=3,value=0.2,duration_s=20
  holdfast sim --vehicle bluerov2 --name kelp     beside holdfast run --vehicle bluerov2 --name kelp
  holdfast sim --vehicle my-dive.toml --udp-listen 0.0.0.0:14551 --speed 4 --no-zenoh
  mavproxy.py --master tcp:127.0.0.1:5760         any MAVLink ground station can connect
  holdfast sim --physics-only                     physics for ArduSub's own simulator, started with `--model
                                                  JSON:127.0.0.1`, which sends to udp 127.0.0.1:9002

Endpoints may be repeated; if any is given, the default ones are not opened. The true state is published on
the Zenoh key sim/NAME/truth, which no companion reads. With --live-faults the simulator takes faults on
sim/NAME/fault, from everybody who reaches its Zenoh endpoint; without it, from nobody. The times of a
load count from the first arming, of faults from the start, of `holdfast fault` from their arrival.

With --physics-only the real ArduSub provides MAVLink, parameters, sensors and speed; the simulator provides
hull, thrusters, battery, seabed, current, waves, tether, cable, load and heave_force. Its time follows the
firmware's frames, and the times of a load count from the first motion of a motor. If the firmware restarts,
the vehicle keeps its position.
"""

FAULT_EXAMPLES = """\
examples:
  holdfast fault thruster,thruster=3,value=0.2,duration_s=20    a fifth of its thrust is left
  holdfast fault leak --name kelp                               to the simulator of this name
  holdfast fault clear                                          all faults end
Exit status: 0 it begins, 1 no simulator takes faults there.
"""


def sim(argv: list[str]) -> int:
    """Simulate an ArduSub vehicle that speaks MAVLink."""
    about = "Simulate an ArduSub vehicle in the water: MAVLink over UDP and TCP, in real time."
    parser = command_parser("sim", about, EXAMPLES)
    add = parser.add_argument
    endpoint: dict[str, Any] = {"metavar": "HOST:PORT", "type": _endpoint}
    several: dict[str, Any] = {"action": "append", "default": []}
    fault: dict[str, Any] = {"metavar": "KIND[,KEY=VALUE...]", "type": _fault}
    add("--udp-connect", **endpoint, **several, help="send to this address")
    add("--udp-listen", **endpoint, **several, help="listen, and answer any sender")
    add("--tcp", **endpoint, **several, help="listen for TCP clients")
    add(
        "--vehicle",
        "--config",
        dest="config",
        metavar="NAME|FILE",
        type=vehicle_file,
        default=DEFAULT_CONFIG,
        help="a vehicle or a dive of --list, such as bluerov2, or a file (default: heavy)",
    )
    add("--set", metavar="KEY=VALUE", **several, help="override a key of the configuration; VALUE is TOML")
    add(
        "--fault",
        **fault,
        **several,
        help="add a fault to those of the configuration; --list names the kinds",
    )
    said = "take faults over Zenoh while it runs, from everybody at the endpoint"
    add("--live-faults", action="store_true", help=said)
    removed_option(parser, "--inject", "`holdfast fault` sends one")
    add("--list", action="store_true", help="list vehicles, dives and kinds of faults, and end")
    said = "random seed of sea and noise (default: %(default)s)"
    add("--seed", metavar="N", type=_seed, default=1, help=said)
    said = "speed relative to real time (default: %(default)s)"
    add("--speed", metavar="X", type=_speed, default=1.0, help=said)
    _add_zenoh(parser)
    add("--no-zenoh", action="store_true", help="do not publish the true state")
    add(
        "--physics-only",
        **endpoint,
        nargs="?",
        const=("127.0.0.1", 9002),
        help="serve as external physics for the real ArduSub (JSON backend) at this address "
        "(default: 127.0.0.1:9002, for instance 0)",
    )
    arguments = parser.parse_args(argv)

    if arguments.list:
        from sim_bridge.listing import listing

        sys.stdout.write(listing(shipped()))
        return 0

    from msgspec.structs import replace

    from sim_bridge.app import Settings, run
    from sim_bridge.config import load_config

    config = load_config(arguments.config, arguments.set)
    config = replace(config, faults=(*config.faults, *arguments.fault))
    if arguments.live_faults and (arguments.no_zenoh or arguments.physics_only):
        sys.stderr.write("holdfast sim: --live-faults needs Zenoh, and our own vehicle\n")
        return 2
    named = arguments.udp_connect or arguments.udp_listen or arguments.tcp
    if arguments.physics_only and (named or arguments.speed != 1.0 or config.faults):
        sys.stderr.write(
            "holdfast sim: --physics-only takes no endpoint, --speed or faults: MAVLink and time are the "
            "firmware's (its --serial0, --speedup)\n"
        )
        return 2
    settings = Settings(
        udp_connect=tuple(arguments.udp_connect) if named else (("127.0.0.1", 14550),),
        udp_listen=tuple(arguments.udp_listen),
        tcp=tuple(arguments.tcp) if named else (("127.0.0.1", 5760),),
        zenoh="" if arguments.no_zenoh else arguments.zenoh,
        vehicle=arguments.name,
        speed=arguments.speed,
        physics=arguments.physics_only,
        live_faults=arguments.live_faults,
    )
    return run(config, arguments.seed, settings)


def fault(argv: list[str]) -> int:
    """Break something in a running simulator, and see what happens."""
    about = "Sends a fault to `holdfast sim --live-faults`. No real vehicle can take one."
    parser = command_parser("fault", about, FAULT_EXAMPLES)
    parser.add_argument(
        "fault", metavar="KIND[,KEY=VALUE...]", type=_fault, help="`holdfast sim --list` names the kinds"
    )
    _add_zenoh(parser)
    arguments = parser.parse_args(argv)
    from sim_bridge.zenoh_link import inject

    reply = inject(arguments.zenoh, arguments.name, arguments.fault)
    sys.stdout.write(f"{reply.said}\n")
    return 0 if reply.done else 1


def _add_zenoh(parser: argparse.ArgumentParser) -> None:
    said = "Zenoh router or peer (default: %(default)s)"
    parser.add_argument("--zenoh", metavar="ENDPOINT", default="tcp/127.0.0.1:7447", help=said)
    said = "name in the Zenoh key, as `holdfast run --name` (default: %(default)s)"
    parser.add_argument("--name", metavar="NAME", default="bluerov2", help=said)


def shipped(folder: Path = DEFAULT_CONFIG.parent) -> dict[str, Path]:
    """Return the vehicles and dives that come along, by their names: sim-bluerov2.toml is bluerov2."""
    files = {path.stem.removeprefix("sim-"): path for path in sorted(folder.glob("sim-*.toml"))}
    return {"heavy": folder / DEFAULT_CONFIG.name, **files}


def vehicle_file(text: str) -> Path:
    """Return the file of a simulated vehicle or dive: one that comes along, by its name, or a path."""
    if text in shipped():
        return shipped()[text]
    if not text.endswith(".toml"):
        raise argparse.ArgumentTypeError(
            f"'{text}' is neither one of {', '.join(shipped())} nor a .toml file"
        )
    return Path(text)


def _endpoint(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or not 0 <= int(port) <= 65535:
        raise argparse.ArgumentTypeError(f"'{text}' is not HOST:PORT, such as 127.0.0.1:14550")
    return host, int(port)


def _fault(text: str) -> "Fault":
    from sim_bridge.config import ConfigError, fault_of

    try:
        return fault_of(text)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _seed(text: str) -> int:
    if not (text.isascii() and text.isdigit()):
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number of 0 or more")
    return int(text)


def _speed(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value <= 100.0:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number above 0, up to 100")
    return value
