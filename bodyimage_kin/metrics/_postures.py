"""The formulas behind ``jacobian.py``, over some tens of thousands of postures at a time.

One pass serves any number of scores: whitening and the row spaces are shared among them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodyimage_kin._arrays import ArrayLike, Floats, as_pair
from bodyimage_kin.metrics._row_space import RowSpace, row_space, singular_values
from bodyimage_kin.metrics._whitening import Metric, metric_root, ratio

CHUNK = 1 << 16  # postures at a time, so that temporaries stay in the tens of megabytes


@dataclass(frozen=True, eq=False)
class Pairs:
    """Some postures' true and estimated Jacobians (postures, m, p), raw and whitened.

    Both are zero where either is not finite: that adds nothing to a sum, and a true Jacobian of zero has no score.
    """

    raw_true: Floats
    raw_estimated: Floats
    J: Floats
    Jh: Floats

    @cached_property
    def row_spaces(self) -> tuple[RowSpace, RowSpace]:
        """What the singular scores need of the whitened Jacobians, true and estimated."""
        return row_space(self.J), row_space(self.Jh)


def chunks(true: Floats, estimated: Floats, root: Floats | None) -> Iterator[tuple[slice, Pairs]]:
    """The postures, flattened, a bounded number at a time."""
    m, p = true.shape[-2:]
    true, estimated = true.reshape(-1, m, p), estimated.reshape(-1, m, p)
    for start in range(0, len(true), CHUNK):
        place = slice(start, start + CHUNK)
        raw = true[place], estimated[place]
        finite = np.isfinite(raw[0]).all((-1, -2)) & np.isfinite(raw[1]).all((-1, -2))
        if not finite.all():
            raw = np.where(finite[:, None, None], raw[0], 0), np.where(finite[:, None, None], raw[1], 0)
        J, Jh = raw if root is None else ((a.reshape(-1, p) @ root).reshape(-1, m, p) for a in raw)
        yield place, Pairs(*raw, J, Jh)


def _inner(A: Floats, B: Floats) -> Floats:
    return np.asarray(np.einsum("nij,nij->n", A, B))


def _relative_error(pairs: Pairs) -> Floats:
    E = pairs.Jh - pairs.J
    return np.asarray(np.sqrt(ratio(_inner(E, E), _inner(pairs.J, pairs.J))))


def _axis_relative_error(pairs: Pairs) -> Floats:
    return ratio(np.linalg.norm(pairs.Jh - pairs.J, axis=-1), np.linalg.norm(pairs.J, axis=-1))


def _scale_free_error(pairs: Pairs) -> Floats:
    sizes = _inner(pairs.Jh, pairs.Jh) * _inner(pairs.J, pairs.J)
    return np.asarray((1 - ratio(_inner(pairs.Jh, pairs.J) ** 2, sizes)).clip(min=0))


def _column_cosine(pairs: Pairs) -> Floats:
    sizes = np.linalg.norm(pairs.raw_true, axis=-2) * np.linalg.norm(pairs.raw_estimated, axis=-2)
    return np.asarray(ratio((pairs.raw_true * pairs.raw_estimated).sum(-2), sizes).clip(-1, 1))


def _column_log_norm_ratio(pairs: Pairs) -> Floats:
    return np.asarray(
        np.log(ratio(np.linalg.norm(pairs.raw_estimated, axis=-2), np.linalg.norm(pairs.raw_true, axis=-2)))
    )


def _singular_value_ratios(pairs: Pairs) -> Floats:
    S, Sh = (space.singular_values for space in pairs.row_spaces)
    return ratio(Sh, S)


def _log_condition_difference(pairs: Pairs) -> Floats:
    S, Sh = (space.singular_values for space in pairs.row_spaces)
    # The true condition number must exist; that of an estimate that lost rank is infinite.
    return np.asarray(np.log(Sh[:, 0] / Sh[:, -1]) - np.log(ratio(S[:, 0], S[:, -1])))


def _manipulability_ratio(pairs: Pairs) -> Floats:
    S, Sh = (space.singular_values for space in pairs.row_spaces)
    return ratio(Sh.prod(-1), S.prod(-1))


def _row_space_angles(pairs: Pairs) -> Floats:
    space, estimated = pairs.row_spaces
    overlap = estimated.basis @ space.basis.swapaxes(-1, -2)
    # Sines tell small angles apart, cosines large ones; together they are exact everywhere.
    cosines = singular_values(overlap)
    sines = singular_values(estimated.basis - overlap @ space.basis)
    full_rank = (space.singular_values[:, -1:] > 0) & (estimated.singular_values[:, -1:] > 0)
    return np.where(full_rank, np.arctan2(sines[:, ::-1], cosines), np.nan)


@dataclass(frozen=True)
class Score:
    """A score of each posture: its formula, what axes it has beside the batch, and how it is labelled."""

    of: Callable[[Pairs], Floats]
    dims: tuple[str, ...]
    long_name: str
    units: str = "1"


SCORES = {
    "relative_error": Score(_relative_error, (), "|E W^1/2| / |J W^1/2|"),
    "axis_relative_error": Score(_axis_relative_error, ("axis",), "|E W^1/2| / |J W^1/2| of each row"),
    "scale_free_error": Score(_scale_free_error, (), "1 - <Jh, J>^2 / (|Jh|^2 |J|^2)"),
    "column_cosine": Score(_column_cosine, ("joint",), "cosine between true and estimated column"),
    "column_log_norm_ratio": Score(_column_log_norm_ratio, ("joint",), "log(|estimated column| / |true column|)"),
    "singular_value_ratios": Score(
        _singular_value_ratios, ("direction",), "estimated / true singular values of J W^1/2"
    ),
    "log_condition_difference": Score(_log_condition_difference, (), "log cond(Jh W^1/2) - log cond(J W^1/2)"),
    "manipulability_ratio": Score(_manipulability_ratio, (), "sqrt(det(Jh W Jh') / det(J W J'))"),
    "row_space_angles": Score(
        _row_space_angles, ("direction",), "principal angles of the row spaces of J W^1/2", "rad"
    ),
}


@np.errstate(all="ignore")
def per_posture(names: Sequence[str], true: ArrayLike, estimated: ArrayLike, metric: Metric) -> dict[str, Floats]:
    """The named scores, in the batch shape of the Jacobians followed by their own."""
    J, Jh = as_pair(true, estimated, ("true", "estimated"), ndim=2)
    *batch, m, p = J.shape
    root = metric_root(metric, p)
    sizes = {"axis": m, "joint": p, "direction": min(m, p)}
    found = {name: np.empty((int(np.prod(batch)), *(sizes[d] for d in SCORES[name].dims))) for name in names}
    for place, pairs in chunks(J, Jh, root):
        for name, values in found.items():
            values[place] = SCORES[name].of(pairs)
    return {name: values.reshape((*batch, *values.shape[1:])) for name, values in found.items()}
