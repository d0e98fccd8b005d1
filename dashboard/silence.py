"""What to say where nothing is heard of a vehicle: what was so last, what may be so now, and what to do."""

_STEERING = ("ACTIVE", "RAMP_DOWN", "HAND_OVER")


def silence(
    vehicle: str, endpoint: str, *, connected: bool, state: str = "", armed: bool | None = None
) -> tuple[str, str]:
    """Return the reason and the operator's next step; `state` and `armed` are the last that were heard."""
    if not vehicle:
        if connected:
            return "No vehicle is heard.", "Zenoh answers, but no companion publishes: start `holdfast run`."
        return f"Nobody listens on {endpoint}.", "Start `holdfast run`, or name the endpoint by --connect."
    if state in _STEERING:
        was = f"{state.replace('_', ' ')}{' and armed' if armed else ''}"
        return (
            f"No news from {vehicle}. It was {was}.",
            "If its companion has died, the autopilot disarms 3 s after the last frame (FS_PILOT_TIMEOUT). "
            "Take over with the joystick or the ground station; then look at `holdfast run` and the network.",
        )
    return (
        f"No news from {vehicle}: what you see is the past. Holdfast did not steer.",
        "Look at its companion, `holdfast run`, and the network.",
    )
