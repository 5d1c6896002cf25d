"""Read-only float64 arrays for frozen structs."""

import numpy as np


def frozen(values: np.ndarray, dtype: type = np.float64) -> np.ndarray:
    """A read-only contiguous copy of the values as the given dtype."""
    copy = np.array(values, dtype=dtype, order="C", copy=True)
    copy.setflags(write=False)
    return copy
