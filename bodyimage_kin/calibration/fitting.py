"""Fitting a body to what was observed of it."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Literal, get_args

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from bodyimage_kin import _checks
from bodyimage_kin.body import Embodiment
from bodyimage_kin.calibration.calibrated import Calibrated, HeldOut
from bodyimage_kin.calibration.prior import Prior
from bodyimage_kin.calibration.problem import Observed, Problem
from bodyimage_kin.errors import InvalidConfig, InvalidRecording
from bodyimage_kin.estimators.map_fit import Fit, maximum_a_posteriori
from bodyimage_kin.estimators.parametric import Group

__all__ = ["calibrate", "halves"]

_NUISANCE: tuple[Group, ...] = ("tracker", "plane")
"""Where a tracker or a plane stands is nobody's question, and always free."""
_DEFAULT: tuple[Group, ...] = ("axes", "offsets", "hand", "skin", *_NUISANCE)
_ORDER: tuple[Group, ...] = ("hand", "skin", "encoders", "camera", "intrinsics", "offsets", "axes")
"""Groups that ``free="auto"`` tries."""
_GAIN = 0.05
"""Share by which a group must lower the held-out error to be freed."""


def calibrate(
    body: Embodiment,
    observed: xr.Dataset | Observed | Iterable[xr.Dataset | Observed],
    *,
    prior: Prior | None = None,
    free: Sequence[Group] | Literal["auto"] | None = None,
    robust: bool = True,
    folds: int = 5,
) -> Calibrated:
    """The most probable body, given how it is thought to be and what was observed of it.

    Maximum a posteriori: ``sum rho(|r / sigma|^2) + |theta / sd|^2`` over images, a tracker's points, touches of the
    skin and points on planes, with exact derivatives. What is held keeps
    the value it is thought to have. What was held out judges: the fit is repeated without each block in turn.

    Args:
        body: As it is thought to be.
        observed: An experience, or several; an :class:`Observed` says what in it counts, and by which camera.
        prior: How far each measure may be off; None: :class:`Prior`'s defaults.
        free: Groups of parameters that are fitted: ``axes``, ``offsets``, ``encoders``, ``hand``, ``camera``,
            ``intrinsics``, ``skin``. None: axes, offsets, hand and skin. ``"auto"``: one group after the other, the one
            that helps most for each of its numbers first, as long as the held-out error falls. A tracker's frame and a
            plane are always free.
        robust: Cauchy's cost (observations beyond three standard deviations lose weight), else squares.
        folds: Number of blocks that are held out in turn where the recording has none of its own.

    Returns:
        The fit, the body it describes, and what may be asked of both.

    Raises:
        InvalidConfig: A group that does not exist, or recordings of other joints than the body's.
        InvalidRecording: Nothing that tells of the body, or too little to tell the noise as well.
    """
    given = [observed] if isinstance(observed, xr.Dataset | Observed) else list(observed)
    problem = Problem.of(
        body,
        [one if isinstance(one, Observed) else Observed(one) for one in given],
        _checks.whole("folds", folds, least=2),
    )
    prior = prior or Prior()
    if free == "auto":
        groups, held_out = _chosen(problem, prior, robust)
    else:
        groups = _groups(free)
        _require_enough(problem, groups)
        held_out = hold_out(problem, prior, groups, robust)
    nominal = hold_out(problem, prior, (), robust)
    fit = fitted(problem, prior, groups, robust)
    return Calibrated(problem, prior, groups, fit, held_out, nominal, robust)


def halves(calibrated: Calibrated, seed: int = 0) -> tuple[Embodiment, Embodiment]:
    """Two bodies, each fitted to one half of what was observed: how far they differ is how far the body is known.

    Args:
        calibrated: What was fitted to all of it.
        seed: Of the division, at random among the rows of each kind of evidence.

    Raises:
        InvalidRecording: Too little in each half to tell the noise as well.
    """
    problem, rng = calibrated.problem, np.random.default_rng(seed)
    first = [rng.permutation(len(block)) % 2 == 0 for block in problem.blocks]
    found = []
    for kept in (first, [~one for one in first]):
        fit = fitted(problem, calibrated.prior, calibrated.groups, calibrated.robust, kept)
        found.append(calibrated.at(fit.theta))
    return found[0], found[1]


