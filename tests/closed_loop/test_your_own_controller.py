"""docs/your-own-controller.md, followed literally: its files are copied, its commands are run."""

import os
import re
import shutil
import subprocess
import sys
import tomllib

import pytest
from virtual import ROOT, hold

from companion import registry
from companion.config import DEFAULT_FILE, ConfigError, load_config
from companion.engine import Engine

PAGE = (ROOT / "docs" / "your-own-controller.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", PAGE, re.DOTALL)
SHELL, TOML = ([text for kind, text in BLOCKS if kind == wanted] for wanted in ("sh", "toml"))
FILES = re.findall(r"\(examples/(\w+\.py)\)", PAGE)


@pytest.fixture
def folder(tmp_path):
    """An empty folder with the page's files in it."""
    for name in FILES:
        shutil.copy(ROOT / "docs" / "examples" / name, tmp_path)
    return tmp_path


@pytest.fixture
def plugins(folder, monkeypatch):
    """The folder on the path of this process; what it adds is forgotten again."""
    monkeypatch.syspath_prepend(folder)
    yield folder
    for name in FILES:
        sys.modules.pop(name.removesuffix(".py"), None)


def run(script, folder):
    """Run a shell script where `holdfast` is this checkout's."""
    shim = f'holdfast() {{ "{sys.executable}" -m holdfast "$@"; }}\n'
    environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "120", "MPLBACKEND": "Agg"}
    return subprocess.run(
        ["bash", "-c", shim + script],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
    )


SHORT = """
from dataclasses import replace
from lab.loop import scenarios
from lab.studies import gain_search as search
whole, searched = scenarios.four, search.search
search.COUNTS_S = search.TRAINING_S = 2.0
def short(*arguments):
    return tuple(replace(one, duration_s=scenarios.SETTLE_S + 1.0) for one in whole(*arguments))
def depth_alone(stage, *arguments, **named):
    if stage.place:
        return search.SearchResult(dict(stage.knobs), 1.0, 1.0, 11)
    from lab.batch import simulate
    simulate.cached = lambda dive, keeps: dive
    return searched(stage, *arguments, **named)
scenarios.four = short
search.search = depth_alone
"""
"""Every process of the commands runs this first: what they say does not depend on how long they dive.

A search compiles the dive for each compensator, a minute each: here it dives in plain Python. test_bench.py
has one that is compiled, of the place too, and test_compiled.py compiles the compensator.
"""


def test_the_commands_of_the_page_give_what_it_says(folder):
    (folder / "sitecustomize.py").write_text(SHORT, encoding="utf-8")
    path, load, *dives = (SHELL[0].splitlines()[0], SHELL[0].splitlines()[1], *SHELL[1:])
    answer = run(f"{path}\n{load}", folder)
    assert answer.returncode == 2
    assert "no such row: nonesuch" in answer.stderr
    assert "drag, drag+observer" in answer.stderr
    for script in dives:
        answer = run(f"{path}\n{script}", folder)
        assert answer.returncode == 0, answer.stderr
        assert "sitecustomize" not in answer.stderr
        (rows,) = re.findall(r"(?:--rows|tune) ((?:[a-z]\w* )+)--", script)
        for row in rows.split():
            assert {"default": "Holdfast"}.get(row, row) in answer.stdout  # by its title
        assert "lost" not in answer.stdout


def test_the_configuration_of_the_page_is_one(plugins, tmp_path):
    axis, chosen = (tomllib.loads(part) for part in TOML[0].split("\n\n"))
    assert axis == {"heave": {"compensator": "drag+observer"}}
    text = DEFAULT_FILE.read_text(encoding="utf-8") + TOML[0].split("\n\n")[1]
    mine = tmp_path / "mine.toml"
    mine.write_text(text, encoding="utf-8")
    config = load_config(mine, ['heave.compensator="drag+observer"'])
    assert config.compensators == chosen["compensators"]
    assert "drag+observer" in registry.choices(config.compensators)


