"""Any resets and fixes of the EKF: inside the vehicle goes on as if there were none."""

from math import hypot, pi

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.core.bounds import wrap
from companion.estimation.frame import FIX_RATIO, RESET_M, Frame

TICK_S = 0.02
metres = st.floats(-50.0, 50.0)
angles = st.floats(-pi, pi)
poses = st.tuples(metres, metres, st.floats(0.0, 10.0), angles)
resets = st.lists(
    st.tuples(
        st.one_of(
            st.tuples(st.just("turn"), angles, st.just(0.0)),
            st.tuples(st.just("jump"), metres, metres),
            st.tuples(st.just("jump"), st.floats(-0.9, 0.9), st.just(0.0)),
        ),
        st.booleans(),
    ),
    max_size=12,
)


def near(one, other):
    np.testing.assert_allclose(one[:3], other[:3], atol=1e-9)
    assert abs(wrap(one[3] - other[3])) < 1e-9


@given(resets, st.lists(poses, min_size=12, max_size=12))
def test_the_place_inside_is_the_same_before_and_after_each_reset(resets, places):
    frame = Frame()
    for i, (((kind, a, b), held), (x, y, z, psi)) in enumerate(zip(resets, places, strict=False)):
        frame = frame.followed(TICK_S, held=held)
        for_ekf = frame.now.outside((x, y, z, psi))
        if kind == "turn":
            frame = frame.turned(a, *for_ekf[:2])
            for_ekf = (*for_ekf[:3], wrap(for_ekf[3] + a))
        else:
            frame = frame.jumped(a, b, 20.0 * i, held=held)
            for_ekf = (for_ekf[0] + a, for_ekf[1] + b, *for_ekf[2:])
        near(frame.now.inside(for_ekf), (x, y, z, psi))
        owed = hypot(*frame.owed)
        assert owed <= FIX_RATIO * RESET_M if held else owed == 0.0


@given(resets, poses, poses, st.tuples(metres, metres, metres, metres))
def test_in_and_out_are_inverse_and_keep_lengths(resets, one, other, vector):
    frame = Frame()
    for (kind, a, b), held in resets:
        frame = frame.turned(a, 1.0, -2.0) if kind == "turn" else frame.jumped(a, b, 0.0, held=held)
    for offset in (frame.now, frame.settled):
        near(offset.inside(offset.outside(one)), (*one[:3], wrap(one[3])))
        np.testing.assert_allclose(offset.inward(offset.outward(vector)), vector, atol=1e-9)
        (x, y, _, _), (x_2, y_2, _, _) = offset.outside(one), offset.outside(other)
        assert abs(hypot(x - x_2, y - y_2) - hypot(one[0] - other[0], one[1] - other[1])) < 1e-9
