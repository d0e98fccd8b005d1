"""The rivals' laws over arrays of dives, by the names of `lab.bench.rows`."""

from collections.abc import Mapping

from companion.config import Axis, Config
from lab.batch.legacy.records import Array
from lab.batch.legacy.rival_l1 import L1, L1Gains
from lab.batch.legacy.rival_law import Law
from lab.batch.legacy.rival_ppi import PPI, PPIGains
from lab.batch.legacy.rival_super_twisting import SuperTwisting, TwistGains

TWIST_KEYS = (
    "heave.lambda_per_s",
    "heave.kappa_per_s",
    "laws.super_twisting.k_1",
    "laws.super_twisting.k_2",
)

Gains = Mapping[str, Array | float]


def rival(name: str, values: Gains, config: Config) -> Law | None:
    """Return the law of a row, or None where the companion's own steers."""
    laws = {"ppi": _ppi, "l1": _l1, "super_twisting": _twist}
    return laws[name](values, config) if name in laws else None


def _ppi(values: Gains, config: Config) -> Law:
    k_p, k_v, k_i = (values[f"laws.ppi.{key}"] for key in ("k_p", "k_v", "k_i"))
    return PPI(PPIGains(k_p, k_v, k_i, config.heave.max_disturbance))


def _l1(values: Gains, config: Config) -> Law:
    heave: Axis = config.heave
    lead_s = values.get("thrusters.lead_s", config.thrusters.lead_s)
    return L1(
        L1Gains(
            lam=values["heave.lambda_per_s"],
            kappa=values["heave.kappa_per_s"],
            omega=values["laws.l1.omega"],
            d_max=heave.max_disturbance,
            max_force=heave.max_force,
            lag_s=config.thrusters.lag_s,
            lead_s=lead_s,
        )
    )


def _twist(values: Gains, config: Config) -> Law:
    d_max = config.heave.max_disturbance
    lam, kappa, k_1, k_2 = (values[key] for key in TWIST_KEYS)
    return SuperTwisting(TwistGains(lam, kappa, k_1, k_2, d_max))
