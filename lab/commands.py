"""The subcommands that need companion and simulator. Heavy imports wait until a command is called."""

import sys
from pathlib import Path

from holdfast.arguments import command_parser
from lab.options import json_file

BENCH_EXAMPLES = """\
further benches, each with its own --help:
  position    places and paths in a current, with a DVL, beside a PID and ArduSub's POSHOLD and GUIDED
  soak        everything live for hours (--minutes MIN): memory, lateness, lost records
  tank        a real BlueROV2 Heavy as it was measured, with the nominal preset and with its own
  reality     vehicles between the published models and that one, in current, waves, tether;
              --scenarios axes: a gain of its own on each axis; light-waves, light-path: light ones
  firmware    our simulator beside the real ArduSub

examples:
  holdfast lab bench dives --seeds 4                             a quick look: all rows, 4 vehicles
  holdfast lab bench dives --rows default ppi --scenarios waves  compare two rows in one scenario
  holdfast lab bench position --seeds 4                          places and paths, beside a PID
  holdfast lab bench dives --set heave.kappa_per_s=8             the shipped default with another gain
  holdfast lab bench dives --seeds 4 --table out/dives.csv       also a table with one row for each dive
  holdfast lab bench soak --minutes 120                          two hours, everything live
  holdfast lab bench firmware                                    our simulator beside the real ArduSub
"""
PAPER_EXAMPLES = """\
examples:
  holdfast lab paper                          print tables and checks; draw the four figures in out/paper
  holdfast lab paper --json out/paper.json    also write the numbers
"""
TUNE_EXAMPLES = """\
examples:
  holdfast lab tune                                       tune the shipped configuration; half an hour
  holdfast lab tune --vehicle bluerov2                    for another simulated vehicle
  holdfast lab tune --evaluations 40 --seeds 4            a quick search
  holdfast lab tune ppi l1                                two rows of the bench
"""
CAMPAIGN_EXAMPLES = """\
examples:
  holdfast lab campaign --dives 200                             a quick look, to out/campaign
  holdfast lab campaign                                         6000 dives; the same command continues
  holdfast lab campaign --table out/campaign.csv                also a table with one row for each dive
  holdfast lab campaign --replay 1234                           one again, in the batch and in the full loop
  holdfast lab campaign --corners                               vehicles of a third and three times the gain
"""


FAULTS_EXAMPLES = """\
examples:
  holdfast lab faults --dives 102             a quick look
  holdfast lab faults --first 417 --dives 1   one dive again
  holdfast lab faults --firmware --dives 50   against the real ArduSub

Exit status: 0 every dive kept every promise, 1 one did not.
"""

BENCHES = {
    "dives": "lab.studies.dives:Dives",
    "position": "lab.studies.position:Courses",
    "tank": "lab.studies.tank:Tank",
    "reality": "lab.studies.reality:Reality",
    "rivals": "lab.studies.rivals:Rivals",
    "firmware": "lab.studies.fidelity:Fidelity",
    "soak": "lab.operations.soak:Soak",
}

GONE = {
    "lab bench ablation": "`holdfast lab bench dives --rows law observer network default` compares the parts",
    "lab bench axes": "use `holdfast lab bench reality --scenarios axes`",
    "lab bench grid": "use `holdfast lab campaign --corners`",
    "lab bench light": "use `holdfast lab bench reality --scenarios light-waves light-path`",
    "lab bench published": "docs/decisions/0030-published-figures.md keeps its figures",
    "lab faults --thrusters": "decision 35 keeps its figures; tests/faults let each motor fail",
    "lab faults --hours": "`holdfast lab bench soak` measures the memory",
    "lab bench process": "`holdfast lab bench soak` measures memory and lateness",
    "lab bench zenoh": "decision 38 keeps its figures; tests/live tries bad subscribers",
    "lab bench fleet": "decision 38 keeps its figures; docs/telemetry.md describes several vehicles",
    "lab bench dashboard": "`holdfast lab bench soak` runs the dashboard; decision 38 keeps the figures",
    "demo --dvl": "`holdfast lab bench position` runs places and paths with a DVL",
}
"""What was deleted, and what a user is told instead."""


