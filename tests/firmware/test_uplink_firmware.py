"""The uplink that tests/unit/test_uplink.py replays gets the same answers from the real firmware of today."""

from pathlib import Path

import pytest
from sim_wire import vehicle
from test_parity import PLANT
from tools.uplink import LOGS, replay

from lab.loop.firmware import Firmware
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config


@pytest.mark.parametrize("log", LOGS)
def test_the_firmware_answers_as_our_stand_in(log: str, ardusub: Path) -> None:
    with Firmware(ardusub, load_config(DEFAULT_CONFIG, PLANT), seed=1) as firmware:
        theirs = replay(firmware, log)
    ours = replay(vehicle(), log)
    assert ours["answered"] == theirs["answered"]
    hidden = set(ours["parameters"]) - set(theirs["parameters"])
    beyond = set(theirs["parameters"]) - set(ours["parameters"])
    assert {name for name in beyond if not name.startswith("NET_")} <= {"SCR_ENABLE"}
    assert all("GPS" in name for name in hidden)
    rates = {kind: rate for kind, rate in theirs["rates_hz"].items() if kind != "STATUSTEXT"}
    assert {kind: ours["rates_hz"].get(kind, 0.0) for kind in rates} == pytest.approx(
        rates, rel=0.06, abs=0.1
    )
