"""Maximum a posteriori by least squares: evidence, a Gaussian prior, and what remains unknown afterwards.

The cost is ``sum rho(|r / sigma|^2) + |theta / sd|^2`` over observations r of every term, with ``rho(s) = c^2 log(1 +
s / c^2)`` (Cauchy, c = 3) or ``rho(s) = s``. A term whose noise nobody stated has it estimated from its own residuals,
by median, until that settles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Bool, Float

from bodyimage_kin._shown import Shown
from bodyimage_kin.estimators._products import products

__all__ = ["Fit", "Term", "maximum_a_posteriori"]

CAUCHY = 3.0
"""Residuals beyond so many standard deviations begin to lose their weight."""
_ROUNDS = 12
_TOLERANCE = 1e-10
"""Of the descent: relative change of cost and parameters."""
_SETTLED = 0.01
_TO_SIGMA = 1.4826
"""Standard deviation of a normal variable over the median of its absolute value."""
_CONDITION = 1e-12
"""Least reciprocal condition of ``J' J`` under which rounding in it does not matter to a descent."""
_ROUNDING = 1e-12
"""Least noise that is assumed, over the size of the observations: below it nothing is left to explain."""


@runtime_checkable
class Term(Protocol):
    """One kind of evidence."""

    @property
    def name(self) -> str:
        """What it is."""
        ...

    @property
    def q(self) -> Float[np.ndarray, "count p"]:
        """The postures in which it was observed [rad or m]."""
        ...

    @property
    def sigma(self) -> float | None:
        """Standard deviation of its noise in each coordinate [its unit]; None: unknown."""
        ...

    @property
    def size(self) -> float:
        """Of its observations [its unit], to tell rounding from noise."""
        ...

    def residual(
        self, theta: Float[np.ndarray, "parameters"]
    ) -> tuple[Float[np.ndarray, "count m"], Float[np.ndarray, "count m parameters"]]:
        """Predicted less observed [its unit], and the derivative in all parameters."""
        ...

    def taken(self, rows: Bool[np.ndarray, "count"]) -> Term:
        """The same evidence with some of its rows."""
        ...


@dataclass(frozen=True, eq=False)
class Fit(Shown):
    """Where the posterior has its mode, and how wide it is there.

    Attributes:
        theta: (parameters,) all of them; those that are held keep their start.
        free: (parameters,) which were fitted.
        sd: (parameters,) of the prior; inf where there is none.
        covariance: (parameters, parameters) of the posterior, zero where held.
        information: (parameters, parameters) of the evidence alone, ``J' W J``.
        sigma: Standard deviation of each term's noise, stated or estimated [its unit].
        residuals: (count, m) of each term at the mode [its unit].
        slopes: (count, m, parameters) their derivatives.
        chi2: Reduced chi-square of all terms, by the noise that was stated or estimated.
        cost: At the mode.
        stated: Whether every term's noise was stated.
    """

    theta: Float[np.ndarray, "parameters"]
    free: Bool[np.ndarray, "parameters"]
    sd: Float[np.ndarray, "parameters"]
    covariance: Float[np.ndarray, "parameters parameters"]
    information: Float[np.ndarray, "parameters parameters"]
    sigma: tuple[float, ...]
    residuals: tuple[Float[np.ndarray, "_ _"], ...]
    slopes: tuple[Float[np.ndarray, "_ _ parameters"], ...]
    chi2: float
    cost: float
    stated: bool


def maximum_a_posteriori(
    terms: Sequence[Term],
    *,
    free: Bool[np.ndarray, "parameters"],
    sd: Float[np.ndarray, "parameters"],
    start: Float[np.ndarray, "parameters"] | None = None,
    robust: bool = True,
    steps: int = 100,
) -> Fit:
    """The most probable parameters.

    Args:
        terms: The evidence.
        free: Which parameters are fitted.
        sd: Standard deviation of the prior about zero; inf: none.
        start: Where to begin; None: zero.
        robust: Cauchy's cost, else squares.
        steps: Most steps of descent for each guess of the noise.
    """
    theta = np.zeros(len(sd)) if start is None else np.array(start, dtype=np.float64)
    latest = _Latest(terms)
    # A noise to begin with: stated, else so large that the start explains all, which lets the prior speak first.
    guessed = _noises(latest, theta, 0)
    for _ in range(_ROUNDS):
        theta, cost = _descend(latest, guessed, free, sd, theta, robust, steps)
        again = _noises(latest, theta, int(free.sum()))
        settled = all(abs(new - old) <= _SETTLED * old for new, old in zip(again, guessed, strict=True))
        guessed = again
        if settled:
            break
    return _widths(latest, guessed, free, sd, theta, cost, robust)


