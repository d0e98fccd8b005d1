"""Puts the packages inside `holdfast` in a wheel, so that site-packages gets no `lab` or `config`.

A checkout keeps them side by side: an editable installation is the checkout itself.
"""

from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

INSIDE = ("companion", "sim_bridge", "lab", "dashboard", "config", "systemd")


class Layout(BuildHookInterface):  # type: ignore[type-arg]  # generic in its stubs, not at run time
    """Hatchling calls it before each build of a wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Say which folder goes where."""
        if version != "editable":
            build_data["force_include"] |= {name: f"holdfast/{name}" for name in INSIDE}
