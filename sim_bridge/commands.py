"""`holdfast sim` and `holdfast fault`. Nothing heavy is imported before one is called."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from holdfast.command_line import address, command_parser

if TYPE_CHECKING:
    from sim_bridge.fault_kinds import Fault

DEFAULT_CONFIG = Path(__file__).parent.parent / "config" / "sim.toml"

EXAMPLES = """\
examples:
  holdfast sim                                    call udp 127.0.0.1:14550 and serve tcp 127.0.0.1:5760
  holdfast sim --set waves.enabled=true --set sensors.depth_scale=1.025
  holdfast sim --fault message_frozen,message=ATTITUDE,at_s=30,duration_s=5 --fault leak,at_s=60
  holdfast sim --list                             vehicles, dives and kinds of faults, a line each
  holdfast sim --live-faults                      and, from another terminal:
  holdfast fault thruster,thruster=3,value=0.2,duration_s=20
  holdfast sim --vehicle bluerov2 --name kelp     beside holdfast run --vehicle bluerov2 --name kelp
  holdfast sim --physics-only                     physics for ArduSub's own simulator, started with `--model
                                                  JSON:127.0.0.1`, which sends to udp 127.0.0.1:9002

Endpoints may be repeated; if any is given, the default ones are not opened. The true state is published on
the Zenoh key sim/NAME/truth, which no companion reads. With --live-faults the simulator takes faults on
sim/NAME/fault, from everybody who reaches its Zenoh endpoint; without it, from nobody. The times of a load
count from the first arming (with --physics-only from the first motion of a motor), of faults from the start,
of `holdfast fault` from their arrival.
"""

FAULT_EXAMPLES = """\
examples:
  holdfast fault thruster,thruster=3,value=0.2,duration_s=20    a fifth of its thrust is left
  holdfast fault stick,axis=z,value=1,duration_s=5              the pilot's stick is full up, then released
  holdfast fault leak --name kelp                               to the simulator of this name
  holdfast fault clear                                          all faults end
Exit status: 0 it begins, 1 no simulator takes faults there.
"""

ZENOH: dict[str, tuple[str, dict[str, Any]]] = {
    "--zenoh": (
        "Zenoh router or peer (default: %(default)s)",
        {"metavar": "ENDPOINT", "default": "tcp/127.0.0.1:7447"},
    ),
    "--name": (
        "name in the Zenoh key, as `holdfast run --name` (default: %(default)s)",
        {"metavar": "NAME", "default": "bluerov2"},
    ),
}


def sim(argv: list[str]) -> int:
    """Simulate an ArduSub vehicle that speaks MAVLink."""
    arguments = _sim_parser().parse_args(argv)
    if arguments.list:
        from sim_bridge.listing import listing

        sys.stdout.write(listing(shipped()))
        return 0

    from msgspec.structs import replace

    from sim_bridge.app import Settings, run
    from sim_bridge.sim_config import load_config

    config = load_config(arguments.config, arguments.set)
    config = replace(config, faults=(*config.faults, *arguments.fault))
    if arguments.live_faults and (arguments.no_zenoh or arguments.physics_only):
        sys.stderr.write("holdfast sim: --live-faults needs Zenoh, and our own vehicle\n")
        return 2
    named = arguments.udp_connect or arguments.tcp
    if arguments.physics_only and (named or config.faults):
        sys.stderr.write(
            "holdfast sim: --physics-only takes no endpoint or faults: MAVLink is the firmware's --serial0\n"
        )
        return 2
    settings = Settings(
        udp_connect=tuple(arguments.udp_connect) if named else (("127.0.0.1", 14550),),
        tcp=tuple(arguments.tcp) if named else (("127.0.0.1", 5760),),
        zenoh="" if arguments.no_zenoh else arguments.zenoh,
        vehicle=arguments.name,
        physics=arguments.physics_only,
        live_faults=arguments.live_faults,
    )
    return run(config, arguments.seed, settings)


def fault(argv: list[str]) -> int:
    """Break something in a running simulator, and see what happens."""
    about = "Sends a fault to `holdfast sim --live-faults`. No real vehicle can take one."
    parser = command_parser("fault", about, FAULT_EXAMPLES)
    said = "`holdfast sim --list` names the kinds"
    parser.add_argument("fault", metavar="KIND[,KEY=VALUE...]", type=_fault, help=said)
    for name, (said, how) in ZENOH.items():
        parser.add_argument(name, help=said, **how)
    arguments = parser.parse_args(argv)
    from sim_bridge.zenoh_link import inject

    reply = inject(arguments.zenoh, arguments.name, arguments.fault)
    sys.stdout.write(f"{reply.said}\n")
    return 0 if reply.done else 1


def _sim_parser() -> argparse.ArgumentParser:
    about = "Simulate an ArduSub vehicle in the water: MAVLink over UDP and TCP, in real time."
    parser = command_parser("sim", about, EXAMPLES)
    several: dict[str, Any] = {"action": "append", "default": []}
    endpoint: dict[str, Any] = {"metavar": "HOST:PORT", "type": address}
    fault: dict[str, Any] = {"metavar": "KIND[,KEY=VALUE...]", "type": _fault}
    options: dict[str, tuple[str, dict[str, Any]]] = {
        "--udp-connect": ("send to this address", endpoint | several),
        "--tcp": ("listen for TCP clients", endpoint | several),
        "--set": ("override a key of the configuration; VALUE is TOML", {"metavar": "KEY=VALUE"} | several),
        "--fault": ("add a fault to those of the configuration; --list names the kinds", fault | several),
        "--live-faults": (
            "take faults over Zenoh while it runs, from everybody at the endpoint",
            {"action": "store_true"},
        ),
        "--list": ("list vehicles, dives and kinds of faults, and end", {"action": "store_true"}),
        "--seed": (
            "random seed of sea and noise (default: %(default)s)",
            {"metavar": "N", "type": _seed, "default": 1},
        ),
        **ZENOH,
        "--no-zenoh": ("do not publish the true state", {"action": "store_true"}),
        "--physics-only": (
            "serve as external physics for the real ArduSub (JSON backend) at this address (default: "
            "127.0.0.1:9002, for instance 0)",
            endpoint | {"nargs": "?", "const": ("127.0.0.1", 9002)},
        ),
    }
    for name, (said, how) in options.items():
        parser.add_argument(name, help=said, **how)
    said = "a vehicle or a dive of --list, such as bluerov2, or a file (default: heavy)"
    parser.add_argument(
        *("--vehicle", "--config"),
        dest="config",
        metavar="NAME|FILE",
        type=vehicle_file,
        default=DEFAULT_CONFIG,
        help=said,
    )
    return parser


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


def _fault(text: str) -> "Fault":
    from sim_bridge.sim_config import ConfigError, fault_of

    try:
        return fault_of(text)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _seed(text: str) -> int:
    if not (text.isascii() and text.isdigit()):
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number of 0 or more")
    return int(text)
