"""Singular values and row spaces of many small matrices, with closed forms for two rows.

LAPACK takes a microsecond or two a matrix. An image has two axes more often than not, and then Gram-Schmidt on the two
rows, the longer one first, gives the same to rounding in a tenth of the time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

_EPS = float(np.finfo(np.float64).eps)


class RowSpace(NamedTuple):
    """The row spaces of some matrices (batch, m, p), k = min(m, p).

    Attributes:
        singular_values: Descending; exactly zero where zero to rounding (max(m, p) eps of the greatest).
        basis: Orthonormal rows that span the row space of a matrix of rank k; of no use for the others.
    """

    singular_values: Float[np.ndarray, "batch k"]
    basis: Float[np.ndarray, "batch k p"]


def row_space(matrices: Float[np.ndarray, "batch m p"]) -> RowSpace:
    """Singular values and an orthonormal basis of the rows of each."""
    if matrices.shape[-2] == 2 <= matrices.shape[-1]:
        values, basis = _two_rows(matrices)
    else:
        _, values, basis = np.linalg.svd(matrices, full_matrices=False)
    zero = max(matrices.shape[-2:]) * _EPS * values[:, :1]
    return RowSpace(np.where(values > zero, values, 0), basis)


def singular_values(matrices: Float[np.ndarray, "batch m p"]) -> Float[np.ndarray, "batch k"]:
    """Singular values of each, descending."""
    if matrices.shape[-2] == 2 <= matrices.shape[-1]:
        return _two_rows(matrices)[0]
    return np.asarray(np.linalg.svd(matrices, compute_uv=False))


def _dot(a: Float[np.ndarray, "batch p"], b: Float[np.ndarray, "batch p"]) -> Float[np.ndarray, "batch 1"]:
    return np.asarray(np.einsum("np,np->n", a, b)[:, None])


def _two_rows(
    matrices: Float[np.ndarray, "batch 2 p"],
) -> tuple[Float[np.ndarray, "batch 2"], Float[np.ndarray, "batch 2 p"]]:
    a, b = matrices[:, 0], matrices[:, 1]
    a_longer = _dot(a, a) >= _dot(b, b)
    longer, shorter = np.where(a_longer, a, b), np.where(a_longer, b, a)
    length = np.sqrt(_dot(longer, longer))
    first = longer / np.where(length > 0, length, 1)
    along = _dot(shorter, first)
    across = shorter - along * first
    # Once more: the first pass leaves a rounding error along `first` as large as what remains of nearly parallel rows.
    across = across - _dot(across, first) * first
    height = np.sqrt(_dot(across, across))
    second = across / np.where(height > 0, height, 1)
    # The rows are now [[length, 0], [along, height]], whose determinant has lost no digits to cancellation.
    sums, differences = length**2 + along**2 + height**2, length**2 - along**2 - height**2
    greatest = np.sqrt((sums + np.hypot(differences, 2 * length * along)) / 2)
    least = length * height / np.where(greatest > 0, greatest, 1)
    return np.concatenate([greatest, least], axis=1), np.stack([first, second], axis=1)
