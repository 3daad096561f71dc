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
import scipy.optimize
from jaxtyping import Bool, Float

from bodyimage_kin._shown import Shown

__all__ = ["Fit", "Term", "maximum_a_posteriori"]

CAUCHY = 3.0
"""Residuals beyond so many standard deviations begin to lose their weight."""
_ROUNDS = 12
_TOLERANCE = 1e-10
"""Of the descent: relative change of cost and parameters."""
_SETTLED = 0.01
_TO_SIGMA = 1.4826
"""Standard deviation of a normal variable over the median of its absolute value."""
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
    guessed = [_guess(term, theta) for term in terms]
    for _ in range(_ROUNDS):
        theta, cost = _descend(terms, guessed, free, sd, theta, robust, steps)
        again = [_estimate(term, theta, int(free.sum())) for term in terms]
        settled = all(abs(new - old) <= _SETTLED * old for new, old in zip(again, guessed, strict=True))
        guessed = again
        if settled:
            break
    return _widths(terms, guessed, free, sd, theta, cost, robust)


def _descend(
    terms: Sequence[Term],
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

    def at(values: Float[np.ndarray, "free"]) -> tuple[np.ndarray, np.ndarray]:
        key = values.tobytes()
        if key not in known:
            known.clear()
            theta = start.copy()
            theta[free] = values
            rows, slopes = [prior @ theta], [prior[:, free]]
            for term, width in zip(terms, sigma, strict=True):
                r, J = term.residual(theta)
                r, J = _weighted(r / width, J[:, :, free] / width, robust)
                rows.append(r.ravel())
                slopes.append(J.reshape(r.size, -1))
            known[key] = np.concatenate(rows), np.concatenate(slopes)
        return known[key]

    if not free.any():
        return start, 0.5 * float((at(start[free])[0] ** 2).sum())

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


def _weighted(
    r: Float[np.ndarray, "count m"], J: Float[np.ndarray, "count m free"], robust: bool
) -> tuple[Float[np.ndarray, "count m"], Float[np.ndarray, "count m free"]]:
    """Residuals whose square is rho, and their derivative: ``f = r sqrt(rho(s) / s)`` with ``s = |r|^2``."""
    if not robust:
        return r, J
    s = (r**2).sum(1) / CAUCHY**2
    # For small s: rho / s = 1 - s / 2 + ..., and its derivative -1 / 2.
    small = s < 1e-6
    safe = np.where(small, 1.0, s)
    share = np.where(small, 1.0 - s / 2, np.log1p(safe) / safe)
    slope = np.where(small, -0.5 + 2 * s / 3, (1.0 / (1.0 + safe) - share) / safe)
    weight = np.sqrt(share)
    inner = np.einsum("nm,nmk->nk", r, J) / CAUCHY**2
    f = weight[:, None] * r
    return f, weight[:, None, None] * J + (slope / weight)[:, None, None] * r[:, :, None] * inner[:, None, :]


def _guess(term: Term, theta: Float[np.ndarray, "parameters"]) -> float:
    """A noise to begin with: stated, else so large that the start explains all, which lets the prior speak first."""
    return term.sigma if term.sigma is not None else _estimate(term, theta, 0)


def _estimate(term: Term, theta: Float[np.ndarray, "parameters"], free: int) -> float:
    """Stated, else by the median of absolute residuals, what the fit itself takes of them given back."""
    if term.sigma is not None:
        return term.sigma
    residual = term.residual(theta)[0]
    left = max(residual.size - free, 1)
    width = _TO_SIGMA * float(np.median(np.abs(residual))) * np.sqrt(residual.size / left)
    return max(width, _ROUNDING * term.size)


def _widths(
    terms: Sequence[Term],
    sigma: Sequence[float],
    free: Bool[np.ndarray, "parameters"],
    sd: Float[np.ndarray, "parameters"],
    theta: Float[np.ndarray, "parameters"],
    cost: float,
    robust: bool,
) -> Fit:
    information = np.zeros((len(sd), len(sd)))
    residuals, slopes, total, count = [], [], 0.0, 0
    for term, width in zip(terms, sigma, strict=True):
        r, J = term.residual(theta)
        s = (r**2).sum(1) / width**2
        # What an observation still weighs: rho'(s).
        weight = 1.0 / (1.0 + s / CAUCHY**2) if robust else np.ones(len(s))
        information += np.einsum("nmk,n,nml->kl", J, weight / width**2, J, optimize=True)
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
    stated = all(term.sigma is not None for term in terms)
    return Fit(
        theta, free, sd, covariance, information, tuple(sigma), tuple(residuals), tuple(slopes), chi2, cost, stated
    )
