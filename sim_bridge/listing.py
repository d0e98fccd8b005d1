"""What `holdfast sim --list` prints: the shipped dives and the kinds of faults, a line each."""

from collections.abc import Mapping
from math import isfinite
from pathlib import Path

from sim_bridge.fault_kinds import FAULT_KINDS, FaultKind


def listing(shipped: Mapping[str, Path]) -> str:
    """Return the list; each file is described by the comment in its first line."""
    files = [(name, _first_comment(path)) for name, path in shipped.items()]
    kinds = [(name, _described(kind)) for name, kind in FAULT_KINDS.items()]
    return (
        f"Vehicles and dives, for --vehicle NAME:\n{_table(files)}\n"
        f"Faults, for `--fault` and `holdfast fault` KIND,at_s=S,duration_s=S,value=X:\n{_table(kinds)}"
    )


def _first_comment(path: Path) -> str:
    return path.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")


def _described(kind: FaultKind) -> str:
    if not kind.value:
        return kind.effect
    within = f", {kind.low:g}..{kind.high:g}" if isfinite(kind.low + kind.high) else ""
    return f"{kind.effect} (value: {kind.value}{within})"


def _table(rows: list[tuple[str, str]]) -> str:
    width = max(len(name) for name, _ in rows)
    return "".join(f"  {name:{width}}  {text}\n" for name, text in rows)
