"""Online learning of a map whose winners are given, compiled: steps x units, the coordinates apart."""

from __future__ import annotations

import math
from typing import no_type_check

from bodyimage_kin._compiled import compiled


# no_type_check: a checker that wraps functions would hand numba the wrapper.
@compiled
@no_type_check
def learn(weights, winners, targets, rates, gammas, exponents, kernel, pull, speaking, stops, history):
    """Changes a map in place, a step a sample: ``w_i += rate h(d_ic) (target - w_i)``.

    Args:
        weights: (m, rows, columns) the map.
        winners: (steps,) unit of each step, -1: the step teaches nothing.
        targets: (steps, m).
        rates: (steps,) learning rate.
        gammas: (steps,) width of the kernel.
        exponents: (2 rows - 1, 2 columns - 1) logarithm of the kernel at gamma = 1, by offset.
        kernel: Of the same shape: room for the kernel.
        pull: (columns,): room for a row's pull.
        speaking: (steps, rows, columns) units that learn at a step; with no steps, all do.
        stops: (snapshots,) steps after which the map is kept, ascending.
        history: (snapshots, rows, columns, m) where to.
    """
    m, rows, columns = weights.shape
    gamma = 0.0
    done = 0
    for snapshot in range(len(stops)):
        for step in range(done, stops[snapshot]):
            winner = winners[step]
            if winner < 0:
                continue
            if gammas[step] != gamma:
                gamma = gammas[step]
                # The kernel is the same to all sides.
                for i in range(rows):
                    for j in range(columns):
                        value = math.exp(exponents[i, j] / gamma)
                        kernel[i, j] = value
                        kernel[i, -1 - j] = value
                        kernel[-1 - i, j] = value
                        kernel[-1 - i, -1 - j] = value
            first_row, first_column = rows - 1 - winner // columns, columns - 1 - winner % columns
            for row in range(rows):
                for column in range(columns):
                    pull[column] = rates[step] * kernel[first_row + row, first_column + column]
                if len(speaking):
                    for column in range(columns):
                        pull[column] *= speaking[step, row, column]
                for axis in range(m):
                    target = targets[step, axis]
                    for column in range(columns):
                        weight = weights[axis, row, column]
                        weights[axis, row, column] = weight + pull[column] * (target - weight)
        done = stops[snapshot]
        for axis in range(m):
            for row in range(rows):
                for column in range(columns):
                    history[snapshot, row, column, axis] = weights[axis, row, column]


@compiled
@no_type_check
def learn_by_distance(weights, active, strengths, targets, rates, gammas, exponents, pull, speaking, stops, history):
    """Changes a map of any skin in place, a step a sample: ``w_i += rate max_c(s_c h(d_ic)) (target - w_i)``.

    Args:
        weights: (m, taxels) the map.
        active: (steps, contacts) taxels felt at a step, those first that are; -1: none.
        strengths: (steps, contacts) logarithm of how strongly each is felt, 0 of the strongest.
        targets: (steps, m).
        rates: (steps,) learning rate.
        gammas: (steps,) width of the kernel.
        exponents: (taxels, taxels) logarithm of the kernel at gamma = 1.
        pull: (taxels,): room for the pull.
        speaking: (steps, taxels) taxels that learn at a step; with no steps, all do.
        stops: (snapshots,) steps after which the map is kept, ascending.
        history: (snapshots, taxels, m) where to.
    """
    m, taxels = weights.shape
    contacts = active.shape[1]
    # What pulls less than this is lost in the rounding of a weight.
    least = -37.0
    done = 0
    for snapshot in range(len(stops)):
        for step in range(done, stops[snapshot]):
            first = active[step, 0]
            if first < 0:
                continue
            narrow, rate = 1.0 / gammas[step], rates[step]
            for taxel in range(taxels):
                pull[taxel] = exponents[first, taxel] * narrow + strengths[step, 0]
            for contact in range(1, contacts):
                other = active[step, contact]
                if other < 0:
                    break
                for taxel in range(taxels):
                    pull[taxel] = max(pull[taxel], exponents[other, taxel] * narrow + strengths[step, contact])
            # exp(x) as exp(x / 1024) ** 1024, the inner one by its series: right to 1e-13, and eight taxels at a time.
            for taxel in range(taxels):
                x = max(pull[taxel], least) * (1.0 / 1024.0)
                y = 1.0 + x * (1.0 / 7.0)
                y = 1.0 + x * (1.0 / 6.0) * y
                y = 1.0 + x * (1.0 / 5.0) * y
                y = 1.0 + x * (1.0 / 4.0) * y
                y = 1.0 + x * (1.0 / 3.0) * y
                y = 1.0 + x * (1.0 / 2.0) * y
                y = 1.0 + x * y
                y *= y
                y *= y
                y *= y
                y *= y
                y *= y
                y *= y
                y *= y
                y *= y
                y *= y
                y *= y
                pull[taxel] = rate * y
            if len(speaking):
                for taxel in range(taxels):
                    pull[taxel] *= speaking[step, taxel]
            for axis in range(m):
                target = targets[step, axis]
                for taxel in range(taxels):
                    weight = weights[axis, taxel]
                    weights[axis, taxel] = weight + pull[taxel] * (target - weight)
        done = stops[snapshot]
        for axis in range(m):
            for taxel in range(taxels):
                history[snapshot, taxel, axis] = weights[axis, taxel]
