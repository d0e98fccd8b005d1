"""Within the ranges any configuration, and any live tuning, stays finite and inside the envelope."""

import json
import math
from typing import get_type_hints

import numpy as np
from hypothesis import HealthCheck, Phase, event, example, given, settings
from hypothesis import strategies as st
from virtual import DEPTH_M, Dive, hold

from companion.config import Config, ConfigError, load_config
from companion.io.command_queue import CommandQueue, ReceivedCommand
from companion.records import Condition
from companion.telemetry.commands import COMMANDS
from holdfast import validation

SECTIONS = ("loop", "delays", "thrusters", "levelling", "surge", "heave", "yaw", "network", "supervisor")
LASTS_S = 6
COMPENSATORS = ("none", "integrator", "regressor", "network", "observer", "network+observer")


def numbers(kind):
    """Return each key of a section or a command with its range."""
    hints = get_type_hints(kind, include_extras=True)
    found = ((key, validation.bounds(hint)) for key, hint in hints.items())
    return {key: ends for key, ends in found if ends}


def within(least, most):
    """Return any number of a range: its ends, evenly, or evenly by its logarithm."""
    if least < 0.0:
        return st.floats(least, most)
    low = max(least, 1e-6 * most)
    by_size = st.floats(math.log(low), math.log(most)).map(lambda x: min(max(math.exp(x), least), most))
    return st.sampled_from((least, most)) | st.floats(least, most) | by_size


def settable():
    """Return any `section.key=value` that the table allows, as `--set` takes it."""
    one = []
    for section in SECTIONS:
        kind = get_type_hints(Config)[section]
        for key, (least, most) in numbers(kind).items():
            if key == "rate_hz":
                one.append(st.sampled_from((10, 20, 50, 100)).map("loop.rate_hz={}".format))
                continue
            whole = get_type_hints(kind)[key] is int
            values = st.integers(least, min(most, 2**31)) if whole else within(least, most)
            one.append(values.map(f"{section}.{key}={{!r}}".format))
        if "compensator" in kind.__struct_fields__:
            one.append(st.sampled_from(COMPENSATORS).map(f"{section}.compensator={{!r}}".format))
    return st.one_of(one)


def retunes():
    """Return any tuning command whose values are inside the ranges."""
    axis = st.sampled_from(("surge", "heave", "heave", "yaw"))
    compensator = st.fixed_dictionaries({"axis": axis, "compensator": st.sampled_from(COMPENSATORS)})
    kinds = [st.tuples(st.just("compensator"), compensator)]
    for name in ("gains", "estimator"):
        wanted = {key: within(*ends) for key, ends in numbers(COMMANDS[name]).items()}
        what = st.fixed_dictionaries({"axis": axis, "confirm": st.booleans()}, optional=wanted)
        kinds.append(st.tuples(st.just(name), what))
    return st.one_of(kinds)


@settings(
    max_examples=settings().max_examples // 5,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),  # to shrink a dive takes minutes
    suppress_health_check=list(HealthCheck),
)
@given(st.lists(settable(), max_size=8), st.lists(retunes(), max_size=5), st.booleans())
@example(["supervisor.max_depth_m=0.5"], [], False).via("no deeper than the default setpoint")
def test_what_the_ranges_allow_stays_finite_and_inside_the_envelope(overrides, asked, positioned):
    """The dive itself holds every tick's command to its envelope; see virtual.Tap."""
    plant = ("waves.enabled=true", f"sensors.dvl={str(positioned).lower()}")
    try:
        limits = load_config(overrides=overrides).supervisor
        setpoint = hold(min(DEPTH_M, limits.max_depth_m))
        dive = Dive(*plant, companion=overrides, setpoint=setpoint)
    except ConfigError as refused:
        event(str(refused).partition(":")[2][:20])
        return
    queue = CommandQueue(dive.engine.config)
    for i in range(LASTS_S):
        for step in dive.loop.run(1.0):
            sample = step.sample
            assert Condition.NON_FINITE not in sample.verdict.conditions
            assert np.isfinite(sample.dofs.tau).all()
        if i < len(asked):
            name, what = asked[i]
            queue.put(ReceivedCommand(name, json.dumps(what).encode(), lambda _: None, True))
            while queue.prepare(dive.engine):
                pass
            queue.before_tick(dive.engine, dive.t_s)
    event(f"ended {sample.verdict.state}")
