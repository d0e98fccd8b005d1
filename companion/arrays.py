"""Arrays of numbers, for what is computed at start-up and in the lab; records and core have none."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
