"""Samples that never came are counted by the ticks' numbers, for the recorder's status."""

from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

from companion.records import ControlSample
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry
from dashboard.recording.recorder import DiveRecorder, FileLimits, Losses

MakeSample = Callable[..., ControlSample]
KEYS = len(telemetry.EVERY_TICK)
REPORTED = [
    pytest.param([1, 2, 3, 4], {}, 0, id="all"),
    pytest.param([900, 901, 1, 2, 3], {}, 0, id="a companion that starts anew"),
    pytest.param([1, 2, 5], {}, 2 * KEYS, id="two whole ticks"),
    pytest.param([1, 2, 3], {2: {"dof/x", "dof/psi"}}, 2, id="two keys"),
    pytest.param([1, 2, 3], {2: {"loop"}}, 1, id="the last key"),
    pytest.param([1, 2, 3], {1: {"state", "command"}}, 0, id="what left before we were there"),
]


def test_what_a_radio_link_leaves_out_is_not_lost() -> None:
    losses = Losses(10)
    for tick in (10, 20, 31, 41, 61, 71):  # a tick came late; one was lost
        for tail in telemetry.EVERY_TICK:
            losses.take(tail, tick if tail == "loop" else 0)
    assert losses.lost == KEYS


@pytest.mark.parametrize(("ticks", "missing", "lost"), REPORTED)
def test_they_are_reported(
    ticks: list[int], missing: dict[int, set[str]], lost: int, tmp_path: Path, make_sample: MakeSample
) -> None:
    recorder = DiveRecorder("kelp", FileLimits(tmp_path, reserve_bytes=1), {})
    recorder.start(0)
    for tick in ticks:
        sample = make_sample()
        sample = replace(sample, loop=replace(sample.loop, tick=tick))
        for key, encoding, payload in samples.encode(sample, "kelp"):
            if key.split("/", 2)[2] not in missing.get(tick, set()):
                recorder.take(key, encoding, payload, 0, 0.0)
    assert recorder.status(0.0, 0).lost == lost
    recorder.stop()
