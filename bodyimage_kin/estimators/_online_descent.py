"""Online back-propagation of the paper's network, compiled: each update needs the one before."""

from __future__ import annotations

import math
from typing import no_type_check

import numpy as np

from bodyimage_kin._compiled import compiled


# no_type_check: a checker that wraps functions would hand numba the wrapper.
@compiled
@no_type_check
def descend(x, y, W1, b1, W2, b2, rate, passes):
    """Changes weights and biases in place, after each sample in turn, in so many passes.

    Args:
        x: (samples, p) inputs.
        y: (samples, m) outputs.
        W1: (hidden, p).
        b1: (hidden,).
        W2: (m, hidden).
        b2: (m,).
        rate: Learning rate.
        passes: Times that all samples are gone through.
    """
    samples, p = x.shape
    outputs, units = W2.shape
    hidden, error = np.empty(units), np.empty(outputs)
    for _ in range(passes):
        for sample in range(samples):
            for unit in range(units):
                total = b1[unit]
                for i in range(p):
                    total += W1[unit, i] * x[sample, i]
                hidden[unit] = math.tanh(total)
            for o in range(outputs):
                total = b2[o]
                for unit in range(units):
                    total += W2[o, unit] * hidden[unit]
                error[o] = total - y[sample, o]
            for unit in range(units):
                back = 0.0
                for o in range(outputs):
                    back += W2[o, unit] * error[o]
                    W2[o, unit] -= rate * error[o] * hidden[unit]
                back *= 1.0 - hidden[unit] * hidden[unit]
                for i in range(p):
                    W1[unit, i] -= rate * back * x[sample, i]
                b1[unit] -= rate * back
            for o in range(outputs):
                b2[o] -= rate * error[o]
