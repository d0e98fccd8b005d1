"""One tick as what is published of it: a `ControlSample` as one record of each key, and those as JSON."""

from functools import cache

from companion.records import PSI, Condition, ControlSample, X, Y, Z
from companion.telemetry.schemas import NEVER_S, Command, Dof, Loop, Schema, State, Supervisor, keys, to_json

_MEASURED = ("x", "x_dot", "e", "e_dot", "eps", "d_observer")
_ANGLES = ("roll_rad", "pitch_rad", "roll_rate_radps", "pitch_rate_radps")
_SOURCES = (
    ("x_m", "x_rate_mps"),
    ("y_m", "y_rate_mps"),
    ("depth_m", "depth_rate_mps"),
    ("heading_rad", "heading_rate_radps", *_ANGLES),
    ("armed", "mode", "system_status", "voltage_v", "pilot_gain"),
)
"""Fields of State by their source: position (two), depth, attitude, and the vehicle as a whole."""

_DOFS = ((X, "x", "m", "N"), (Y, "y", "m", "N"), (Z, "z", "m", "N"), (PSI, "psi", "rad", "N·m"))
"""Index, name, and the units of position and of force of each degree of freedom."""


def encode(sample: ControlSample, vehicle: str) -> list[tuple[str, str, bytes]]:
    """One tick as (key, encoding, JSON) for each of `keys(vehicle)`."""
    return [
        (key, encoding, to_json(record))
        for (key, encoding), record in zip(keys(vehicle).items(), records(sample), strict=True)
    ]


def records(sample: ControlSample) -> list[Schema]:
    """One tick as schema records, in the order of `keys`; here numbers may still be other than finite."""
    state, verdict, loop, counters = sample.state, sample.verdict, sample.loop, sample.counters
    t_s, boot_s = state.t_s, state.boot_s
    x, y, z, psi = state.eta
    x_d, y_d, z_d, psi_d = sample.eta_d
    x_rate, y_rate, z_rate, psi_rate = state.eta_dot
    surge, sway, heave, yaw = sample.requested.tau
    surge_out, sway_out, heave_out, yaw_out = sample.delivered.tau
    silent = Condition.LINK_LOST in verdict.conditions
    return [
        State(
            t_s=t_s,
            boot_s=boot_s,
            absent=_stale_state(*state.stale, silent),
            x_m=x,
            y_m=y,
            depth_m=z,
            heading_rad=psi,
            x_desired_m=x_d,
            y_desired_m=y_d,
            depth_desired_m=z_d,
            heading_desired_rad=psi_d,
            x_rate_mps=x_rate,
            y_rate_mps=y_rate,
            depth_rate_mps=z_rate,
            heading_rate_radps=psi_rate,
            roll_rad=state.roll,
            pitch_rad=state.pitch,
            roll_rate_radps=state.p,
            pitch_rate_radps=state.q,
            armed=state.armed,
            mode=state.mode,
            system_status=state.system_status,
            voltage_v=state.voltage_v,
            pilot_gain=state.pilot_gain,
            dead_motor=state.dead_motor,
            guidance=sample.guided.kind,
            path_number=sample.guided.number,
            path_progress_m=sample.guided.progress_m,
            path_length_m=sample.guided.length_m,
            current_north_mps=state.current.north_mps,
            current_east_mps=state.current.east_mps,
            current_doubt_mps=state.current.doubt_mps,
            position_doubt_major_m=state.position_doubt.major_m,
            position_doubt_minor_m=state.position_doubt.minor_m,
            position_doubt_direction_rad=state.position_doubt.direction_rad,
            altitude_m=state.ground.depth_m - z,
            altitude_desired_m=sample.guided.altitude_m,
            path_speed_mps=sample.guided.speed_mps,
        ),
        *_dofs(sample),
        Command(
            t_s=t_s,
            boot_s=boot_s,
            surge=sample.command.surge,
            sway=sample.command.sway,
            heave=sample.command.heave,
            yaw=sample.command.yaw,
            surge_requested_n=surge,
            sway_requested_n=sway,
            heave_requested_n=heave,
            yaw_requested_nm=yaw,
            surge_delivered_n=surge_out,
            sway_delivered_n=sway_out,
            heave_delivered_n=heave_out,
            yaw_delivered_nm=yaw_out,
        ),
        Supervisor(
            t_s=t_s,
            boot_s=boot_s,
            state=verdict.state.value,
            conditions=_names(verdict.conditions),
            authority=verdict.authority,
            reason=verdict.reason,
            warnings=_names(verdict.warnings),
            freeze=verdict.freeze,
            remedy=verdict.remedy,
        ),
        Loop(
            t_s=t_s,
            boot_s=boot_s,
            tick=loop.tick,
            rate_hz=loop.rate_hz,
            lateness_ms=loop.lateness_ms,
            compute_us=loop.compute_us,
            late_ticks=loop.late_ticks,
            samples_dropped=loop.samples_dropped,
            link_age_s=min(state.ages.link_s, NEVER_S),
            heartbeat_age_s=min(state.ages.heartbeat_s, NEVER_S),
            depth_age_s=min(state.ages.depth_s, NEVER_S),
            attitude_age_s=min(state.ages.attitude_s, NEVER_S),
            position_age_s=min(state.ages.position_s, NEVER_S),
            telemetry_delay_s=state.delays.telemetry_s,
            telemetry_delay_known=state.delays.telemetry_known,
            command_delay_s=state.delays.command_s,
            command_delay_known=state.delays.command_known,
            hidden_delay_s=state.delays.hidden_s,
            datagrams=counters.datagrams,
            messages=counters.messages,
            garbage=counters.garbage,
            foreign=counters.foreign + loop.strangers,
            implausible=counters.implausible,
            refused=counters.refused,
            pilot_age_s=min(state.ages.pilot_s, NEVER_S),
            left_out_bytes=loop.left_out_bytes,
        ),
    ]