def _descend(
    latest: _Latest,
    sigma: Sequence[float],
    free: Bool[np.ndarray, "parameters"],
    sd: Float[np.ndarray, "parameters"],
    start: Float[np.ndarray, "parameters"],
    robust: bool,
    steps: int,
) -> tuple[Float[np.ndarray, "parameters"], float]:
    limited = free & np.isfinite(sd)
    scale = np.where(np.isfinite(sd), sd, 1.0)[free]
    prior = np.zeros((int(limited.sum()), len(sd)))
    prior[np.arange(len(prior)), np.flatnonzero(limited)] = 1.0 / sd[limited]
    known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def parts(theta: Float[np.ndarray, "parameters"]) -> list[tuple[np.ndarray, np.ndarray]]:
        found = [(prior @ theta, prior)]
        for (r, J), width in zip(latest.at(theta), sigma, strict=True):
            r, J = _weighted(r / width, J, width, robust)
            found.append((r.ravel(), J.reshape(r.size, -1)))
        return found

    if not free.any():
        return start, 0.5 * sum(float(r @ r) for r, _ in parts(start))

    def at(values: Float[np.ndarray, "free"]) -> tuple[np.ndarray, np.ndarray]:
        key = values.tobytes()
        if key not in known:
            known.clear()
            theta = start.copy()
            theta[free] = values
            known[key] = _reduced(parts(theta), free)
        return known[key]

    def remaining(values: Float[np.ndarray, "free"]) -> np.ndarray:
        return at(values)[0]

    def derivative(values: Float[np.ndarray, "free"]) -> np.ndarray:
        return at(values)[1]

    end = scipy.optimize.least_squares(
        remaining,
        start[free],
        derivative,
        x_scale=scale,
        max_nfev=steps,
        xtol=_TOLERANCE,
        ftol=_TOLERANCE,
        gtol=_TOLERANCE,
    )
    theta = start.copy()
    theta[free] = end.x
    return theta, float(end.cost)


class _Latest:
    """What remains of all terms, with derivatives, where it was asked for last."""

    def __init__(self, terms: Sequence[Term]) -> None:
        self.terms = tuple(terms)
        self._key = b""
        self._found: tuple[tuple[np.ndarray, np.ndarray], ...] = ()

    def at(self, theta: Float[np.ndarray, "parameters"]) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        if theta.tobytes() != self._key:
            self._found = tuple(term.residual(theta) for term in self.terms)
            self._key = theta.tobytes()
        return self._found


def _reduced(
    parts: Sequence[tuple[Float[np.ndarray, "_"], Float[np.ndarray, "_ parameters"]]],
    free: Bool[np.ndarray, "parameters"],
) -> tuple[Float[np.ndarray, "few"], Float[np.ndarray, "few free"]]:
    """As few rows as have the same ``|r|``, ``J' r`` and ``J' J``, all that a descent asks for.

    The triangle of a QR decomposition of all rows with r as their last column; where rounding allows, by Cholesky's
    decomposition of ``J' J``, which is several times faster. There its columns have length one first.
    """
    within = np.ix_(free, free)
    square = sum((J.T @ J)[within] for _, J in parts)
    length = np.sqrt(np.diag(square))
    if length.all():
        inverse = 1.0 / length
        equal = square * np.outer(inverse, inverse)
        triangle, failed = scipy.linalg.lapack.dpotrf(equal)
        if not failed and scipy.linalg.lapack.dpocon(triangle, np.abs(equal).sum(0).max())[0] > _CONDITION:
            gradient = sum(J.T @ r for r, J in parts)[free]
            few = scipy.linalg.solve_triangular(triangle, gradient * inverse, trans=1)
            rest = max(sum(float(r @ r) for r, _ in parts) - float(few @ few), 0.0)
            return np.append(few, np.sqrt(rest)), np.vstack([triangle * length, np.zeros(len(few))])
    rows = np.concatenate([np.column_stack([J[:, free], r]) for r, J in parts])
    triangle = np.linalg.qr(rows, mode="r")
    triangle = np.vstack([triangle, np.zeros((rows.shape[1] - len(triangle), rows.shape[1]))])
    return triangle[:, -1], triangle[:, :-1]


