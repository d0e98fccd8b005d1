"""The uplink that tests/unit/test_uplink.py replays gets the same answers from the real firmware of today."""

from pathlib import Path

import pytest
from sim_wire import vehicle
from test_parity import PLANT
from tools.uplink import LOGS, replay

from lab.loop.firmware import Firmware
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import load_config


@pytest.mark.parametrize("log", LOGS)
def test_the_firmware_answers_as_our_stand_in(log: str, ardusub: Path) -> None:
    with Firmware(ardusub, load_config(DEFAULT_CONFIG, PLANT), seed=1, surveyed=False) as firmware:
        theirs = replay(firmware, log)
    ours = replay(vehicle(), log)
    for answers in (theirs, ours):
        answers["answered"].pop("PARAM_SET RNGFND1_MAX_CM", None)  # 4.5 has it, 4.7 measures in m
    assert ours["answered"] == theirs["answered"]
    rates = {kind: rate for kind, rate in theirs["rates_hz"].items() if kind != "STATUSTEXT"}
    assert {kind: ours["rates_hz"].get(kind, 0.0) for kind in rates} == pytest.approx(
        rates, rel=0.06, abs=0.1
    )
