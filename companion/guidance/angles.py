"""The angles of roll and pitch: level, until an operator, a path or a stick asks for others."""

import math

from companion.config import Config
from companion.core.attitude import LIMITS, most_rad
from companion.core.bounds import limited
from companion.guidance.pilot import beyond
from companion.records import LEVEL, Angles, AxisCommand

NAMES = ("roll_deg", "pitch_deg")


class HeldAngles:
    """The only owner of the wanted angles."""

    def __init__(self, config: Config) -> None:
        self.asked = LEVEL
        self._dead_zone = config.supervisor.pilot_deflection
        self._refusal = _refusal(config)
        levelling = config.levelling
        self._most_rad = tuple(
            most_rad(righting_nm, levelling.max_moment_nm)
            for righting_nm in (levelling.roll_righting_nm, levelling.pitch_righting_nm)
        )

    def permit(self, angles: Angles) -> None:
        """Raise ValueError for angles, NaN where nothing is said, that this vehicle cannot hold."""
        for name, angle, most in zip(NAMES, angles, self._most_rad, strict=True):
            if math.isnan(angle) or angle == 0.0:
                continue
            if self._refusal:
                raise ValueError(f"{name}: {self._refusal}")
            if abs(angle) > most + 1e-9:
                raise ValueError(
                    f"{name} = {math.degrees(angle):.0f}: this vehicle holds up to {math.degrees(most):.0f}°"
                )

    def ask(self, angles: Angles) -> None:
        """Hold these; NaN stays as it is. Raises ValueError as `permit` does."""
        self.permit(angles)
        self.asked = Angles(
            *(old if math.isnan(new) else new for old, new in zip(self.asked, angles, strict=True))
        )

    def aim(self, angles: Angles) -> None:
        """Hold these, as far as the vehicle can; NaN stays as it is."""
        if not self._refusal:
            roll, pitch = (limited(a, most) for a, most in zip(angles, self._most_rad, strict=True))
            self.ask(Angles(roll, pitch))

    def turn(self, sticks: AxisCommand, dt_s: float) -> None:
        """Move the angles by the pilot's roll and pitch sticks, as far as the vehicle can hold them."""
        if self._refusal:
            return
        self.asked = Angles(
            *(
                limited(angle + dt_s * LIMITS.max_rate * beyond(stick, self._dead_zone), most)
                for angle, stick, most in zip(
                    self.asked, (sticks.roll, sticks.pitch), self._most_rad, strict=True
                )
            )
        )


def _refusal(config: Config) -> str:
    """Return why no angle can be held; empty where it can."""
    if not config.levels:
        return "the firmware keeps roll and pitch; needs vehicle.steering_mode = 'manual' and levelling"
    if config.vehicle.frame != "vectored_6dof":
        return f"the frame {config.vehicle.frame} cannot pitch by itself; needs vectored_6dof (a Heavy)"
    return ""
