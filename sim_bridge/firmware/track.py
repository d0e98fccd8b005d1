"""The straight way to a waypoint as ArduSub's S-curves plan it: jerk in pulses with rounded edges.

Speed rises in two pulses of jerk with `steady_s` of full acceleration between them, is held for `cruise_s`,
and falls as it rose. A pulse is `flat_s` of full jerk between two edges of `edge_s`, half a cosine each.
"""

import math
from typing import NamedTuple


class Track(NamedTuple):
    """A planned way: m, m/s³ and s."""

    length: float
    jerk: float
    edge_s: float
    flat_s: float
    steady_s: float
    cruise_s: float


class Progress(NamedTuple):
    """How far along a track: time since its start (s), way (m), m/s, m/s²."""

    time_s: float = 0.0
    way: float = 0.0
    speed: float = 0.0
    acceleration: float = 0.0


def plan(length: float, speed: float, acceleration: float, jerk: float, snap: float) -> Track:
    """Plan a way of `length` (m) within limits: m/s, m/s², m/s³, m/s⁴."""

    def rising(top: float) -> tuple[Track, float]:
        """Return the rise to a speed, and its way."""
        edge = jerk * math.pi / (2.0 * snap)
        edge = min(
            edge,
            (top * math.pi / (4.0 * snap)) ** (1.0 / 3.0),
            math.sqrt(acceleration * math.pi / 2.0 / snap),
        )
        most = 2.0 * snap * edge / math.pi
        peak = min(acceleration, 0.5 * most * (math.sqrt(edge * edge + 4.0 * top / most) - edge))
        flat = max(0.0, peak / most - edge)
        steady = max(0.0, top / peak - (2.0 * edge + flat))
        return Track(length, most, edge, flat, steady, 0.0), 0.5 * top * (2.0 * (2.0 * edge + flat) + steady)

    track, way = rising(speed)
    if way > 0.5 * length:
        low, high = 0.0, speed
        for _ in range(40):
            speed = 0.5 * (low + high)
            track, way = rising(speed)
            low, high = (speed, high) if way < 0.5 * length else (low, speed)
    return track._replace(cruise_s=max(0.0, length - 2.0 * way) / speed)


def duration_s(track: Track) -> float:
    """Return how long the whole way takes."""
    return 2.0 * _rise_s(track) + track.cruise_s


def advance(track: Track, progress: Progress, dt: float) -> Progress:
    """Return the progress `dt` (s) later."""
    time_s = progress.time_s + dt
    if time_s >= duration_s(track):
        return Progress(time_s, track.length)
    acceleration = progress.acceleration + dt * _jerk(track, progress.time_s + 0.5 * dt)
    speed = max(0.0, progress.speed + 0.5 * dt * (progress.acceleration + acceleration))
    return Progress(time_s, progress.way + 0.5 * dt * (progress.speed + speed), speed, acceleration)


def _rise_s(track: Track) -> float:
    return 2.0 * _pulse_s(track) + track.steady_s


def _pulse_s(track: Track) -> float:
    return 2.0 * track.edge_s + track.flat_s


def _jerk(track: Track, time_s: float) -> float:
    pulse, rise = _pulse_s(track), _rise_s(track)
    falling = rise + track.cruise_s
    since = time_s - falling if time_s >= falling else time_s
    way = -track.jerk if time_s >= falling else track.jerk
    if since >= rise:
        return 0.0
    if since >= pulse + track.steady_s:
        since, way = since - pulse - track.steady_s, -way
    elif since >= pulse:
        return 0.0
    into = min(since, pulse - since)
    return way if into >= track.edge_s else 0.5 * way * (1.0 - math.cos(math.pi * into / track.edge_s))
