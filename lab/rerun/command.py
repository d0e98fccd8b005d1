"""`holdfast lab rerun`: a recorded dive once more through today's engine."""

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from companion.records import AXES
from holdfast.arguments import command_parser, removed_option
from holdfast.gate import bounded
from lab.options import add_settings
from lab.rerun.rerun import Outcome, Tape, configured, load, rerun

EXAMPLES = """\
examples:
  holdfast run --set telemetry.raw=true          together with `holdfast record`: then the dive can be rerun
  holdfast lab rerun dives/kelp-*.mcap               the files of one dive, in any order
  holdfast lab rerun FILE --set heave.kappa_per_s=8  the commands that other gains would have given

Exit status: 0 every byte is the same, 1 some bytes differ, 2 the dive cannot be rerun.
"""


def main(argv: list[str]) -> int:
    """Run the command."""
    parser = command_parser(
        "lab rerun",
        "Runs a recorded dive through the present code: the same datagrams, configuration, requests and "
        "retunes. It compares the bytes that the engine sends with the recorded ones.",
        EXAMPLES,
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="files of one dive, MCAP")
    add_settings(parser)
    removed_option(parser, "--out", "the table says when and by how much the commands differ")
    removed_option(parser, "--config", "--set KEY=VALUE changes a key of the recorded configuration")
    options = parser.parse_args(argv)
    tape, outcome = bounded(again, options.files, options.files, options.set)
    sys.stdout.write("\n".join(lines(tape, outcome, changed=bool(options.set))) + "\n")
    return 1 if outcome.different else 0


def again(files: Sequence[Path], overrides: Sequence[str]) -> tuple[Tape, Outcome]:
    """Read a dive and run it again, its retunes only where nothing else changes the configuration."""
    tape = load(files)
    return tape, rerun(tape, configured(tape, overrides), follow=not overrides)


def lines(tape: Tape, outcome: Outcome, *, changed: bool) -> Iterator[str]:
    """Give what came of it in lines; `changed`: the configuration is not the recorded one."""
    count, different = len(tape.ticks), outcome.different
    asked = sum(len(raw.requests) for raw in tape.ticks)
    aimed = sum(raw.setpoint is not None for raw in tape.ticks)
    retuned = sum(raw.config is not None for raw in tape.ticks)
    dived_s = outcome.t_s[-1] - outcome.t_s[0]
    yield (
        f"{count} ticks, {dived_s:.1f} s of diving, "
        f"at {dived_s / outcome.wall_s:.0f} times real time; "
        f"{asked} requests, {aimed} setpoints and {retuned} retunes by the operator"
    )
    yield from (f"note: {note}" for note in tape.notes)
    if changed and retuned:
        yield f"note: {retuned} retunes of the dive were left out, for the configuration is another"
    if not different:
        yield "every byte sent is the same"
        return
    first = next(raw for raw in tape.ticks if raw.tick == different[0])
    yield (
        f"{len(different)} ticks ({len(different) / count:.1%}) sent other bytes, the first is tick "
        f"{first.tick}, {first.now_s - tape.ticks[0].now_s:.2f} s into it"
    )
    steered = np.isfinite(outcome.was[:, 0]), np.isfinite(outcome.now[:, 0])
    if (only := int(np.sum(steered[0] != steered[1]))) > 0:
        yield f"in {only} ticks only one of the two steered"
    yield f"{'command':8}{'ticks':>8}{'RMS':>10}{'largest':>10}{'at, s':>10}   of full"
    for axis, difference in zip(AXES, (outcome.now - outcome.was).T, strict=True):
        apart = np.abs(np.nan_to_num(difference))
        known = apart[np.isfinite(difference)]
        rms = math.sqrt(float(np.mean(known**2))) if known.size else 0.0
        largest = int(apart.argmax())
        at_s = outcome.t_s[largest] - outcome.t_s[0]
        yield f"{axis:8}{np.count_nonzero(known):8d}{rms:10.2%}{apart[largest]:10.2%}{at_s:10.1f}"
