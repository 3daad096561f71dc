"""One set of compiled kernels for every robot: arrays describe the chain, nothing is generated for it.

A chain is a product of joints about (or along) z with all that is fixed folded in between::

    root_T_link = start  Rz(q_1 + phase_1) step_1  Rz(q_2 + phase_2) step_2 ...  Rz(last)
    step = translation  Rx(tilt)

Any fixed rotation is Rz Rx Rz, and the outer two merge with the joints beside them: what is left costs two plane
rotations a joint instead of a product of matrices. The phase turns sine and cosine, never the angle, so that an angle
of a million radians keeps all its digits. A prismatic joint turns by its phase alone and slides along z.

Postures are worked off in blocks of ``L`` lanes. Every quantity of a block is one row of ``L`` numbers in a flat
scratch array, at a place known at compile time wherever possible: only then does LLVM turn the loops over lanes into
vector instructions.
"""

from __future__ import annotations

import math
from typing import no_type_check

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from bodyimage_kin._compiled import compiled

L = 32
"""Lanes, postures in a block: few enough for the scratch of a seven-joint arm to fit the first-level cache."""

SIN_PHASE, COS_PHASE, STEP_X, STEP_Y, STEP_Z, SIN_TILT, COS_TILT, MULTIPLIER, OFFSET = range(9)
"""Columns of a chain's constants. Row j + 1 is joint j, whose angle is multiplier * q + offset (1 and 0 unless it
follows another). Row 0 is ``start`` (axes x, y, z, then the origin); the last row has sine and cosine of ``last``."""
CONSTANTS = 12

COLUMN, PRISMATIC, INTO = range(3)
"""Columns of a chain's joints: index in q, 1 if prismatic, and the first joint (itself, mostly) that q also moves."""

X, Y, Z, ORIGIN, SIN, COS, ANGLE, ZERO, ONE, SLOTS = 0, 3, 6, 9, 12, 13, 14, 15, 16, 18
"""Rows of the scratch: the moving frame (0 to 11), one joint's angle, constants; from row SLOTS on, a slot a joint."""
CAMERA, ACROSS, DOWN, IMAGE, DEPTH, IMAGE_SLOTS = 18, 30, 33, 36, 38, 39
"""Rows that only images need: the camera's frame, the derivative of the image by the hand's place, the image and the
depth. Of a point in the camera's axes these are the frame's own axes, and all three of its numbers."""
SLOT = 6
"""Rows of a slot: the joint's axis and a point on it, then what they give: its angular and its linear column."""

# pi/2 in two parts (Cody and Waite 1980): the first has so few bits that its multiples up to 2**20 are exact.
_LARGEST_ANGLE = 1.6e6
_LARGEST_NUMBER = 1.7976931348623157e308
_TWO_OVER_PI, _QUARTER, _QUARTER_REST = 0.63661977236758134308, 1.57079632673412561417, 6.07710050650619224932e-11
# Adding and subtracting it rounds to the nearest integer.
_ROUND = 6755399441055744.0
# Minimax polynomials of sine and cosine on [-pi/4, pi/4]: the coefficients of FreeBSD's msun (k_sin.c, k_cos.c).
_S1, _S2, _S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
_S4, _S5, _S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
_C1, _C2, _C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
_C4, _C5, _C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11

# Rows of the scratch of a gradient: rotation and its gradient (by columns), the position's gradient, their torque, a
# running sum, zeros, what nobody needs; then a slot a joint: v, w, the gradients of both, the gradient of its angle.
TURN, OF_TURN, OF_ORIGIN, TORQUE, SUM, NONE, NOBODY, GRADIENT_SLOTS = 0, 9, 18, 21, 24, 27, 28, 29
GRADIENT_SLOT, OF_ANGLE = 13, 12

# no_type_check: a checker that wraps functions would hand numba the wrapper.


