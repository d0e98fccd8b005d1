"""What an angle changes of a law that works level, against the rotations of Fossen's book."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config import Config, load_config
from companion.core import attitude
from companion.core.reference import ReferenceState
from companion.guidance.angles import HeldAngles
from companion.records import LEVEL, Angles, AxisCommand

ANGLE = st.floats(-attitude.MAX_ANGLE_RAD, attitude.MAX_ANGLE_RAD)
NEWTONS = st.floats(-100.0, 100.0)


@given(ANGLE, ANGLE, *[st.floats(-2.0, 2.0)] * 3)
def test_the_rates_of_the_angles_turn_the_body_at_its_rates(roll, pitch, p, q, r):
    """Fossen 2011, eq. 2.26: the body's rates are those of the angles about their own axes."""
    roll_dot, pitch_dot, yaw_dot = attitude.angle_rates(roll, pitch, p, q, r)
    s, c = math.sin(roll), math.cos(roll)
    assert roll_dot - yaw_dot * math.sin(pitch) == pytest.approx(p, abs=1e-9)
    assert pitch_dot * c + yaw_dot * s * math.cos(pitch) == pytest.approx(q, abs=1e-9)
    assert -pitch_dot * s + yaw_dot * c * math.cos(pitch) == pytest.approx(r, abs=1e-9)


def held(roll, pitch, roll_dot=0.0, pitch_dot=0.0):
    return attitude.Held(
        ReferenceState(roll, roll_dot, 0.0, 0.0, 0.0),
        ReferenceState(pitch, pitch_dot, 0.0, 0.0, 0.0),
    )


def rotation(roll, pitch):
    """From the body to the level frame of the heading (Fossen 2011, eq. 2.18)."""
    (sr, cr), (sp, cp) = ((math.sin(a), math.cos(a)) for a in (roll, pitch))
    return np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]) @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])


@given(ANGLE, ANGLE, st.tuples(NEWTONS, NEWTONS, NEWTONS))
def test_a_level_force_is_turned_into_the_body(roll, pitch, force):
    found = attitude.body_force(held(roll, pitch), force)
    np.testing.assert_allclose(rotation(roll, pitch) @ found, force, atol=1e-9)


@given(ANGLE, ANGLE, st.floats(-20.0, 20.0))
def test_a_moment_about_the_vertical_turns_the_heading_alone(roll, pitch, N):
    """For equal inertia its parts are those of a moment about the vertical."""
    at, inertia = held(roll, pitch), 0.3
    K = attitude.roll_moment(at, inertia, 0.0, N)
    M = attitude.pitch_moment(at, inertia, 0.0, N)
    body = (K, M, attitude.upright_share(at) * N)
    np.testing.assert_allclose(rotation(roll, pitch) @ body, (0.0, 0.0, N), atol=1e-9)


@given(ANGLE, ANGLE, st.floats(-1.0, 1.0), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_a_vehicle_that_turns_and_pitches_as_it_should_does_not_deviate(
    roll, pitch, turn, roll_dot, pitch_dot
):
    """Body rates of Euler rates: Fossen 2011, eq. 2.26."""
    p = roll_dot - turn * math.sin(pitch)
    q = pitch_dot * math.cos(roll) + turn * math.sin(roll) * math.cos(pitch)
    off = attitude.deviation(held(roll, pitch, roll_dot, pitch_dot), roll, pitch, p, q, turn)
    np.testing.assert_allclose(off, 0.0, atol=1e-12)


def test_the_reference_arrives_within_its_limits():
    at, wanted, fastest = attitude.HELD_LEVEL, Angles(0.3, -0.5), 0.0
    for _ in range(300):
        at = attitude.approach(at, wanted, 0.02)
        fastest = max(fastest, abs(at.roll.x_d_dot), abs(at.pitch.x_d_dot))
    assert attitude.angles(at) == pytest.approx(wanted, abs=1e-3)
    assert 0.2 < fastest <= attitude.LIMITS.max_rate + 1e-9


def test_an_angle_that_the_vehicle_cannot_hold_is_refused_before_it_moves():
    heavy = HeldAngles(Config())
    with pytest.raises(ValueError, match="pitch_deg = 60: this vehicle holds up to 55°"):
        heavy.ask(Angles(0.0, math.radians(60.0)))
    stiff = load_config(overrides=["levelling.roll_righting_nm=30"])
    with pytest.raises(ValueError, match=r"roll_deg = 20: this vehicle holds up to 12°"):
        HeldAngles(stiff).ask(Angles(math.radians(20.0), 0.0))
    for overrides, said in (
        (["vehicle.steering_mode='stabilize'"], "the firmware keeps roll and pitch"),
        (["vehicle.preset='bluerov2'"], "needs vectored_6dof"),
    ):
        other = HeldAngles(load_config(overrides=overrides))
        with pytest.raises(ValueError, match=said):
            other.ask(Angles(math.nan, 0.1))
        other.ask(LEVEL)
        other.aim(Angles(0.3, 0.3))
        other.turn(AxisCommand(roll=1.0), 1.0)
        assert other.asked == LEVEL


def test_what_is_not_named_stays_and_a_stick_turns_it_on():
    angles = HeldAngles(Config())
    angles.ask(Angles(0.2, math.nan))
    angles.ask(Angles(math.nan, -0.1))
    assert angles.asked == (0.2, -0.1)
    angles.turn(AxisCommand(pitch=1.0, roll=0.03), 0.5)
    assert angles.asked == pytest.approx((0.2, -0.1 + 0.5 * attitude.LIMITS.max_rate))
    for _ in range(100):
        angles.turn(AxisCommand(pitch=1.0), 0.5)
    assert angles.asked.pitch == attitude.MAX_ANGLE_RAD
