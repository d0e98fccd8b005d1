"""What `holdfast` can do with both rooms at once. Imports nothing heavy before a command is called."""

import argparse
import sys
from importlib.util import find_spec
from pathlib import Path

from lab.options import add_firmware, find_firmware, positive


def demo(argv: list[str]) -> int:
    """Watch a dive twice, without and with the compensator; takes a minute."""
    if not _has("demo", "rich", "matplotlib"):
        return 1
    from lab.demo.demo import main

    return main(argv)


def bench(argv: list[str]) -> int:
    """Measure how well it holds, over many vehicles and seas, and what it costs."""
    parser = argparse.ArgumentParser(
        prog="holdfast bench",
        description="Dives four scenarios, without and with 80 ms more delay, in virtual time with vehicles "
        "drawn from an ensemble, through real MAVLink bytes: the shipped default, other laws and "
        "compensators in its place, ArduSub's own depth hold, and beside them the computed LQG floor. A "
        "dive takes about 3 s of a core: all rows with 60 vehicles 5 core-hours, with --seeds 10 an hour. "
        "Then measures the process itself against its bounds. Only when named: `zenoh` measures what "
        "slow, stopped and killed subscribers do to the tick, in six minutes; `ablation` takes away one part "
        "of the controller after the other, and asks where the network beats an observer; `firmware` dives "
        "the default and ALT_HOLD with our stand-in and with the real ArduSub, side by side.",
    )
    parser.add_argument(
        "what",
        nargs="?",
        choices=("dives", "process", "zenoh", "ablation", "firmware"),
        help="only this; default: dives and process",
    )
    parser.add_argument("--seeds", type=positive, metavar="N", help="vehicles; default 60, with a firmware 4")
    parser.add_argument("--rows", nargs="+", metavar="ROW", help="only these, such as default law ppi")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="companion's config")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures there")
    parser.add_argument(
        "--out", type=Path, default=Path("out/bench"), metavar="DIR", help="for plots; default %(default)s"
    )
    add_firmware(parser)
    arguments = parser.parse_args(argv)
    if arguments.firmware is not None and arguments.what not in ("dives", "ablation", "firmware"):
        parser.error("--firmware goes with dives, ablation or firmware")
    if arguments.what == "firmware" and arguments.firmware is None:
        arguments.firmware = ""
    if arguments.seeds is None:
        arguments.seeds = 60 if arguments.firmware is None else 4
    if not find_firmware("bench", arguments):
        return 2
    from lab.bench.report import run

    return run(arguments)


def paper(argv: list[str]) -> int:
    """Dive the paper's simulations again: its figures and its claims."""
    parser = argparse.ArgumentParser(
        prog="holdfast paper",
        description="Repeats the paper's three simulations and a table of law, integrator and network over "
        "five disturbances, four wrong models and ten draws of first weights, all dives at once. "
        "Exit status 1 if something that must come out did not.",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/paper"), metavar="DIR", help="default %(default)s"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same records there")
    arguments = parser.parse_args(argv)
    from lab.paper.report import run

    return run(arguments)


def tune(argv: list[str]) -> int:
    """Search the gains for your own vehicle, or for the rows of the bench."""
    from companion.config import DEFAULT_FILE
    from sim_bridge.commands import DEFAULT_CONFIG

    parser = argparse.ArgumentParser(
        prog="holdfast tune",
        description="Searches (CMA-ES) the gains of heave over dives in virtual time, half with 40 ms "
        "more delay each way, half with 15 % more thrust and 40 ms of delay that nobody tells. Without ROW: "
        "those of your configuration on your vehicle, written as a configuration. With ROW: those of "
        "`holdfast bench`, as lab/tuned.toml has them.",
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help="rows of the bench, or all")
    parser.add_argument(
        "--vehicle", type=Path, default=DEFAULT_CONFIG, metavar="FILE", help="the simulator's"
    )
    parser.add_argument("--config", type=Path, default=DEFAULT_FILE, metavar="FILE", help="the companion's")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="companion's config")
    parser.add_argument(
        "--evaluations", type=positive, default=150, metavar="N", help="of each; default %(default)s"
    )
    parser.add_argument(
        "--seeds", type=positive, default=8, metavar="N", help="vehicles; default %(default)s"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="default: out/tune/")
    arguments = parser.parse_args(argv)
    from lab.tuning.report import run

    return run(arguments)


def campaign(argv: list[str]) -> int:
    """Dive thousands of times with vehicles, links and seas that nobody tuned for."""
    parser = argparse.ArgumentParser(
        prog="holdfast campaign",
        description="Every published vehicle set, varied in damping, mass and thrust, with delay, dead "
        "thrusters and disturbances; a dive's number is its seed. Rows are appended to DIR/dives.csv, and "
        "the same command continues where a run stopped. Exit status 1 if a dive inside the envelope did "
        "not hold.",
    )
    parser.add_argument("--dives", type=int, default=6000, metavar="N", help="default %(default)s")
    parser.add_argument(
        "--first", type=int, default=0, metavar="ID", help="number of the first dive; default 0"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/campaign"), metavar="DIR", help="default %(default)s"
    )
    parser.add_argument(
        "--workers", type=int, metavar="N", help="processes on this machine; default: its cores"
    )
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="of a Dask cluster to dive on, tcp://HOST:PORT"
    )
    parser.add_argument(
        "--replay", type=int, metavar="ID", help="only this dive, in the batch and the full loop"
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="companion's config")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write a summary there")
    from lab.campaign.report import main

    return main(parser.parse_args(argv))


def faults(argv: list[str]) -> int:
    """Break something in thousands of dives, and hold every tick to account."""
    from lab.faults.report import main

    return main(argv)


def rerun(argv: list[str]) -> int:
    """Run a recorded dive through today's engine and compare its commands."""
    if not _has("rerun", "mcap", "matplotlib"):
        return 2
    from lab.rerun.command import main

    return main(argv)


def report(argv: list[str]) -> int:
    """Make the page after the dive: what was held, how well, and what to change."""
    if not _has("report", "mcap", "matplotlib"):
        return 1
    from lab.report.report import main

    return main(argv)


def _has(command: str, *needed: str) -> bool:
    missing = [name for name in needed if find_spec(name) is None]
    if missing:
        needed_too = " and ".join(missing)
        sys.stderr.write(
            f"holdfast {command}: needs {needed_too}. Install the extra: pip install 'holdfast[lab]'\n"
        )
    return not missing
