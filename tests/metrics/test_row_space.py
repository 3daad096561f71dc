"""The closed form for two rows against LAPACK."""

import numpy as np
import pytest

from bodyimage_kin.metrics._row_space import row_space, singular_values

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("p", [2, 3, 5, 20])
@pytest.mark.parametrize("scale", [1e-100, 1.0, 1e100])
@pytest.mark.parametrize("gap", [1.0, 1e-4, 1e-8, 1e-12])
@pytest.mark.parametrize("lengths", [(1.0, 1.0), (1e-6, 1.0), (1.0, 1e-6)])
def test_two_rows_are_decomposed_as_by_lapack(p, scale, gap, lengths):
    a, b = RNG.normal(size=(2, 50, p))
    matrices = scale * np.stack([lengths[0] * a, lengths[1] * (a + gap * b)], axis=1)
    found, (expected, rows) = row_space(matrices), np.linalg.svd(matrices, full_matrices=False)[1:]
    greatest = expected[:, :1]
    np.testing.assert_allclose(found.singular_values / greatest, expected / greatest, atol=5e-15)
    np.testing.assert_allclose(singular_values(matrices) / greatest, expected / greatest, atol=5e-15)
    np.testing.assert_allclose(
        found.basis @ found.basis.swapaxes(-1, -2), np.broadcast_to(np.eye(2), (50, 2, 2)), atol=1e-14
    )
    # The space itself is known to rounding over its narrowness.
    outside = rows - rows @ found.basis.swapaxes(-1, -2) @ found.basis
    assert (np.abs(outside).max((-1, -2)) * expected[:, 1] <= 1e-14 * greatest[:, 0]).all()


@pytest.mark.parametrize("rows", [[[0, 0, 0], [0, 0, 0]], [[1, 2, 3], [0, 0, 0]], [[0, 0, 0], [1, 2, 3]]])
def test_lost_rank_is_exactly_zero(rows):
    values = row_space(np.array([rows], dtype=float)).singular_values
    np.testing.assert_allclose(values, [[np.linalg.norm(rows), 0]])
    assert values[0, 1] == 0


def test_parallel_rows_have_rank_one():
    rows = RNG.normal(size=(500, 1, 5)) * RNG.normal(size=(500, 2, 1))
    assert (row_space(rows).singular_values[:, 1] == 0).all()
    assert (row_space(np.concatenate([rows, rows], axis=1)).singular_values[:, 1:] == 0).all()
