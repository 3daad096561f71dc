"""Where a point of one mount is in the axes of another, and how it moves with every number, compiled.

A way is a row of steps: a fixed pose with its six numbers, then a joint, if any. What a unit rate of a number does to a
step is a constant vector in the frame before it (a shift) or after it (a turn), so a posture costs three products of
3 x 3 matrices a step. The way to the observer comes first; everything after it is in the observer's axes.
"""

from __future__ import annotations

import math
from typing import no_type_check

import numpy as np

from bodyimage_kin._compiled import compiled

HELD, REVOLUTE, PRISMATIC = range(3)
"""Kinds of steps: without a joint, or with one that turns or slides."""

_FIXED, _ORIGIN, _SHIFTS, _TURNS, _AXIS, _NUMBERS = 0, 9, 12, 21, 30, 33
"""Columns of a step's constants: rotation and place of the fixed part, directions of its three shifts in the frame
before it, of its three turns in the frame after it, the joint's axis."""

# no_type_check: a checker that wraps functions would hand numba the wrapper.


@compiled
@no_type_check
def small(numbers, basis, rotation, shift, right):
    """The pose of six numbers, and the right Jacobian of its rotation times the basis; the last three are written.

    Args:
        numbers: (6,) three shifts [m], three turns [rad].
        basis: (3, 3) their directions, in its columns.
        rotation: (3, 3) of the pose.
        shift: (3,) of the pose [m].
        right: (3, 3).
    """
    turn = np.empty(3)
    for i in range(3):
        shift[i] = basis[i, 0] * numbers[0] + basis[i, 1] * numbers[1] + basis[i, 2] * numbers[2]
        turn[i] = basis[i, 0] * numbers[3] + basis[i, 1] * numbers[4] + basis[i, 2] * numbers[5]
    x, y, z = turn
    squared = x * x + y * y + z * z
    angle = math.sqrt(squared)
    if angle < 1e-4:
        # Taylor: what is left out is below rounding.
        one, two, three = 1.0 - squared / 6.0, 0.5 - squared / 24.0, 1.0 / 6.0 - squared / 120.0
    else:
        one = math.sin(angle) / angle
        two = (1.0 - math.cos(angle)) / squared
        three = (angle - math.sin(angle)) / (squared * angle)
    cross = np.zeros((3, 3))
    cross[0, 1], cross[0, 2], cross[1, 2] = -z, y, -x
    cross[1, 0], cross[2, 0], cross[2, 1] = z, -y, x
    for i in range(3):
        for j in range(3):
            square = turn[i] * turn[j] - (squared if i == j else 0.0)
            same = 1.0 if i == j else 0.0
            rotation[i, j] = same + one * cross[i, j] + two * square
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                square = turn[i] * turn[k] - (squared if i == k else 0.0)
                same = 1.0 if i == k else 0.0
                total += (same - two * cross[i, k] + three * square) * basis[k, j]
            right[i, j] = total


@compiled
@no_type_check
def _times(a, first, b, start, into, at):
    """A product of two 3 x 3 matrices that begin at these places of flat arrays; the result may not be one of them."""
    b00, b01, b02 = b[start], b[start + 1], b[start + 2]
    b10, b11, b12 = b[start + 3], b[start + 4], b[start + 5]
    b20, b21, b22 = b[start + 6], b[start + 7], b[start + 8]
    for i in range(3):
        x, y, z = a[first + 3 * i], a[first + 3 * i + 1], a[first + 3 * i + 2]
        into[at + 3 * i] = x * b00 + y * b10 + z * b20
        into[at + 3 * i + 1] = x * b01 + y * b11 + z * b21
        into[at + 3 * i + 2] = x * b02 + y * b12 + z * b22


@compiled
@no_type_check
def _constants(origins, bases, axes, firsts, theta, into):
    """What of each step is the same at all postures."""
    rotation, shift, right, product = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(9)
    for step in range(origins.shape[0]):
        begin = step * _NUMBERS
        small(theta[firsts[step] : firsts[step] + 6], bases[step], rotation, shift, right)
        turn = origins[step, :3, :3].copy().ravel()
        _times(turn, 0, rotation.ravel(), 0, into, begin + _FIXED)
        _times(turn, 0, bases[step].copy().ravel(), 0, into, begin + _SHIFTS)
        _times(into, begin + _FIXED, right.ravel(), 0, product, 0)
        for i in range(9):
            into[begin + _TURNS + i] = product[i]
        for i in range(3):
            moved = turn[3 * i] * shift[0] + turn[3 * i + 1] * shift[1] + turn[3 * i + 2] * shift[2]
            into[begin + _ORIGIN + i] = origins[step, i, 3] + moved
            into[begin + _AXIS + i] = axes[step, i]


