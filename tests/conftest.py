"""What tests of several folders share."""

import gc
import json
import os
import signal
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import msgspec
import pytest
from builders import RESTING
from hypothesis import settings
from msgspec import structs
from virtual import SHARED

from companion.config import load_config
from companion.records import (
    DOFS,
    NEUTRAL,
    Ages,
    Condition,
    ControlSample,
    Current,
    Delays,
    DofSample,
    Ground,
    LinkCounters,
    LoopHealth,
    State,
    Verdict,
)

settings.register_profile("test", derandomize=True, database=None, deadline=None, max_examples=60)
settings.register_profile("quick", settings.get_profile("test"), max_examples=20)  # make quick
settings.register_profile("hunt", derandomize=False, deadline=None, max_examples=3000, print_blob=True)
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a job in the background; so would its children
    signal.signal(signal.SIGINT, signal.default_int_handler)
_states = count()
settings.load_profile("test")  # everybody tries the same examples; make hunt draws new ones


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with those that compile, side by side: what a worker has compiled it does not compile again."""
    items.sort(key=lambda item: item.get_closest_marker("compiles") is None)


def pytest_collection_finish() -> None:
    """Let the garbage collector pass over what stays, and over the samples of a dive less often."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)


@pytest.fixture(autouse=True)
def dives_of_its_own(request: pytest.FixtureRequest) -> Iterator[None]:
    """Give a test that may change what a dive is made of none that others have begun."""
    SHARED.enabled = "monkeypatch" not in request.fixturenames
    yield
    SHARED.enabled = True


@pytest.fixture(autouse=True)
def state_of_its_own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Let no test find what a companion of another one kept; a folder is made where one keeps something."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.getbasetemp() / f"state-{next(_states)}")
    yield
    del os.environ["XDG_STATE_HOME"]


@pytest.fixture
def complete_config(tmp_path: Path) -> Path:
    """The shipped configuration and its vehicle in one file without a preset, as it was before presets."""
    table = msgspec.to_builtins(load_config())
    text = "\n".join(
        f"[{section}]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items())
        for section, keys in table.items()
    )
    path = tmp_path / "complete.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def make_sample() -> Callable[..., ControlSample]:
    """One tick's record; keywords replace fields of its VehicleState."""
    return _make_sample


def _make_sample(**state: Any) -> ControlSample:
    """A sample in which every number of `DofSample` is another, so that a swap cannot hide."""
    numbers = map(float, count(1))
    columns: dict[str, Any] = {name: tuple(next(numbers) for _ in DOFS) for name in DofSample._fields}
    columns["saturated"] = (True, False, False, True)
    columns["adapting"] = (False, True, False, True)
    columns["engaged"] = (True, True, True, False)
    believed = structs.replace(
        RESTING,
        t_s=12.0,
        boot_s=34.0,
        eta=(1.0, 2.0, 5.0, 0.5),
        eta_dot=(0.1, 0.2, 0.3, 0.4),
        ahead_s=0.09,
        roll=0.01,
        pitch=0.02,
        p=0.03,
        q=0.04,
        voltage_v=15.8,
        ages=Ages(0.01, 0.015, 0.02, 0.03, float("inf")),
        delays=Delays(0.05, 0.06, True, False),
        ground=Ground(7.0, 0.0),
        current=Current(0.2, -0.1, 0.05),
    )
    return ControlSample(
        state=structs.replace(believed, **state),
        eta_d=(1.1, 2.1, 5.1, 0.6),
        dofs=DofSample(**columns),
        command=NEUTRAL._replace(heave=0.25),
        requested=(1.0, 2.0, 40.0, 4.0),
        delivered=(1.0, 2.0, 30.0, 4.0),
        verdict=Verdict(State.ACTIVE, Condition.POSITION_STALE | Condition.ENGAGE_ASKED, 0.75, "holding"),
        counters=LinkCounters(1, 2, 3, 4, 5),
        loop=LoopHealth(600, 50.0, 0.08, 180.0, 2, 7),
    )