def test_an_entry_point_makes_the_name_known_without_a_table(folder):
    """As of an installed package."""
    ((group, points),) = tomllib.loads(TOML[1])["project"]["entry-points"].items()
    metadata = folder / "drag-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: drag\nVersion: 1.0\n", encoding="utf-8")
    lines = [f"{name} = {value}\n" for name, value in points.items()]
    (metadata / "entry_points.txt").write_text(f"[{group}]\n{''.join(lines)}", encoding="utf-8")
    known = "export PYTHONPATH=$PWD:$PYTHONPATH\nholdfast config show --set heave.compensator="
    answer = run(known + "drag", folder)
    assert answer.returncode == 0, answer.stderr
    assert re.search(r'heave.compensator +"drag"', answer.stdout)
    answer = run(known + "dragg", folder)
    assert answer.returncode == 2
    assert re.search(r"must be one of none, observer, .*drag", answer.stderr)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (
            ["heave.compensator=drag"],
            "heave.compensator = 'drag': must be one of none, observer, predictor, integrator",
        ),
        (["heave.compensator=network+network"], "must be one of none, observer, predictor, integrator"),
        (["heave.law=pd"], "heave.law = 'pd': must be one of lyapunov"),
        (["compensators.drag.module=nonesuch"], "compensators.drag.module = 'nonesuch': cannot be imported"),
        (["compensators.drag.module=math"], "math has no Parameters, State, initial"),
        (["compensators.drag.drag_share=2.0"], "compensators.drag: not installed; name its file"),
        (["compensators.drag.module=drag", "compensators.drag.drag=2.0"], "drag.drag: unknown key; known"),
        (
            ["compensators.drag.module=drag", "heave.compensator=drag", "compensators.drag.drag_share=much"],
            "drag_share = 'much': expected `float`, got `str`",
        ),
    ],
)
def test_what_cannot_be_used_says_why(plugins, overrides, said):
    with pytest.raises(ConfigError, match=re.escape(said)):
        load_config(overrides=overrides)


COMPENSATOR = """
from typing import NamedTuple
class Parameters(NamedTuple):
    dead_zone: float
class State(NamedTuple):
    bias: float
def initial(parameters): return State(0.0)
def step(parameters, state, signals, learn_s, adapt): return state, 0.0, False
def seed(parameters, state, signals, d_hat): return state
def weight_norm(state): return 0.0
def integral_gain(parameters): return 0.0
"""


@pytest.mark.parametrize(
    ("sound", "wrong", "said"),
    [
        ("return state, 0.0, False", "return state, 0.0", "step returns (State(bias=0.0), 0.0): must"),
        ("return state, 0.0, False", "return state, 0.0, None", "must be State, float, bool"),
        ("return state, 0.0, False", "return 0.0, state, False", "must be State, float, bool"),
        ("return state, 0.0, False", "return state.boas, 0.0, False", "AttributeError: 'State' object"),
        ("return State(0.0)", "return 0.0", "initial returns 0.0: must be State"),
        ("d_hat): return state", "d_hat): pass", "seed returns None: must be State"),
        ("(state): return 0.0", "(state): return 'much'", "weight_norm returns 'much': must be float"),
        ("(parameters): return 0.0", "(parameters): pass", "integral_gain returns None: must be float"),
    ],
)
def test_a_function_of_the_wrong_shape_is_named_with_its_file(tmp_path, monkeypatch, sound, wrong, said):
    assert sound in COMPENSATOR
    for name, text in (("sound", COMPENSATOR), ("wrong", COMPENSATOR.replace(sound, wrong))):
        (tmp_path / f"{name}_{tmp_path.name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)

    def built(name):
        overrides = [f"compensators.c.module={name}_{tmp_path.name}", "heave.compensator=c"]
        return Engine(load_config(overrides=overrides), hold())

    built("sound")
    with pytest.raises(ConfigError) as refused:
        built("wrong")
    assert f"{tmp_path}/wrong_{tmp_path.name}.py: " in str(refused.value)
    assert said in str(refused.value)