@compiled
@no_type_check
def _walk(here, there, constants, kind, value, step, shifts, turns, places):
    """One step: the frame in ``here`` (rotation, then place) goes on, and what its numbers do is kept."""
    begin = step * _NUMBERS
    _times(here, 0, constants, begin + _SHIFTS, shifts, 9 * step)
    _times(here, 0, constants, begin + _TURNS, turns, 9 * step)
    _times(here, 0, constants, begin + _FIXED, there, 0)
    x, y, z = constants[begin + _ORIGIN], constants[begin + _ORIGIN + 1], constants[begin + _ORIGIN + 2]
    for i in range(3):
        here[9 + i] += here[3 * i] * x + here[3 * i + 1] * y + here[3 * i + 2] * z
        places[3 * step + i] = here[9 + i]
    x, y, z = constants[begin + _AXIS], constants[begin + _AXIS + 1], constants[begin + _AXIS + 2]
    if kind == REVOLUTE:
        sine, rest = math.sin(value), 1.0 - math.cos(value)
        square = x * x + y * y + z * z
        for i in range(3):
            a, b, c = there[3 * i], there[3 * i + 1], there[3 * i + 2]
            along = rest * (x * a + y * b + z * c)
            kept = 1.0 - rest * square
            here[3 * i] = kept * a + along * x - sine * (y * c - z * b)
            here[3 * i + 1] = kept * b + along * y - sine * (z * a - x * c)
            here[3 * i + 2] = kept * c + along * z - sine * (x * b - y * a)
    else:
        for i in range(9):
            here[i] = there[i]
        if kind == PRISMATIC:
            for i in range(3):
                here[9 + i] += value * (here[3 * i] * x + here[3 * i + 1] * y + here[3 * i + 2] * z)


@compiled
@no_type_check
def seen(values, theta, origins, bases, axes, kinds, firsts, back, offset, point, slope):
    """Where points are in the observer's axes, and how they move; the last two are written.

    Args:
        values: (count, joints) values of the joints [rad or m]; of a step's, the column is a sixth of its first number.
        theta: (parameters,) numbers.
        origins: (steps, 4, 4) fixed parts of the steps.
        bases: (steps, 3, 3) directions of their numbers.
        axes: (steps, 3) of their joints.
        kinds: (steps,) of their joints.
        firsts: (steps,) index of the first of their six numbers.
        back: How many of the steps, the first ones, lead to the observer; the others lead to the point's frame.
        offset: (count, 3) the points in their frame [m].
        point: (count, 3) [m].
        slope: (count, 3, parameters), zeros.
    """
    steps, parameters = origins.shape[0], slope.shape[2]
    constants = np.empty(steps * _NUMBERS)
    _constants(origins, bases, axes, firsts, theta, constants)
    here, there, turned = np.empty(12), np.empty(9), np.empty(9)
    shifts, turns, places = np.empty(9 * steps), np.empty(9 * steps), np.empty(3 * steps)
    flat = slope.reshape(slope.size)
    for row in range(values.shape[0]):
        for i in range(12):
            here[i] = 0.0
        here[0], here[4], here[8] = 1.0, 1.0, 1.0
        for step in range(back):
            value = values[row, firsts[step] // 6] if kinds[step] != HELD else 0.0
            _walk(here, there, constants, kinds[step], value, step, shifts, turns, places)
        if back:
            # From here on in the observer's axes.
            for i in range(3):
                for j in range(3):
                    turned[3 * i + j] = here[3 * j + i]
            px, py, pz = here[9], here[10], here[11]
            for step in range(back):
                for block in (shifts, turns):
                    for i in range(9):
                        there[i] = block[9 * step + i]
                    _times(turned, 0, there, 0, block, 9 * step)
                x, y, z = places[3 * step] - px, places[3 * step + 1] - py, places[3 * step + 2] - pz
                for i in range(3):
                    places[3 * step + i] = turned[3 * i] * x + turned[3 * i + 1] * y + turned[3 * i + 2] * z
            for i in range(9):
                here[i] = turned[i]
            for i in range(3):
                here[9 + i] = -(turned[3 * i] * px + turned[3 * i + 1] * py + turned[3 * i + 2] * pz)
        for step in range(back, steps):
            value = values[row, firsts[step] // 6] if kinds[step] != HELD else 0.0
            _walk(here, there, constants, kinds[step], value, step, shifts, turns, places)
        x, y, z = offset[row, 0], offset[row, 1], offset[row, 2]
        for i in range(3):
            here[9 + i] += here[3 * i] * x + here[3 * i + 1] * y + here[3 * i + 2] * z
            point[row, i] = here[9 + i]
        for step in range(steps):
            sign = -1.0 if step < back else 1.0
            x, y, z = here[9] - places[3 * step], here[10] - places[3 * step + 1], here[11] - places[3 * step + 2]
            x, y, z = sign * x, sign * y, sign * z
            first = row * 3 * parameters + firsts[step]
            second, third = first + parameters, first + 2 * parameters
            for k in range(3):
                a, b, c = turns[9 * step + k], turns[9 * step + 3 + k], turns[9 * step + 6 + k]
                flat[first + k] += sign * shifts[9 * step + k]
                flat[second + k] += sign * shifts[9 * step + 3 + k]
                flat[third + k] += sign * shifts[9 * step + 6 + k]
                flat[first + 3 + k] += b * z - c * y
                flat[second + 3 + k] += c * x - a * z
                flat[third + 3 + k] += a * y - b * x
