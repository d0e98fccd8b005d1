"""Bad configuration is refused by name, key, value and range; the shipped files are good."""

import pytest
from sim_wire import CONFIG, is_finite

from sim_bridge.sim_config import ConfigError, load_config
from sim_bridge.vehicle import Vehicle

SHIPPED = sorted(CONFIG.parent.glob("sim*.toml"))


@pytest.mark.parametrize("file", SHIPPED, ids=[file.stem for file in SHIPPED])
def test_shipped_dives_run_and_stay_in_their_water(file):
    config = load_config(file)
    rov = Vehicle(config, 1)
    for _ in range(2000):
        rov.step()
    assert is_finite(rov)
    assert rov.truth().eta[2] < config.seabed.depth_m
    assert file.read_text(encoding="utf-8").startswith("# ")


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("hull.colour='blue'", ["hull.colour", "unknown"]),
        ("waves.height_m=9.0", ["waves.height_m = 9", "must be 0 to 5"]),
        ("current.profile=[[5, 1.0], [2, 0.5]]", ["current", "profile", "rise"]),
        ("thrusters.frame='octopus'", ["thrusters.frame", "octopus"]),
        ("thrusters.gain=[1.0, 1.0]", ["thrusters", "1 or 8"]),
        ("faults=[{kind='gremlin'}]", ["faults[0]", "gremlin", "link_cut"]),
        ("faults=[{kind='message_nan', message='ATTITUD'}]", ["faults[0]", "ATTITUD", "no message"]),
        ("faults=[{kind='link_lossy', value=3}]", ["faults[0]", "0..1"]),
    ],
)
def test_errors_name_override_key_value_and_range(override, words):
    with pytest.raises(ConfigError) as caught:
        load_config(CONFIG, [override])
    for word in words:
        assert word in str(caught.value)
    assert str(caught.value).startswith(f"--set {override}: ")


def test_an_empty_file_is_a_heavy_in_still_water(tmp_path):
    (tmp_path / "empty.toml").write_text("")
    config, shipped = load_config(tmp_path / "empty.toml"), load_config(CONFIG)
    assert (config.hull, config.thrusters) == (shipped.hull, shipped.thrusters)
    assert not config.current.enabled
