"""The rivals' laws over arrays of dives, by the names of `lab.bench.rows`."""

from collections.abc import Mapping

from companion.config import Axis, Config
from lab.batch.legacy.records import Array
from lab.batch.legacy.rival_l1 import L1, L1Gains
from lab.batch.legacy.rival_law import Law
from lab.batch.legacy.rival_ppi import PPI, PPIGains
from lab.batch.legacy.rival_super_twisting import SuperTwisting, TwistGains

Gains = Mapping[str, Array | float]


def rival(name: str, values: Gains, config: Config) -> Law | None:
    """Return the law of a row, or None where the companion's own steers."""
    laws = {"ppi": _ppi, "l1": _l1, "super_twisting": _twist}
    return laws[name](values, config) if name in laws else None


def _ppi(values: Gains, config: Config) -> Law:
    return PPI(PPIGains(values["k_p"], values["k_v"], values["k_i"], config.heave.max_disturbance))


def _l1(values: Gains, config: Config) -> Law:
    heave: Axis = config.heave
    lead_s = values.get("thrusters.lead_s", config.thrusters.lead_s)
    return L1(
        L1Gains(
            lam=values["lam"],
            kappa=values["kappa"],
            omega=values["omega"],
            d_max=heave.max_disturbance,
            max_force=heave.max_force,
            lag_s=config.thrusters.lag_s,
            lead_s=lead_s,
        )
    )


def _twist(values: Gains, config: Config) -> Law:
    d_max = config.heave.max_disturbance
    return SuperTwisting(TwistGains(values["lam"], values["kappa"], values["k_1"], values["k_2"], d_max))
