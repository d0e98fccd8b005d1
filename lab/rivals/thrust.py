"""The thrust that a rival believes to be there: what it asked for, through the thrusters' lag."""

import math


def there(asked: float, thrust: float, lag_s: float, lead_s: float, dt_s: float) -> tuple[float, float]:
    """Return the thrust `dt_s` after `thrust`, and `lead_s` later still, while `asked` is asked for; N."""
    lagging = asked + (thrust - asked) * math.exp(-dt_s / lag_s)
    return lagging, asked + (lagging - asked) * math.exp(-lead_s / lag_s)
