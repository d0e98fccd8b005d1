"""All that is believed of the vehicle in a tick, of what each part found."""

from operator import add

from companion.core.observers import Estimates
from companion.estimation.estimator import Sensed
from companion.estimation.surroundings import Around
from companion.records import PSI, FrameShift, VehicleModel, VehicleState, vector


def believed(
    sensed: Sensed,
    motion: Estimates,
    around: Around,
    model: VehicleModel,
    dead_motor: int = 0,
    reversed_motor: int = 0,
) -> VehicleState:
    """Return the state, inside (`estimation.frame`)."""
    inputs, heartbeat, shifted = sensed.inputs, sensed.heartbeat, sensed.shifted
    (roll, pitch, p, q, _), turning = inputs.attitude, not inputs.stale[PSI]
    return VehicleState(
        t_s=inputs.now_s,
        boot_s=sensed.boot_s,
        eta=motion.eta,
        eta_dot=motion.eta_dot,
        ahead_s=inputs.ahead_s,
        eta_ahead=motion.eta_ahead,
        eta_dot_ahead=motion.eta_dot_ahead,
        disturbance=motion.disturbance,
        roll=roll,
        pitch=pitch,
        p=p if turning else 0.0,
        q=q if turning else 0.0,
        armed=heartbeat.armed,
        mode=heartbeat.mode,
        system_status=heartbeat.system_status,
        voltage_v=inputs.voltage_v,
        pilot_gain=sensed.pilot_gain,
        ages=sensed.ages,
        delays=sensed.delays,
        innovation=vector(map(add, motion.innovation, sensed.reset_by)),
        depth_refused=sensed.depth_refused,
        depth_doubt=sensed.depth_doubt,
        attitude_doubt=sensed.attitude_doubt,
        position_doubt=sensed.position_doubt,
        clock_doubt_s=sensed.clock_doubt_s,
        frame_shift=FrameShift(shifted[PSI], *shifted[:PSI]) if any(shifted) else None,
        depth_offset_m=sensed.depth_offset_m,
        stale=inputs.stale,
        dead_motor=dead_motor,
        reversed_motor=reversed_motor,
        model=model,
        ground=around.ground,
        current=around.current,
        heading_check=around.heading_check,
        heave_opposed=around.heave_opposed,
    )
