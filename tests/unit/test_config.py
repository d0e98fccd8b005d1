import math
from pathlib import Path
from typing import get_type_hints

import msgspec
import numpy as np
import pytest

from companion.assembly import observers, refuse_fast_gains
from companion.config import (
    DEFAULT_FILE,
    PRESETS,
    Config,
    ConfigError,
    load_config,
    load_vehicle,
    presets,
    vehicle_of,
    vehicle_text,
)
from holdfast import validation


@pytest.fixture
def edited(tmp_path):
    """Return a function that copies a shipped file with one piece replaced."""

    def edit(old="", new="", shipped=DEFAULT_FILE):
        text = shipped.read_text(encoding="utf-8")
        assert old in text
        path = tmp_path / "mine.toml"
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return path

    return edit


def refusal(path=DEFAULT_FILE, overrides=()):
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides)
    return str(caught.value)


def test_the_shipped_file_says_what_the_defaults_are():
    config = load_config()
    assert config == Config()
    assert config.axes == (config.surge, config.sway, config.heave, config.yaw)
    assert config.heave.compensator == "predictor"


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("surge.mass=0.01", ["surge.mass = 0.01", "1 to 1000", "divide masses, inertias and damping"]),
        ("yaw.leak_per_s=-0.1", ["yaw.leak_per_s", "-0.1", "0, or 1e-06 to 1"]),
        ("loop.rate_hz='fast'", ["loop.rate_hz", "fast", "float"]),
        ("network.units=true", ["network.units", "True", "int"]),
        ("vehicle.frame=octo", ["vehicle.frame", "octo"]),
        ("vehicle.name='a/b'", ["vehicle.name", "a/b"]),
        ("heave.compensator=magic", ["heave.compensator", "magic"]),
        ("heave.law=none", ["heave.law = 'none'", "must be one of"]),
        ("telemetry.allow_control=yes", ["telemetry.allow_control", "yes", "local", "always", "never"]),
        ("fence.depth_m=[5.0, 1.0]", ["fence.depth_m = [5, 1]", "the first must be less"]),
        ("heave=5", ["heave", "5"]),
        ("heave.kapa_per_s=8", ["heave", "kapa_per_s", "unknown"]),
        ("heave.compensator='network+observer'", ["heave.compensator", "the network beside it is predictor"]),
        ("pitch.mass=8", ["pitch", "unknown"]),
        ('link.allow=["192.168.2.1/24"]', ["link.allow", "192.168.2.1/24", "host bits"]),
        ('ground_station.allow=["topside"]', ["ground_station.allow", "topside", "192.168.2.0/24"]),
        ("link.allow=192.168.2.1", ["link.allow", "192.168.2.1", "array"]),
        ("heave.mass.x=1", ["heave.mass.x"]),
        ("heave.mass", ["section.key=value"]),
        ("", ["section.key=value"]),
    ],
)
def test_a_bad_value_is_refused_by_name_value_and_range(override, said):
    message = refusal(overrides=[override])
    assert message.startswith((f"--set {override}: ", f"{DEFAULT_FILE}: "))
    assert all(part in message for part in said), message


def test_one_button_cannot_engage_and_release():
    buttons = ["ground_station.engage_button=3", "ground_station.release_button=3"]
    assert "ground_station.engage_button = 3" in refusal(overrides=buttons)


NUMBERS = [
    (f"{section}.{key}", value)
    for section, table in msgspec.to_builtins(load_config()).items()
    for key, value in table.items()
    if type(value) in (int, float)
]


@pytest.mark.parametrize(("key", "shipped"), NUMBERS)
def test_every_number_has_a_range_whose_ends_are_the_last_that_are_taken(key, shipped):
    section, name = key.split(".")
    table = get_type_hints(type(getattr(load_config(), section)), include_extras=True)
    found = validation.bounds(table[name])
    assert found is not None
    least, most = found
    assert least <= shipped <= most
    beside_zero = validation.least_beside_zero(table[name])
    for end in (least, beside_zero or least, most):
        load_config(overrides=[f"{key}={end!r}"])
    beyond = (
        (least - 1, most + 1) if type(shipped) is int else (np.nextafter(least, -9), np.nextafter(most, 1e9))
    )
    nearly_zero = (5e-324, np.nextafter(beside_zero, 0)) if beside_zero else ()
    numbers = map(float if type(shipped) is float else int, (*beyond, *nearly_zero))
    for value in (*numbers, math.nan, math.inf):
        message = refusal(overrides=[f"{key}={value!r}"])
        assert message.startswith(f"--set {key}={value!r}: {key} = ")
        allowed = f"0, or {beside_zero:g}" if beside_zero else f"{least:g}"
        assert f"must be {allowed} to {most:g}" in message or "int" in message


@pytest.mark.parametrize(
    ("override", "section", "key", "value"),
    [
        ("heave.kappa_per_s=8", "heave", "kappa_per_s", 8.0),
        ("heave.compensator=none", "heave", "compensator", "none"),
        ("link.endpoint=tcp:127.0.0.1:5760", "link", "endpoint", "tcp:127.0.0.1:5760"),
        (" network.seed = 7", "network", "seed", 7),
        ('link.allow=["192.168.2.0/24", "::1"]', "link", "allow", ("192.168.2.0/24", "::1")),
    ],
)
def test_an_override_wins_over_the_file(override, section, key, value):
    config = load_config(overrides=[override])
    got = getattr(getattr(config, section), key)
    assert got == value
    assert type(got) is type(value)


