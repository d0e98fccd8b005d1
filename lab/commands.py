"""The subcommands that need companion and simulator. Heavy imports wait until a command is called."""

import sys
from importlib import import_module
from pathlib import Path

from holdfast.command_line import command_parser
from lab.options import json_file

BENCHES = {
    "dives": "lab.studies.dives:Dives",
    "position": "lab.studies.places:Courses",
    "reality": "lab.studies.reality:Reality",
    "rivals": "lab.studies.rivals:Rivals",
    "firmware": "lab.studies.fidelity:Fidelity",
}
BENCH_EXAMPLES = """\
further benches, each with its own --help:
  position    places and paths in a current, with a DVL, beside a P-PI and ArduSub's POSHOLD and GUIDED
  reality     vehicles between the published models and a real one, in current, waves, tether;
              --scenarios: a gain of its own on each axis, light ones, a Heavy as measured in a tank
  rivals      other laws on such vehicles, in depth and in place
  firmware    our simulator beside the real ArduSub

examples:
  holdfast lab bench dives --seeds 4                             a quick look: all rows, 4 vehicles
  holdfast lab bench dives --rows default ppi --scenarios waves  compare two rows in one scenario
  holdfast lab bench dives --set heave.kappa_per_s=8             the shipped default with another gain
  holdfast lab bench dives --seeds 4 --table out/dives.csv       also a table with one row for each dive
"""
PAPER_EXAMPLES = """\
examples:
  holdfast lab paper                          print tables and checks; draw the four figures in out/paper
  holdfast lab paper --json out/paper.json    also write the numbers
"""
TUNE_EXAMPLES = """\
examples:
  holdfast lab tune all                                   every row of the bench; hours
  holdfast lab tune ppi indi                              two rows
  holdfast lab tune law --evaluations 40 --seeds 4        a quick search
"""
FAULTS_EXAMPLES = """\
examples:
  holdfast lab faults --dives 102             a quick look
  holdfast lab faults --first 417 --dives 1   one dive again
  holdfast lab faults --firmware --dives 50   against the real ArduSub

Exit status: 0 every dive kept every promise, 1 one did not.
"""
SCHEMA_EXAMPLES = """\
examples:
  holdfast lab schema            print all keys, fields, units and commands
  holdfast lab schema --write    update the documents after a change of schemas or configuration
  holdfast lab schema --json DIR write the JSON Schemas of all these and of the configuration
"""


def _study(name: str, argv: list[str], examples: str) -> int:
    """Start a study, named "module:class"."""
    from lab.study import start

    module, _, kind = name.partition(":")
    return start(getattr(import_module(module), kind), argv, examples)


def demo(argv: list[str]) -> int:
    """Simulate a dive with ALT_HOLD and with Holdfast, for a minute."""
    from lab.demo.demo import main

    return main(argv)


def bench(argv: list[str]) -> int:
    """Measure control errors over many vehicles and seas."""
    what, rest = (argv[0], argv[1:]) if argv and not argv[0].startswith("-") else ("dives", argv)
    if what not in BENCHES:
        sys.stderr.write(f"holdfast lab bench: there is no bench '{what}'. Known: {', '.join(BENCHES)}\n")
        return 2
    return _study(BENCHES[what], rest, BENCH_EXAMPLES)


def schema(argv: list[str]) -> int:
    """Print every telemetry key, field, unit and command; --write updates docs/."""
    about = "Prints the generated part of docs/telemetry.md: all keys, schemas and commands."
    parser = command_parser("lab schema", about, SCHEMA_EXAMPLES)
    parser.add_argument("--write", action="store_true", help="update the generated pages of docs/")
    parser.add_argument("--json", type=Path, metavar="DIR", help="write JSON Schemas there")
    stamp = "with --write, for a release: tables say whether they measured this code"
    parser.add_argument("--stamp", action="store_true", help=stamp)
    arguments = parser.parse_args(argv)
    from lab.documents import pages, schemas, write

    if arguments.json:
        arguments.json.mkdir(parents=True, exist_ok=True)
        for name, content in schemas().items():
            (arguments.json / name).write_bytes(content)
    elif arguments.write:
        sys.stdout.write(
            "".join(f"docs/{path.name}\n" for path in write(arguments.stamp)) or "nothing was stale\n"
        )
    else:
        sys.stdout.write(pages()["telemetry.md"])
    return 0


def paper(argv: list[str]) -> int:
    """Repeat the paper's simulations and check its claims."""
    parser = command_parser(
        "lab paper",
        "Repeats the paper's simulations: both forms of its law, alone, with an integrator and with the "
        "network, in five disturbances, and draws its four figures. Exit status 1 if a result differs from "
        "the expected one.",
        PAPER_EXAMPLES,
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/paper"), metavar="DIR", help="default %(default)s"
    )
    parser.add_argument("--json", type=json_file, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args(argv)
    from lab.paper.paper import run

    return run(arguments)


def tune(argv: list[str]) -> int:
    """Search gains for your vehicle, or for the rows of the bench."""
    return _study("lab.studies.tune:Tune", argv, TUNE_EXAMPLES)


def faults(argv: list[str]) -> int:
    """Inject faults into thousands of simulated dives, and check every tick."""
    return _study("lab.studies.fault_dives:FaultDives", argv, FAULTS_EXAMPLES)


def identify(argv: list[str]) -> int:
    """Measure a vehicle by moving it, or from logs, and write its file."""
    from companion.commands import identify as move
    from lab.identify.identify_command import conclude, main

    if any(argument.partition("=")[0] in ("--from", "--test") for argument in argv):
        return main(argv)
    return move(argv, lambda table, *others: conclude([table], *others))


def rerun(argv: list[str]) -> int:
    """Run a recorded dive through the present code and compare its commands."""
    from lab.rerun.rerun import main

    return main(argv)


def report(argv: list[str]) -> int:
    """Write a report of a recorded dive: warnings, errors, thrust."""
    from lab.report.report import main

    return main(argv)
