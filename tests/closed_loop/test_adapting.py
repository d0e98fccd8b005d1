"""A vehicle far weaker and later than the nominal one is held better with what was found of it."""

from companion.config import load_config
from lab.studies import corners
from lab.studies.corners import Cell, dive
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant

BASE = load_plant(DEFAULT_CONFIG)
WEAK = Cell(1 / 3, 0.3, 0, 0, "waves")


def depth_mm(adapts: str, cell: Cell) -> float:
    outcome = dive(cell, load_config(overrides=[f"vehicle.adapts={adapts}"]), BASE, 1, duration_s=45.0)
    assert not outcome["gave_up"]
    depth_mm: float = outcome["depth_rms_mm"]
    return depth_mm


def test_a_weak_and_late_vehicle_is_held_better(monkeypatch) -> None:
    monkeypatch.setattr(corners, "SETTLED_S", 25.0)
    without, adapted = (depth_mm(adapts, WEAK) for adapts in ("false", "true"))
    assert adapted < 0.7 * without