HEAVY = PRESETS / "heavy.toml"


class TestPresets:
    @pytest.mark.parametrize("name", presets())
    def test_each_is_loaded_by_name_and_leaves_what_is_not_the_vehicle(self, name):
        config = load_config(overrides=[f"vehicle.preset={name}"])
        assert vehicle_of(config) == load_vehicle(PRESETS / f"{name}.toml")
        heavy = vehicle_of(load_config())
        settings = [
            f"{section}.{key}={value}"
            for section, keys in msgspec.to_builtins(heavy).items()
            for key, value in keys.items()
        ]
        assert load_config(overrides=[f"vehicle.preset={name}", *settings]) == load_config()

    @pytest.mark.parametrize("name", presets())
    def test_each_has_gains_that_its_lag_and_mass_bear(self, name):
        refuse_fast_gains(load_config(overrides=[f"vehicle.preset={name}"]))

    def test_the_loop_leads_the_lag_and_not_the_start_of_its_motors(self):
        """Where motors run there is no start: a loop that led it by 0.16 s oscillated at full thrust."""
        config = load_config(overrides=["thrusters.lag_s=0.05", "thrusters.start_s=0.16"])
        assert observers(config).lag_s == pytest.approx(0.05)
        assert config.thrusters.from_rest_s == pytest.approx(0.21)

    def test_the_template_is_the_default_vehicle(self):
        assert load_vehicle(PRESETS / "custom.toml") == load_vehicle(HEAVY) == vehicle_of(Config())

    def test_a_vehicle_s_file_says_what_differs(self, tmp_path):
        path = tmp_path / "mine.toml"
        path.write_text('[vehicle]\nframe = "vectored"\n[heave]\nmass = 31.5\n', encoding="utf-8")
        config = load_config(overrides=[f'vehicle.preset="{path}"'])
        assert config == load_config(overrides=["vehicle.frame=vectored", "heave.mass=31.5"])

    def test_a_path_is_taken_from_where_it_stands(self, edited, monkeypatch, tmp_path):
        path = edited("mass = 28.5 ", "mass = 31.5 ", HEAVY)
        monkeypatch.chdir(tmp_path)
        assert load_config(overrides=["vehicle.preset=mine.toml"]).heave.mass == 31.5
        assert load_config(overrides=[f'vehicle.preset="{path}"']).heave.mass == 31.5
        monkeypatch.chdir(Path("/"))
        path.rename(path.with_name("other.toml"))
        assert load_config(edited('"heavy" ', '"other.toml" ')).heave.mass == 31.5

    def test_a_file_that_holds_its_vehicle_too_is_taken_as_it_is(self, complete_config):
        assert load_config(complete_config) == load_config()

    def test_one_key_in_both_files_is_refused(self, complete_config):
        message = refusal(complete_config, ["vehicle.preset=heavy"])
        assert str(complete_config) in message
        assert "vehicle.frame = 'vectored_6dof'" in message
        assert str(HEAVY) in message

    @pytest.mark.parametrize(
        ("old", "new", "said"),
        [
            ("mass = 28.5 ", "mass = 0.0 ", ["heave.mass = 0:", "1 to 1000"]),
            ("lag_s = 0.15 ", "lag_s = 5.0 ", ["thrusters.lag_s = 5:", "0.02 to 1"]),
            ('frame = "vectored_6dof"', 'frame = "octo"', ["vehicle.frame", "octo", "vectored_6dof"]),
            ("max_force = 12.0", "max_force = 12.0\nkappa_per_s = 4.0", ["yaw.kappa_per_s: unknown key"]),
            ("[surge]", "[surge", ["TOML"]),
        ],
    )
    def test_a_bad_vehicle_is_refused_by_file_key_value_and_range(self, edited, old, new, said):
        path = edited(old, new, HEAVY)
        message = refusal(overrides=[f'vehicle.preset="{path}"'])
        assert message.startswith(f"{path}: ")
        assert all(part in message for part in said), message

    @pytest.mark.parametrize("value", ["nonesuch", "7", '""', '["heavy"]'])
    def test_a_name_that_there_is_not_lists_those_that_there_are(self, value):
        message = refusal(overrides=[f"vehicle.preset={value}"])
        assert "vehicle.preset" in message
        assert "bluerov2" in message

    @pytest.mark.parametrize("name", presets())
    def test_what_is_written_is_read_again(self, name, tmp_path):
        vehicle = load_vehicle(PRESETS / f"{name}.toml")
        text = vehicle_text(vehicle, ["A vehicle"], {"heave.mass": "sd 0.5"})
        assert text.startswith("# A vehicle\n\n[vehicle]\n")
        assert text.count("# sd 0.5") == 1
        (tmp_path / "written.toml").write_text(text, encoding="utf-8")
        assert load_vehicle(tmp_path / "written.toml") == vehicle


def test_a_misspelt_preset_is_told_how_it_is_spelt():
    with pytest.raises(ConfigError, match=r"vehicle\.presett: unknown key; known here: preset, "):
        load_config(overrides=["vehicle.presett=heavy"])