def _gone(command: str, argv: list[str]) -> bool:
    """Say it if `argv` asks for what is in GONE."""
    for word in argv:
        asked = f"{command} {word.partition('=')[0]}"
        if asked in GONE:
            sys.stderr.write(f"holdfast {asked} was removed: {GONE[asked]}\n")
            return True
    return False


def demo(argv: list[str]) -> int:
    """Dive a minute: what the pilot has today, beside Holdfast."""
    if _gone("demo", argv):
        return 2
    from lab.demo.demo import main

    return main(argv)


def bench(argv: list[str]) -> int:
    """Measure control errors over many vehicles and seas."""
    if _gone("lab bench", argv[:1]):
        return 2
    what, rest = (argv[0], argv[1:]) if argv and not argv[0].startswith("-") else ("dives", argv)
    if what not in BENCHES:
        sys.stderr.write(f"holdfast lab bench: there is no bench '{what}'. Known: {', '.join(BENCHES)}\n")
        return 2
    from lab.study import load, start

    return start(load(BENCHES[what]), rest, BENCH_EXAMPLES)


def schema(argv: list[str]) -> int:
    """Print every telemetry key, field, unit and command; --write updates docs/."""
    parser = command_parser(
        "lab schema",
        "Prints the generated part of docs/telemetry.md: all keys, schemas and commands.",
        "examples:\n"
        "  holdfast lab schema            print all keys, fields, units and commands\n"
        "  holdfast lab schema --write    update the documents after a change of schemas or configuration\n"
        "  holdfast lab schema --json DIR write the JSON Schemas of all these and of the configuration\n",
    )
    parser.add_argument("--write", action="store_true", help="update the generated pages of docs/")
    parser.add_argument("--json", type=Path, metavar="DIR", help="write JSON Schemas there")
    arguments = parser.parse_args(argv)
    from lab.documents import pages, schemas, write

    if arguments.json:
        arguments.json.mkdir(parents=True, exist_ok=True)
        for name, content in schemas().items():
            (arguments.json / name).write_bytes(content)
        return 0
    if not arguments.write:
        sys.stdout.write(pages()["telemetry.md"])
        return 0
    try:
        changed = write()
    except FileNotFoundError as error:
        sys.stderr.write(f"holdfast lab schema: {error.filename} is not there; --write needs a checkout\n")
        return 2
    sys.stdout.write("".join(f"{path}\n" for path in changed) or "nothing was stale\n")
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
    from lab.studies.tune import Tune
    from lab.study import start

    return start(Tune, argv, TUNE_EXAMPLES)


def campaign(argv: list[str]) -> int:
    """Simulate thousands of dives with new vehicles, links and seas."""
    from lab.studies.campaign import Campaign
    from lab.study import start

    return start(Campaign, argv, CAMPAIGN_EXAMPLES)


def faults(argv: list[str]) -> int:
    """Inject faults into thousands of simulated dives, and check every tick."""
    if _gone("lab faults", argv):
        return 2
    from lab.studies.fault_dives import FaultDives
    from lab.study import start

    return start(FaultDives, argv, FAULTS_EXAMPLES)


def identify(argv: list[str]) -> int:
    """Measure a vehicle by moving it, or from logs, and write its file."""
    if any(argument.partition("=")[0] in ("--from", "--test") for argument in argv):
        from lab.identify.command import main

        return main(argv)
    from companion.commands import identify as move
    from lab.identify.outcome import conclude

    return move(argv, lambda table, *others: conclude([table], *others))


def rerun(argv: list[str]) -> int:
    """Run a recorded dive through the present code and compare its commands."""
    from lab.rerun.command import main

    return main(argv)


def report(argv: list[str]) -> int:
    """Write a report of a recorded dive: warnings, control errors and events."""
    from lab.report.report import main

    return main(argv)
