"""The subcommands that need companion and simulator. Heavy imports wait until a command is called."""

from pathlib import Path

from holdfast.arguments import command_parser
from lab.options import add_firmware, add_settings, find_firmware, json_file, not_negative, positive
from lab.tables import add_files

BENCH_EXAMPLES = """\
examples:
  holdfast bench dives --seeds 4                             a quick look: all rows, 4 vehicles
  holdfast bench dives --rows default ppi --scenarios waves  compare two rows in one scenario
  holdfast bench position --seeds 4                          places and paths, beside a PID
  holdfast bench process                                     only the process: memory, tick, jitter
  holdfast bench dives --set heave.kappa_per_s=8             the shipped default with another gain
  holdfast bench dives --seeds 4 --table out/dives.csv       also a table with one row for each dive
  holdfast bench fleet --vehicles 10                         ten vehicles at one router
  holdfast bench soak --minutes 120                          two hours, everything live
  holdfast bench firmware                                    our simulator beside the real ArduSub
"""
PAPER_EXAMPLES = """\
examples:
  holdfast paper                          print the tables; write figures and plots to out/paper
  holdfast paper --json out/paper.json    also write the numbers
"""
TUNE_EXAMPLES = """\
examples:
  holdfast tune                                       tune the shipped configuration; half an hour
  holdfast tune --vehicle bluerov2                    for another simulated vehicle
  holdfast tune --evaluations 40 --seeds 4            a quick search
  holdfast tune ppi l1                                two rows of the bench
"""
CAMPAIGN_EXAMPLES = """\
examples:
  holdfast campaign --dives 200                             a quick look, to out/campaign
  holdfast campaign                                         all 6000 dives; the same command continues
  holdfast campaign --table out/campaign.parquet            the same rows as a Parquet file
  holdfast campaign --replay 1234                           one dive again, in the batch and in the full loop
  holdfast campaign --scheduler tcp://192.168.2.10:8786     on a Dask cluster, whose workers were started
                                                            with `dask worker --preload holdfast`
"""


FIRMWARE_DIVES = ("dives", "position", "ablation", "grid", "firmware")


def demo(argv: list[str]) -> int:
    """Dive a minute: what the pilot has today, beside Holdfast."""
    from lab.demo.demo import main

    return main(argv)


def bench(argv: list[str]) -> int:
    """Measure control errors over many vehicles and seas, and the cost of a tick."""
    parser = command_parser(
        "bench",
        "Simulates four scenarios, without and with 80 ms more delay, with random vehicles, in virtual time "
        "and with real MAVLink bytes: the shipped default, other laws and compensators, ArduSub's depth "
        "hold, and the computed LQG floor. One dive takes 3 s on one core; all rows with 60 vehicles take 5 "
        "core-hours, with --seeds 10 one hour. Then it measures the process against its limits. Eight "
        "benches run only on request: `position` holds a place and follows paths in a current, with a DVL, "
        "beside a PID and ArduSub's POSHOLD and GUIDED; `zenoh` measures the effect of slow, stopped and "
        "killed subscribers on the tick, in six minutes; `fleet` what many vehicles at one router with TLS "
        "cost, in two minutes; `soak` runs everything live for hours, and measures memory, lateness and "
        "lost records; `ablation` removes one part of the controller at a time, and compares the network "
        "with the observer; `network` compares learners on each axis, in the full loop; `grid` dives "
        "vehicles of a third to three times the nominal gain, with other lags and delays, and lists limit "
        "cycles; `firmware` compares our simulator with the real ArduSub, for the default and for ALT_HOLD.",
        BENCH_EXAMPLES,
    )
    parser.add_argument(
        "what",
        nargs="?",
        choices=(
            "dives",
            "position",
            "process",
            "zenoh",
            "fleet",
            "soak",
            "ablation",
            "network",
            "grid",
            "firmware",
        ),
        help="run only this bench; default: dives and process",
    )
    parser.add_argument(
        "--seeds", type=positive, metavar="N", help="number of vehicles; default 60, with --firmware 4"
    )
    parser.add_argument(
        "--vehicles", type=positive, default=20, metavar="N", help="of the fleet; default %(default)s"
    )
    parser.add_argument(
        "--minutes", type=positive, default=120, metavar="MIN", help="of the soak; default %(default)s"
    )
    parser.add_argument(
        "--rows", nargs="+", metavar="ROW", help="run only these rows, such as: default law ppi"
    )
    parser.add_argument(
        "--scenarios",
        nargs="+",
        metavar="NAME",
        help="run only these: waves, path, load, calm; position: station, lemniscate, circle, thruster",
    )
    parser.add_argument(
        "--cells",
        nargs="+",
        metavar="SET",
        default=["lines", "corners", "latin"],
        help="sets of cells of the grid: lines, corners, latin, full (1680 dives); default the first three",
    )
    add_settings(parser)
    add_files(parser, row="dive")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/bench"),
        metavar="DIR",
        help="folder for plots; default %(default)s",
    )
    add_firmware(parser)
    arguments = parser.parse_args(argv)
    if arguments.firmware is not None and arguments.what not in FIRMWARE_DIVES:
        parser.error(f"--firmware goes with {', '.join(FIRMWARE_DIVES)}")
    if arguments.table and arguments.what in ("process", "zenoh"):
        parser.error(f"--table has a row for each dive, and `{arguments.what}` dives none; use --json")
    if arguments.what == "firmware" and arguments.firmware is None:
        arguments.firmware = ""
    if arguments.seeds is None:
        arguments.seeds = 60 if arguments.firmware is None else 4
    if not find_firmware("bench", arguments):
        return 2
    from lab.bench.report import run

    return run(arguments)


