"""Random wrenches, within and beyond what the thrusters can do."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from companion.core.allocation import allocate, delivered, thrusters

frames = st.sampled_from(["vectored", "vectored_6dof"])
part = st.floats(-1.0, 1.0)
voltages = st.floats(12.0, 18.0)
TYPICAL = np.array([30.0, 30.0, 50.0, 5.0])
MAX_TAU = np.array([70.0, 70.0, 100.0, 12.0])
FRAMES = {
    frame: thrusters(frame, (*MAX_TAU.tolist(), 5.0, 5.0), True) for frame in ("vectored", "vectored_6dof")
}


def allocated(frame, tau, voltage_v, reach=(1.0,) * 4):
    """Return the first four axes and which are saturated."""
    axes, saturated = allocate(FRAMES[frame], (*tau, 0.0, 0.0), voltage_v, (*reach, 1.0, 1.0))
    return np.array(axes[:4]), np.array(saturated[:4])


def given_back(frame, axes, voltage_v):
    return np.array(delivered(FRAMES[frame], (*axes, 0.0, 0.0), voltage_v)[:4])


def horizontal_load(tau, voltage_v):
    """Largest newtons at 16 V that surge, sway and yaw together may ask of one thruster."""
    shares = np.abs(tau[[0, 1, 3]]) / (4.0 * np.sqrt(0.5) * np.array([1.0, 1.0, 0.267]))
    return shares.sum() / (voltage_v / 16.0) ** 2


@given(frames, arrays(float, 4, elements=part), voltages)
def test_a_wrench_within_the_envelope_comes_out_as_it_went_in(frame, share, voltage_v):
    """Within 4 N level, 0.5 N of heave and 1.25 N m; the rest is that a T200 pushes 23 % less in reverse."""
    tau = share * TYPICAL
    tau[[0, 1, 3]] *= min(1.0, 25.0 / max(horizontal_load(tau, voltage_v), 1e-9))
    tau[2] *= min(1.0, (voltage_v / 16.0) ** 2)
    axes, saturated = allocated(frame, tau, voltage_v)
    assert not saturated.any()
    assert (np.abs(given_back(frame, axes, voltage_v) - tau) <= [4.0, 4.0, 0.5, 1.25]).all()


@given(
    frames,
    arrays(float, 4, elements=st.floats(-1e4, 1e4)),
    voltages,
    arrays(float, 4, elements=st.floats(0.05, 1.0)),
)
def test_whatever_is_asked_the_axes_stay_within_reach(frame, tau, voltage_v, reach):
    axes, saturated = allocated(frame, tau, voltage_v, reach)
    assert np.isfinite(axes).all()
    assert (np.abs(axes) <= reach + 1e-9).all()
    assert np.abs(axes[[0, 1, 3]]).sum() <= 1.0 + 1e-9
    assert saturated[np.abs(tau) > MAX_TAU].all()
    assert np.isfinite(given_back(frame, axes, voltage_v)).all()


@given(frames, arrays(float, 4, elements=part), voltages)
def test_left_and_right_are_alike(frame, share, voltage_v):
    """Mirrored wrenches give mirrored axes: sway and yaw change sign, surge and heave do not."""
    mirror = np.array([1.0, -1.0, 1.0, -1.0])
    (axes, _), (mirrored, _) = (
        allocated(frame, tau, voltage_v) for tau in (share * MAX_TAU, mirror * share * MAX_TAU)
    )
    np.testing.assert_allclose(mirrored, mirror * axes, atol=1e-12)


@given(frames, st.floats(-30.0, 30.0), st.floats(0.01, 10.0), st.sampled_from([0, 1, 2, 3]))
def test_more_is_more(frame, tau, more, axis):
    """Each axis alone is monotonic, through the dead band too."""
    scale = TYPICAL[axis] / 50.0
    less_tau, more_tau = np.zeros(4), np.zeros(4)
    less_tau[axis], more_tau[axis] = tau * scale, (tau + more) * scale
    less, greater = (allocated(frame, t, 16.0)[0][axis] for t in (less_tau, more_tau))
    assert greater > less - 1e-12