@intrinsic
@no_type_check
def _view(typing, array, start, size):
    """``size`` numbers of a C-contiguous array from ``start`` on, flat; the caller keeps the array alive.

    Slices count references, atomically: that took a third of the time. Views also show LLVM what is apart from what.
    """
    flat = types.Array(types.float64, 1, "C")

    def generate(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        view = context.make_array(flat)(context, builder)
        number = context.get_constant(types.intp, 8)
        place = builder.gep(data, [arguments[1]])
        populate_array(view, place, [arguments[2]], [number], number, meminfo=None, parent=None)
        return view._getvalue()

    return flat(array, types.intp, types.intp), generate


@compiled
@no_type_check
def _not_finite(q, first, count):
    """How many values of these postures are NaN or infinite."""
    n = q.shape[1]
    values = _view(q, first * n, count * n)
    found = 0
    for i in range(count * n):
        found += not (abs(values[i]) <= _LARGEST_NUMBER)
    return found


@compiled
@no_type_check
def _sines(s, sin_phase, cos_phase):
    """Rows SIN and COS: of the angle in row ANGLE [rad] plus the phase, to about one unit in the last place."""
    beyond = 0
    for i in range(L):
        x = s[ANGLE * L + i]
        beyond += not (abs(x) <= _LARGEST_ANGLE)
        quarters = (x * _TWO_OVER_PI + _ROUND) - _ROUND
        r = (x - quarters * _QUARTER) - quarters * _QUARTER_REST
        z = r * r
        sine = r + r * z * (_S1 + z * (_S2 + z * (_S3 + z * (_S4 + z * (_S5 + z * _S6)))))
        half = 0.5 * z
        near = 1.0 - half
        rest = z * z * (_C1 + z * (_C2 + z * (_C3 + z * (_C4 + z * (_C5 + z * _C6)))))
        cosine = near + (((1.0 - near) - half) + rest)
        # Which quarter, without integers: not every processor converts them in vectors.
        halves = (0.5 * quarters - 0.25 + _ROUND) - _ROUND
        swap = quarters - 2.0 * halves
        sign = 1.0 - 2.0 * (halves - 2.0 * ((0.5 * halves - 0.25 + _ROUND) - _ROUND))
        a = sign * (cosine if swap != 0.0 else sine)
        b = sign * (-sine if swap != 0.0 else cosine)
        s[SIN * L + i] = a * cos_phase + b * sin_phase
        s[COS * L + i] = b * cos_phase - a * sin_phase
    if beyond:
        for i in range(L):
            x = s[ANGLE * L + i]
            if not (abs(x) <= _LARGEST_ANGLE):
                a, b = math.sin(x), math.cos(x)
                s[SIN * L + i] = a * cos_phase + b * sin_phase
                s[COS * L + i] = b * cos_phase - a * sin_phase


@compiled
@no_type_check
def _step(s, c):
    """Turn the moving frame about z by rows SIN and COS, then translate and tilt it."""
    tx, ty, tz, st, ct = c[STEP_X], c[STEP_Y], c[STEP_Z], c[SIN_TILT], c[COS_TILT]
    for i in range(L):
        sine, cosine = s[SIN * L + i], s[COS * L + i]
        x0, x1, x2 = s[i], s[L + i], s[2 * L + i]
        y0, y1, y2 = s[3 * L + i], s[4 * L + i], s[5 * L + i]
        z0, z1, z2 = s[6 * L + i], s[7 * L + i], s[8 * L + i]
        a0, a1, a2 = cosine * x0 + sine * y0, cosine * x1 + sine * y1, cosine * x2 + sine * y2
        b0, b1, b2 = cosine * y0 - sine * x0, cosine * y1 - sine * x1, cosine * y2 - sine * x2
        s[i], s[L + i], s[2 * L + i] = a0, a1, a2
        s[3 * L + i], s[4 * L + i], s[5 * L + i] = ct * b0 + st * z0, ct * b1 + st * z1, ct * b2 + st * z2
        s[6 * L + i], s[7 * L + i], s[8 * L + i] = ct * z0 - st * b0, ct * z1 - st * b1, ct * z2 - st * b2
        s[9 * L + i] += tx * a0 + ty * b0 + tz * z0
        s[10 * L + i] += tx * a1 + ty * b1 + tz * z1
        s[11 * L + i] += tx * a2 + ty * b2 + tz * z2


@compiled
@no_type_check
def _run(q, first, count, constants, joints, scratch, slots):
    """Run along a chain: the moving frame ends at the link, every joint's axis and origin are in its slot."""
    s = _view(scratch, 0, SLOTS * L)
    n = q.shape[1]
    flat = _view(q, 0, q.size)
    for i in range(ORIGIN + 3):
        for k in range(L):
            s[i * L + k] = constants[0, i]
    for j in range(joints.shape[0]):
        c = _view(constants, (j + 1) * CONSTANTS, CONSTANTS)
        start = first * n + joints[j, COLUMN]
        column = flat[start : start + (count - 1) * n + 1 : n]
        angle = _view(s, ANGLE * L, L)
        for i in range(count):
            angle[i] = column[i]
        if c[MULTIPLIER] != 1.0 or c[OFFSET] != 0.0:
            for i in range(L):
                angle[i] = c[MULTIPLIER] * angle[i] + c[OFFSET]
        slot = _view(scratch, (slots + SLOT * j) * L, SLOT * L)
        for i in range(SLOT * L):
            slot[i] = s[Z * L + i]
        if joints[j, PRISMATIC]:
            sine, cosine = c[SIN_PHASE], c[COS_PHASE]
            for i in range(L):
                x = s[ANGLE * L + i]
                s[9 * L + i] += x * s[6 * L + i]
                s[10 * L + i] += x * s[7 * L + i]
                s[11 * L + i] += x * s[8 * L + i]
                s[SIN * L + i], s[COS * L + i] = sine, cosine
        else:
            _sines(s, c[SIN_PHASE], c[COS_PHASE])
        _step(s, c)
    sine, cosine = constants[joints.shape[0] + 1, 0], constants[joints.shape[0] + 1, 1]
    if sine != 0.0 or cosine != 1.0:
        for i in range(L):
            x0, x1, x2 = s[i], s[L + i], s[2 * L + i]
            y0, y1, y2 = s[3 * L + i], s[4 * L + i], s[5 * L + i]
            s[i], s[L + i], s[2 * L + i] = cosine * x0 + sine * y0, cosine * x1 + sine * y1, cosine * x2 + sine * y2
            s[3 * L + i], s[4 * L + i] = cosine * y0 - sine * x0, cosine * y1 - sine * x1
            s[5 * L + i] = cosine * y2 - sine * x2


@compiled
@no_type_check
def _column(s, v, prismatic):
    """A slot's axis and origin become the joint's angular and linear column, for the origin of the moving frame."""
    if prismatic:
        for i in range(L):
            v[3 * L + i], v[4 * L + i], v[5 * L + i] = v[i], v[L + i], v[2 * L + i]
            v[i], v[L + i], v[2 * L + i] = 0.0, 0.0, 0.0
    else:
        for i in range(L):
            z0, z1, z2 = v[i], v[L + i], v[2 * L + i]
            d0, d1, d2 = s[9 * L + i] - v[3 * L + i], s[10 * L + i] - v[4 * L + i], s[11 * L + i] - v[5 * L + i]
            v[3 * L + i] = z1 * d2 - z2 * d1
            v[4 * L + i] = z2 * d0 - z0 * d2
            v[5 * L + i] = z0 * d1 - z1 * d0


@compiled
@no_type_check
def _fold(scratch, slots, j, into, multiplier, rows):
    """Scale the first rows of a slot, and add them to another slot's when the joint moves with that one."""
    v = _view(scratch, (slots + SLOT * j) * L, SLOT * L)
    if multiplier != 1.0:
        for i in range(rows * L):
            v[i] *= multiplier
    if into != j:
        w = _view(scratch, (slots + SLOT * into) * L, SLOT * L)
        for i in range(rows * L):
            w[i] += v[i]


@no_type_check
def _transposed(builder, values):
    """Eight vectors of eight, rows for columns: the off-diagonal blocks of 1x1, 2x2, then 4x4 are swapped."""
    values = list(values)
    for width in (1, 2, 4):
        lows = [k if not k & width else 8 + k - width for k in range(8)]
        highs = [k + width if not k & width else 8 + k for k in range(8)]
        masks = [ir.Constant(ir.VectorType(ir.IntType(32), 8), mask) for mask in (lows, highs)]
        for i in range(8):
            if not i & width:
                pair = values[i], values[i + width]
                values[i], values[i + width] = (builder.shuffle_vector(*pair, mask) for mask in masks)
    return values


@no_type_check
def _moves_8x8(into_scratch):
    """An intrinsic that moves eight lanes of eight scratch rows to or from an array of structures.

    The rows begin at rows[row] and so on; the array's numbers are at ``at`` and so on, ``stride`` apart from lane to
    lane. Left to the compiler these 64 numbers move one by one, and moving them is most of a kernel's time.
    """

    @intrinsic
    @no_type_check
    def move(typing, scratch, rows, row, lane, array, at, stride):
        def generate(context, builder, signature, arguments):
            def data(index):
                return context.make_array(signature.args[index])(context, builder, arguments[index]).data

            vector, integer = ir.VectorType(ir.DoubleType(), 8).as_pointer(), ir.IntType(64)
            in_scratch, in_array = [], []
            for i in range(8):
                begin = builder.load(builder.gep(data(1), [builder.add(arguments[2], integer(i))]))
                in_scratch.append(builder.gep(data(0), [builder.add(begin, arguments[3])]))
                in_array.append(
                    builder.gep(data(4), [builder.add(arguments[5], builder.mul(arguments[6], integer(i)))])
                )
            sources, targets = (in_array, in_scratch) if into_scratch else (in_scratch, in_array)
            values = [builder.load(builder.bitcast(place, vector), align=8) for place in sources]
            for value, place in zip(_transposed(builder, values), targets, strict=True):
                builder.store(value, builder.bitcast(place, vector), align=8)
            return context.get_dummy_value()

        integer = types.int64
        return types.void(scratch, rows, integer, integer, array, integer, integer), generate

    return move


_write_8x8, _read_8x8 = _moves_8x8(into_scratch=False), _moves_8x8(into_scratch=True)


@compiled
@no_type_check
def _write(scratch, rows, target, first, count):
    """Each lane of the scratch rows that begin at rows[...] -> what belongs to posture first + lane in the target."""
    size = rows.shape[0]
    flat = _view(target, 0, target.size)
    whole = count - count % 8 if size >= 8 else 0
    for lane in range(0, whole, 8):
        row = 0
        while row < size:
            # The last eight rows may overlap the eight before: some numbers are written twice.
            row = min(row, size - 8)
            _write_8x8(scratch, rows, row, lane, flat, (first + lane) * size + row, size)
            row += 8
    for lane in range(whole, count):
        for row in range(size):
            flat[(first + lane) * size + row] = scratch[rows[row] + lane]


@compiled
@no_type_check
def _read(scratch, rows, source, first, count):
    """The way back of :func:`_write`; several of the rows may be one, for what nobody needs."""
    size = rows.shape[0]
    flat = _view(source, 0, source.size)
    whole = count - count % 8 if size >= 8 else 0
    for lane in range(0, whole, 8):
        row = 0
        while row < size:
            row = min(row, size - 8)
            _read_8x8(scratch, rows, row, lane, flat, (first + lane) * size + row, size)
            row += 8
    for lane in range(whole, count):
        for row in range(size):
            scratch[rows[row] + lane] = flat[(first + lane) * size + row]


@compiled
@no_type_check
def _scratch(rows):
    """Rows of zeros (row ONE of ones) from a multiple of 64 bytes on: vectors across cache lines cost twice."""
    scratch = np.zeros(rows * L + 8)
    skip = (-(scratch.ctypes.data // 8)) % 8
    scratch = scratch[skip : skip + rows * L]
    scratch[ONE * L : (ONE + 1) * L] = 1.0
    return scratch


@compiled
@no_type_check
def pose_and_jacobian(q, constants, joints, pose_rows, jacobian_rows, pose, jacobian):
    """Pose (B, 4, 4) and Jacobian (B, 6, n) of a chain's end, written; float64, C-contiguous, nothing is checked.

    Args:
        q: Postures (B, n).
        constants: (m + 2, CONSTANTS) for the m moving joints of the chain.
        joints: (m, 3).
        pose_rows: (16,) where in the scratch the rows begin that make up a pose.
        jacobian_rows: (6 n,) likewise.
        pose: Written.
        jacobian: Written.

    Returns:
        How many values of q are NaN or infinite, in whatever columns.
    """
    return _pose_blocks(
        q, constants, joints, pose_rows, jacobian_rows, pose, jacobian, _scratch(SLOTS + SLOT * joints.shape[0])
    )


@compiled
@no_type_check
def _pose_blocks(q, constants, joints, pose_rows, jacobian_rows, pose, jacobian, scratch):
    """A function of its own, as the caller keeps the scratch alive while views of it are used."""
    s = _view(scratch, 0, SLOTS * L)
    not_finite = 0
    for first in range(0, q.shape[0], L):
        count = min(L, q.shape[0] - first)
        not_finite += _not_finite(q, first, count)
        _run(q, first, count, constants, joints, scratch, SLOTS)
        _write(scratch, pose_rows, pose, first, count)
        for j in range(joints.shape[0]):
            _column(s, _view(scratch, (SLOTS + SLOT * j) * L, SLOT * L), joints[j, PRISMATIC])
            _fold(scratch, SLOTS, j, joints[j, INTO], constants[j + 1, MULTIPLIER], SLOT)
        _write(scratch, jacobian_rows, jacobian, first, count)
    return not_finite


@compiled
@no_type_check
def _project(s, screen_distance):
    """From the hand (moving frame) and the camera's frame: the image, the depth, the image's derivative by the hand."""
    for i in range(L):
        d0, d1, d2 = s[9 * L + i] - s[27 * L + i], s[10 * L + i] - s[28 * L + i], s[11 * L + i] - s[29 * L + i]
        x0, x1, x2 = s[18 * L + i], s[19 * L + i], s[20 * L + i]
        y0, y1, y2 = s[21 * L + i], s[22 * L + i], s[23 * L + i]
        z0, z1, z2 = s[24 * L + i], s[25 * L + i], s[26 * L + i]
        depth = z0 * d0 + z1 * d1 + z2 * d2
        scale = screen_distance / depth
        x, y = (x0 * d0 + x1 * d1 + x2 * d2) / depth, (y0 * d0 + y1 * d1 + y2 * d2) / depth
        s[30 * L + i], s[31 * L + i], s[32 * L + i] = (
            scale * (x0 - x * z0),
            scale * (x1 - x * z1),
            scale * (x2 - x * z2),
        )
        s[33 * L + i], s[34 * L + i], s[35 * L + i] = (
            scale * (y0 - y * z0),
            scale * (y1 - y * z1),
            scale * (y2 - y * z2),
        )
        s[36 * L + i], s[37 * L + i], s[38 * L + i] = screen_distance * x, screen_distance * y, depth


@compiled
@no_type_check
def _look(s):
    """From the hand (moving frame) and the camera's frame: the point in the camera's axes."""
    for i in range(L):
        d0, d1, d2 = s[9 * L + i] - s[27 * L + i], s[10 * L + i] - s[28 * L + i], s[11 * L + i] - s[29 * L + i]
        for row in range(3):
            a, b, c = s[(18 + 3 * row) * L + i], s[(19 + 3 * row) * L + i], s[(20 + 3 * row) * L + i]
            s[(36 + row) * L + i] = a * d0 + b * d1 + c * d2


@compiled
@no_type_check
def _distort(s, lens):
    """As :func:`_project`, for a pinhole: focal lengths, principal point, k1, k2, p1, p2, k3, and the largest s."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3, most = (
        lens[0],
        lens[1],
        lens[2],
        lens[3],
        lens[4],
        lens[5],
        lens[6],
        lens[7],
        lens[8],
        lens[9],
    )
    for i in range(L):
        d0, d1, d2 = s[9 * L + i] - s[27 * L + i], s[10 * L + i] - s[28 * L + i], s[11 * L + i] - s[29 * L + i]
        x0, x1, x2 = s[18 * L + i], s[19 * L + i], s[20 * L + i]
        y0, y1, y2 = s[21 * L + i], s[22 * L + i], s[23 * L + i]
        z0, z1, z2 = s[24 * L + i], s[25 * L + i], s[26 * L + i]
        depth = z0 * d0 + z1 * d1 + z2 * d2
        u, v = (x0 * d0 + x1 * d1 + x2 * d2) / depth, (y0 * d0 + y1 * d1 + y2 * d2) / depth
        aside = u * u + v * v
        scale = 1.0 + aside * (k1 + aside * (k2 + aside * k3)) + 2.0 * (p1 * v + p2 * u)
        steep = 2.0 * (k1 + aside * (2.0 * k2 + aside * (3.0 * k3)))
        # What has no image becomes NaN, and its Jacobian too.
        scale = scale if depth > 0.0 and aside < most else np.nan
        xu = scale + u * u * steep + 4.0 * p2 * u
        xv = u * v * steep + 2.0 * (p1 * u + p2 * v)
        yv = scale + v * v * steep + 4.0 * p1 * v
        a, b, c = fx * xu / depth, fx * xv / depth, -fx * (xu * u + xv * v) / depth
        s[30 * L + i], s[31 * L + i], s[32 * L + i] = (
            a * x0 + b * y0 + c * z0,
            a * x1 + b * y1 + c * z1,
            a * x2 + b * y2 + c * z2,
        )
        a, b, c = fy * xv / depth, fy * yv / depth, -fy * (xv * u + yv * v) / depth
        s[33 * L + i], s[34 * L + i], s[35 * L + i] = (
            a * x0 + b * y0 + c * z0,
            a * x1 + b * y1 + c * z1,
            a * x2 + b * y2 + c * z2,
        )
        s[36 * L + i] = fx * (u * scale + p2 * aside) + cx
        s[37 * L + i] = fy * (v * scale + p1 * aside) + cy
        s[38 * L + i] = depth


@compiled
@no_type_check
def _move(s, aside, first, count):
    """Move the origin of the moving frame by (B, 3), given in its own axes."""
    for i in range(count):
        a, b, c = aside[first + i, 0], aside[first + i, 1], aside[first + i, 2]
        for row in range(3):
            s[(9 + row) * L + i] += a * s[row * L + i] + b * s[(3 + row) * L + i] + c * s[(6 + row) * L + i]


@compiled
@no_type_check
def _image_column(s, v):
    """The linear column of a slot, as the image shows it, into the slot's first two rows."""
    for i in range(L):
        v0, v1, v2 = v[3 * L + i], v[4 * L + i], v[5 * L + i]
        v[i] = s[30 * L + i] * v0 + s[31 * L + i] * v1 + s[32 * L + i] * v2
        v[L + i] = s[33 * L + i] * v0 + s[34 * L + i] * v1 + s[35 * L + i] * v2


@compiled
@no_type_check
def _point_column(s, v):
    """As :func:`_image_column`, in the camera's axes, into the slot's first three rows."""
    for i in range(L):
        v0, v1, v2 = v[3 * L + i], v[4 * L + i], v[5 * L + i]
        v[i] = s[18 * L + i] * v0 + s[19 * L + i] * v1 + s[20 * L + i] * v2
        v[L + i] = s[21 * L + i] * v0 + s[22 * L + i] * v1 + s[23 * L + i] * v2
        v[2 * L + i] = s[24 * L + i] * v0 + s[25 * L + i] * v1 + s[26 * L + i] * v2


@compiled
@no_type_check
def image_and_jacobian(q, aside, hand, camera, joints, distance, lens, jacobian_rows, image, depth, jacobian):
    """Image (B, m) and depth (B,) of the hand, and the image's Jacobian (B, m, p), written; nothing is checked.

    Without a distance and a lens the image is the hand in the camera's axes itself, m = 3. Each of the three is a
    function of its own to the compiler, and so is each with ``aside``: what is None is left out.

    A joint that carries the camera moves the hand, as seen, like one that carries the hand the other way: its column
    is minus the velocity it would give to the point of the camera's body where the hand is.

    Args:
        q: Postures (B, n).
        aside: (B, 3), from the hand's centre to the observed point, in the hand's link [m]; None: it is the centre.
        hand: Constants of the chain to the hand's centre, (m + 2, CONSTANTS), from where the two chains part.
        camera: Constants of the chain to the camera, (c + 2, CONSTANTS).
        joints: (m + c, 3), the hand's first.
        distance: Of a virtual screen from the optical centre [m], or None.
        lens: (10,) of a pinhole, as :func:`_distort` reads it, or None.
        jacobian_rows: (m p,) where in the scratch the rows begin that make up an image Jacobian.
        image: Written [m on the screen, px or m]; a pinhole's is NaN where there is none.
        depth: Written [m]; a screen's image means nothing where it is not positive.
        jacobian: Written.

    Returns:
        How many values of q are NaN or infinite, in whatever columns.
    """
    scratch = _scratch(IMAGE_SLOTS + SLOT * joints.shape[0])
    return _image_blocks(q, aside, hand, camera, joints, distance, lens, jacobian_rows, image, depth, jacobian, scratch)


@compiled
@no_type_check
def _image_blocks(q, aside, hand, camera, joints, distance, lens, jacobian_rows, image, depth, jacobian, scratch):
    """As :func:`_pose_blocks`."""
    m = hand.shape[0] - 2
    rows = 3
    if distance is not None:
        rows = 2
    if lens is not None:
        rows = 2
    s = _view(scratch, 0, IMAGE_SLOTS * L)
    not_finite = 0
    for first in range(0, q.shape[0], L):
        count = min(L, q.shape[0] - first)
        not_finite += _not_finite(q, first, count)
        _run(q, first, count, camera, joints[m:], scratch, IMAGE_SLOTS + SLOT * m)
        for i in range((ORIGIN + 3) * L):
            s[CAMERA * L + i] = s[i]
        _run(q, first, count, hand, joints[:m], scratch, IMAGE_SLOTS)
        if aside is not None:
            _move(s, aside, first, count)
        if distance is not None:
            _project(s, distance)
        elif lens is not None:
            _distort(s, lens)
        else:
            _look(s)
        for j in range(joints.shape[0]):
            v = _view(scratch, (IMAGE_SLOTS + SLOT * j) * L, SLOT * L)
            _column(s, v, joints[j, PRISMATIC])
            if rows == 2:
                _image_column(s, v)
            else:
                _point_column(s, v)
            multiplier = hand[j + 1, MULTIPLIER] if j < m else -camera[j - m + 1, MULTIPLIER]
            _fold(scratch, IMAGE_SLOTS, j, joints[j, INTO], multiplier, rows)
        for i in range(count):
            image[first + i, 0], image[first + i, 1] = s[IMAGE * L + i], s[(IMAGE + 1) * L + i]
            depth[first + i] = s[DEPTH * L + i]
        if rows == 3:
            for i in range(count):
                image[first + i, 2] = s[DEPTH * L + i]
        _write(scratch, jacobian_rows, jacobian, first, count)
    return not_finite


@compiled
@no_type_check
def gradient(pose, jacobian, of_pose, of_jacobian, pose_rows, of_pose_rows, jacobian_rows, result_rows, count, result):
    """What a gradient of pose and Jacobian makes of q (B, n), written; float64, C-contiguous, nothing is checked.

    Args:
        pose: (B, 4, 4).
        jacobian: (B, 6, n), local_world_aligned.
        of_pose: Gradient of the pose, (B, 4, 4), or (0, 4, 4): none.
        of_jacobian: Gradient of the Jacobian, (B, 6, n), or (0, 6, n): none.
        pose_rows: (16,) where in the scratch the rows begin into which a pose goes.
        of_pose_rows: (16,) likewise.
        jacobian_rows: (2, 6 n) likewise, for the Jacobian and its gradient.
        result_rows: (n,) likewise, for the result.
        count: How many joints are on the path.
        result: Written.
    """
    scratch = _scratch(GRADIENT_SLOTS + GRADIENT_SLOT * count)
    scratch[NONE * L : (NONE + 1) * L] = 0.0
    _gradient_blocks(
        pose,
        jacobian,
        of_pose,
        of_jacobian,
        pose_rows,
        of_pose_rows,
        jacobian_rows,
        result_rows,
        count,
        result,
        scratch,
    )


@compiled
@no_type_check
def _gradient_blocks(
    pose, jacobian, of_pose, of_jacobian, pose_rows, of_pose_rows, jacobian_rows, result_rows, joints, result, scratch
):
    """As :func:`_pose_blocks`."""
    batch = result.shape[0]
    s = _view(scratch, 0, GRADIENT_SLOTS * L)
    for first in range(0, batch, L):
        count = min(L, batch - first)
        _read(scratch, jacobian_rows[0], jacobian, first, count)
        for i in range(6 * L):
            s[TORQUE * L + i] = 0.0
        if of_pose.shape[0] > 0:
            _read(scratch, pose_rows, pose, first, count)
            _read(scratch, of_pose_rows, of_pose, first, count)
            for c in range(3):
                x = _view(scratch, (TURN + 3 * c) * L, 3 * L)
                g = _view(scratch, (OF_TURN + 3 * c) * L, 3 * L)
                _add_cross(_view(scratch, TORQUE * L, 3 * L), x, g)
            for j in range(joints):
                slot = (GRADIENT_SLOTS + GRADIENT_SLOT * j) * L
                angle = _view(scratch, slot + OF_ANGLE * L, L)
                _set_dot(angle, _view(scratch, slot, 3 * L), _view(scratch, OF_ORIGIN * L, 3 * L))
                _add_dot(angle, _view(scratch, slot + 3 * L, 3 * L), _view(scratch, TORQUE * L, 3 * L))
        else:
            for j in range(joints):
                angle = _view(scratch, (GRADIENT_SLOTS + GRADIENT_SLOT * j + OF_ANGLE) * L, L)
                for i in range(L):
                    angle[i] = 0.0
        if of_jacobian.shape[0] > 0:
            _read(scratch, jacobian_rows[1], of_jacobian, first, count)
            total = _view(scratch, SUM * L, 3 * L)
            for j in range(joints):
                slot = (GRADIENT_SLOTS + GRADIENT_SLOT * j) * L
                w, g = _view(scratch, slot + 3 * L, 3 * L), _view(scratch, slot + 6 * L, 3 * L)
                _add_dot(_view(scratch, slot + OF_ANGLE * L, L), _view(scratch, slot, 3 * L), total)
                _add_cross(total, g, w)
            for i in range(3 * L):
                total[i] = 0.0
            for j in range(joints - 1, -1, -1):
                slot = (GRADIENT_SLOTS + GRADIENT_SLOT * j) * L
                v, w = _view(scratch, slot, 3 * L), _view(scratch, slot + 3 * L, 3 * L)
                _add_cross(total, v, _view(scratch, slot + 6 * L, 3 * L))
                _add_dot(_view(scratch, slot + OF_ANGLE * L, L), w, total)
                _add_cross(total, w, _view(scratch, slot + 9 * L, 3 * L))
        _write(scratch, result_rows, result, first, count)


@compiled
@no_type_check
def _add_cross(total, a, b):
    """Total += a x b, three rows each."""
    for i in range(L):
        a0, a1, a2, b0, b1, b2 = a[i], a[L + i], a[2 * L + i], b[i], b[L + i], b[2 * L + i]
        total[i] += a1 * b2 - a2 * b1
        total[L + i] += a2 * b0 - a0 * b2
        total[2 * L + i] += a0 * b1 - a1 * b0


@compiled
@no_type_check
def _set_dot(total, a, b):
    """Total = a . b, of three rows each."""
    for i in range(L):
        total[i] = a[i] * b[i] + a[L + i] * b[L + i] + a[2 * L + i] * b[2 * L + i]


@compiled
@no_type_check
def _add_dot(total, a, b):
    """Total += a . b."""
    for i in range(L):
        total[i] += a[i] * b[i] + a[L + i] * b[L + i] + a[2 * L + i] * b[2 * L + i]