def paper(argv: list[str]) -> int:
    """Repeat the paper's simulations and check its claims."""
    parser = command_parser(
        "paper",
        "Repeats the paper's three simulations, and compares law, integrator and network for "
        "five disturbances, four wrong models and ten sets of initial weights. Exit status 1 if a result "
        "differs from the expected one.",
        PAPER_EXAMPLES,
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/paper"), metavar="DIR", help="default %(default)s"
    )
    parser.add_argument("--json", type=json_file, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args(argv)
    from lab.paper.report import run

    return run(arguments)


def tune(argv: list[str]) -> int:
    """Search gains for your vehicle, or for the rows of the bench."""
    from companion.config import DEFAULT_FILE
    from sim_bridge.commands import DEFAULT_CONFIG, vehicle_file

    parser = command_parser(
        "tune",
        "Searches gains of heave by CMA-ES over simulated dives: half of them with 40 ms more "
        "delay each way, half with 15 % more thrust and 40 ms of hidden delay. Without ROW it tunes your "
        "configuration for your vehicle and writes a configuration file. With ROW it tunes rows of `holdfast "
        "bench`, for lab/bench/tuned.toml.",
        TUNE_EXAMPLES,
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help="a row of the bench, or all")
    parser.add_argument(
        "--vehicle",
        type=vehicle_file,
        default=DEFAULT_CONFIG,
        metavar="NAME|FILE",
        help="the simulated vehicle, as of `holdfast sim` (default: heavy)",
    )
    parser.add_argument(
        "--config", type=Path, default=DEFAULT_FILE, metavar="FILE", help="configuration of the companion"
    )
    add_settings(parser)
    parser.add_argument(
        "--evaluations",
        type=positive,
        default=150,
        metavar="N",
        help="evaluations for each row; default %(default)s",
    )
    parser.add_argument(
        "--seeds", type=positive, default=8, metavar="N", help="number of vehicles; default %(default)s"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="default: out/tune/")
    arguments = parser.parse_args(argv)
    from lab.tuning.report import run

    return run(arguments)


def campaign(argv: list[str]) -> int:
    """Simulate thousands of dives with new vehicles, links and seas."""
    parser = command_parser(
        "campaign",
        "Simulates every published vehicle with varied damping, mass and thrust, with delays, "
        "dead thrusters and disturbances. The number of a dive is its seed. Each dive appends a row to "
        "DIR/dives.csv; if a run was interrupted, the same command continues it. Exit status 1 if Holdfast "
        "lost a vehicle inside the declared envelope.",
        CAMPAIGN_EXAMPLES,
    )
    parser.add_argument("--dives", type=positive, default=6000, metavar="N", help="default %(default)s")
    parser.add_argument(
        "--first", type=not_negative, default=0, metavar="ID", help="number of the first dive; default 0"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/campaign"), metavar="DIR", help="default %(default)s"
    )
    parser.add_argument(
        "--workers", type=positive, metavar="N", help="processes on this machine; default: its cores"
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="run on this Dask cluster, tcp://HOST:PORT")
    parser.add_argument(
        "--replay",
        type=not_negative,
        metavar="ID",
        help="repeat only this dive, in the batch and in the full loop",
    )
    add_settings(parser)
    add_files(parser, row="dive")
    arguments = parser.parse_args(argv)
    from lab.campaign.report import main

    return main(arguments)


def faults(argv: list[str]) -> int:
    """Inject faults into thousands of simulated dives, and check every tick."""
    from lab.faults.report import main

    return main(argv)


def rerun(argv: list[str]) -> int:
    """Run a recorded dive through the present code and compare its commands."""
    from lab.rerun.command import main

    return main(argv)


def report(argv: list[str]) -> int:
    """Write a report of a recorded dive: control errors, events and advice."""
    from lab.report.report import main

    return main(argv)