def _dofs(sample: ControlSample) -> list[Dof]:
    state, dofs, model = sample.state, sample.dofs, sample.state.model
    return [
        Dof(
            t_s=state.t_s,
            boot_s=state.boot_s,
            absent=_MEASURED if state.stale[i] else (),
            dof=dof,
            unit=unit,
            tau_unit=tau_unit,
            ahead_s=state.ahead_s,
            x_d=dofs.x_d[i],
            x_d_dot=dofs.x_d_dot[i],
            x_d_ddot=dofs.x_d_ddot[i],
            x=dofs.x[i],
            x_dot=dofs.x_dot[i],
            e=dofs.e[i],
            e_dot=dofs.e_dot[i],
            eps=dofs.eps[i],
            tau=dofs.tau[i],
            feedforward=dofs.feedforward[i],
            feedback=dofs.feedback[i],
            d_hat=dofs.d_hat[i],
            d_observer=dofs.d_observer[i],
            weight_norm=dofs.weight_norm[i],
            saturated=dofs.saturated[i],
            adapting=dofs.adapting[i],
            engaged=dofs.engaged[i],
            model_gain=model.gain[i],
            model_gain_found=model.found_gain[i],
            model_gain_doubt=model.log_gain_doubt[i],
            model_lag_s=model.lag_s[i],
            model_lag_found_s=model.found_lag_s[i],
            model_lag_doubt_s=model.lag_doubt_s[i],
        )
        for i, dof, unit, tau_unit in _DOFS
    ]


@cache
def _stale_state(x: bool, y: bool, z: bool, psi: bool, silent: bool) -> tuple[str, ...]:
    """Return the fields of State that are stale: those of each DOF, and all others if it is `silent`."""
    flags = (x, y, z, psi, silent)
    return tuple(name for stale, names in zip(flags, _SOURCES, strict=True) if stale for name in names)


@cache
def _names(conditions: Condition) -> tuple[str, ...]:
    return tuple(condition.name or "" for condition in conditions)