def _weighted(
    r: Float[np.ndarray, "count m"], J: Float[np.ndarray, "count m parameters"], width: float, robust: bool
) -> tuple[Float[np.ndarray, "count m"], Float[np.ndarray, "count m parameters"]]:
    """Residuals whose square is rho, and their derivative: ``f = r sqrt(rho(s) / s)`` with ``s = |r|^2``.

    Args:
        r: Over the noise.
        J: Of residuals that are not yet over the noise.
        width: The noise.
        robust: Whether rho is Cauchy's, else s.
    """
    if not robust:
        return r, J / width
    s = (r**2).sum(1) / CAUCHY**2
    # For small s: rho / s = 1 - s / 2 + ..., and its derivative -1 / 2.
    small = s < 1e-6
    safe = np.where(small, 1.0, s)
    share = np.where(small, 1.0 - s / 2, np.log1p(safe) / safe)
    slope = np.where(small, -0.5 + 2 * s / 3, (1.0 / (1.0 + safe) - share) / safe)
    weight = np.sqrt(share)
    # Each row of J by one small matrix: weight + slope / weight r r' / c^2.
    mixed = (slope / (weight * CAUCHY**2 * width))[:, None, None] * r[:, :, None] * r[:, None, :]
    mixed += (weight / width)[:, None, None] * np.eye(r.shape[1])
    return weight[:, None] * r, products(mixed, J)


def _noises(latest: _Latest, theta: Float[np.ndarray, "parameters"], free: int) -> list[float]:
    """Stated, else by the median of absolute residuals, what the fit itself takes of them given back."""
    found = []
    for index, term in enumerate(latest.terms):
        if term.sigma is not None:
            found.append(term.sigma)
            continue
        residual = latest.at(theta)[index][0]
        left = max(residual.size - free, 1)
        width = _TO_SIGMA * float(np.median(np.abs(residual))) * np.sqrt(residual.size / left)
        found.append(max(width, _ROUNDING * term.size))
    return found


def _widths(
    latest: _Latest,
    sigma: Sequence[float],
    free: Bool[np.ndarray, "parameters"],
    sd: Float[np.ndarray, "parameters"],
    theta: Float[np.ndarray, "parameters"],
    cost: float,
    robust: bool,
) -> Fit:
    information = np.zeros((len(sd), len(sd)))
    residuals, slopes, total, count = [], [], 0.0, 0
    for (r, J), width in zip(latest.at(theta), sigma, strict=True):
        s = (r**2).sum(1) / width**2
        # What an observation still weighs: rho'(s).
        weight = 1.0 / (1.0 + s / CAUCHY**2) if robust else np.ones(len(s))
        rows = (np.sqrt(weight)[:, None, None] * J).reshape(r.size, -1)
        information += rows.T @ rows / width**2
        total, count = total + float((weight * s).sum()), count + r.size
        residuals.append(r)
        slopes.append(J)
    chi2 = total / max(count - int(free.sum()), 1)
    precision = information + np.diag(np.where(np.isfinite(sd), sd, np.inf) ** -2.0)
    covariance = np.zeros_like(information)
    if free.any():
        within = np.ix_(free, free)
        scale = np.where(np.isfinite(sd), sd, 1.0)[free]
        # In units of the prior, so that radians and metres are inverted alike.
        covariance[within] = np.linalg.pinv(precision[within] * np.outer(scale, scale), hermitian=True) * np.outer(
            scale, scale
        )
    stated = all(term.sigma is not None for term in latest.terms)
    return Fit(
        theta, free, sd, covariance, information, tuple(sigma), tuple(residuals), tuple(slopes), chi2, cost, stated
    )