def fitted(
    problem: Problem,
    prior: Prior,
    groups: Sequence[Group],
    robust: bool,
    kept: Sequence[Bool[np.ndarray, "_"]] | None = None,
) -> Fit:
    """The fit of some groups to some of the evidence; None: to all of it."""
    free = _free(problem, groups)
    terms = problem.terms if kept is None else problem.subset(kept)
    return maximum_a_posteriori(terms, free=free, sd=prior.sds(problem.parametric.parameters), robust=robust)


def _free(problem: Problem, groups: Sequence[Group]) -> Bool[np.ndarray, "parameters"]:
    parameters = problem.parametric.parameters
    return np.array(
        [one.group in (*groups, *_NUISANCE) and index not in problem.held for index, one in enumerate(parameters)]
    )


def _require_enough(problem: Problem, groups: Sequence[Group]) -> None:
    """Noise that nobody stated is told by what a fit leaves, and a fit of as many numbers leaves nothing."""
    free = int(_free(problem, groups).sum())
    count = sum(term.residual(np.zeros(len(problem.parametric.parameters)))[0].size for term in problem.terms)
    unknown = [term.name for term in problem.terms if term.sigma is None]
    if unknown and count <= free:
        raise InvalidRecording(
            f"{count} observed coordinates cannot tell {free} measures and the noise of {', '.join(unknown)} as well; "
            "state the noise, free fewer groups, or record more"
        )


def hold_out(problem: Problem, prior: Prior, groups: Sequence[Group], robust: bool) -> HeldOut:
    """Errors of each observation by a fit that did not see its block.

    Raises:
        InvalidRecording: One block alone, so that nothing can be held out.
    """
    blocks = sorted(set(itertools.chain.from_iterable(block.tolist() for block in problem.blocks)))
    if len(blocks) < 2:
        raise InvalidRecording(
            "the recording is one block, so nothing can be held out; give it blocks, or more samples"
        )
    errors = [np.full(len(block), np.nan) for block in problem.blocks]
    for hidden in blocks:
        kept = [block != hidden for block in problem.blocks]
        fit = fitted(problem, prior, groups, robust, kept)
        for term, block, error in zip(problem.terms, problem.blocks, errors, strict=True):
            here = block == hidden
            if here.any():
                error[here] = np.linalg.norm(term.taken(here).residual(fit.theta)[0], axis=1)
    return HeldOut(tuple(errors), problem.blocks)


def _groups(free: Sequence[Group] | str | None) -> tuple[Group, ...]:
    if free is None:
        return _DEFAULT
    if isinstance(free, str):
        raise InvalidConfig(f"free={free!r}: give a list of groups, or 'auto'")
    return tuple(_checks.choice("free", group, get_args(Group)) for group in free)  # type: ignore[misc]


def _chosen(problem: Problem, prior: Prior, robust: bool) -> tuple[tuple[Group, ...], HeldOut]:
    """Frees the group that helps most for each of its numbers, until none lowers the held-out error by :data:`_GAIN`.

    For each number: a group of many that helps a little more than one of few would be chosen first, and keep it out.
    """
    left = [group for group in _ORDER if _numbers(problem, group)]
    groups: tuple[Group, ...] = ()
    best = hold_out(problem, prior, groups, robust)
    while left:
        tried = {group: hold_out(problem, prior, (*groups, group), robust) for group in left}
        ratio = {group: _compared(one, best) for group, one in tried.items()}
        helpful = [group for group in left if ratio[group] <= 1.0 - _GAIN]
        if not helpful:
            break
        group = min(helpful, key=lambda one: np.log(ratio[one]) / _numbers(problem, one))
        groups, best = (*groups, group), tried[group]
        left.remove(group)
    return groups, best


def _numbers(problem: Problem, group: Group) -> int:
    """How many numbers of a group may be freed."""
    parameters = enumerate(problem.parametric.parameters)
    return sum(one.group == group and index not in problem.held for index, one in parameters)


def _compared(one: HeldOut, other: HeldOut) -> float:
    """Geometric mean over kinds of evidence of the ratio of their median held-out errors."""
    ratios: Float[np.ndarray, "terms"] = np.log(np.maximum(one.medians, 1e-300) / np.maximum(other.medians, 1e-300))
    return float(np.exp(ratios.mean()))
