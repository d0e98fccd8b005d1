"""A compensator with its state, as the controller holds one."""

import numpy as np

from companion.core.compensator import INPUTS, Signals

DT_S = 0.02
CONVENTIONS = {"leak_per_s": 0.0, "dead_zone": 0.0, "max_disturbance": 60.0}


class Learner:
    """One of `module`, whose parameters are CONVENTIONS where not given."""

    def __init__(self, module, **values):
        self.module = module
        known = {key: value for key, value in CONVENTIONS.items() if key in module.Parameters._fields}
        self.parameters = module.Parameters(**known | values)
        self.reset()

    def reset(self):
        self.state, self.learning = self.module.initial(self.parameters), False

    def step(self, signals, adapt=True, dt_s=DT_S):
        """Return d_hat after a tick."""
        self.state, d_hat, self.learning = self.module.step(self.parameters, self.state, signals, dt_s, adapt)
        return d_hat

    def seed(self, signals, d_hat):
        self.state = self.module.seed(self.parameters, self.state, signals, d_hat)

    @property
    def weight_norm(self):
        return self.module.weight_norm(self.state)


def hidden(units, seed=1, inputs=INPUTS):
    """Return a network's first hidden layer, a column a unit; the inputs beyond `inputs` have no weight."""
    columns = np.zeros((units, INPUTS))
    columns[:, :inputs] = np.random.default_rng(seed).standard_normal((inputs, units)).T
    return tuple(map(tuple, columns.tolist()))


def drawn(rng, eps=0.0):
    """Return random signals with a given combined error."""
    e, e_dot, x_dot, x_d_dot, x_d_ddot = rng.normal(size=5) * 0.2
    return Signals(e, e_dot, eps, x_dot, x_d_dot, x_d_ddot)


def still(eps=0.0, x_dot=0.0):
    """Return signals on the path."""
    return Signals(0.0, x_dot, eps, x_dot, 0.0, 0.0)
