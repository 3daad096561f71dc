"""Tuning: every estimator gets the same budget of settings, judged on what was seen alone; all of it is recorded.

Candidates fill the space evenly, the same for everybody (:func:`bodyimage_kin.study.spaces.points`); each is judged on
what lies farthest from the rest of what was seen and was hidden from it
(:func:`bodyimage_kin.metrics.held_out.hold_out_far`), in several directions: how far these disagree is part of the
result.
"""

from __future__ import annotations

import inspect
import json
import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bodyimage_kin import _checks
from bodyimage_kin._files import write_json
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidArray, InvalidConfig, InvalidRecording, UnknownName
from bodyimage_kin.estimators import Pairs
from bodyimage_kin.metrics import displacement_error
from bodyimage_kin.metrics.held_out import HeldOut, hold_out_far
from bodyimage_kin.recordings.schema import experience
from bodyimage_kin.study.cells import fit_all
from bodyimage_kin.study.random_streams import stream
from bodyimage_kin.study.spaces import SPACES, checked_space, points
from bodyimage_kin.study.specs import ESTIMATOR, Table, written
from bodyimage_kin.study.store import said
from bodyimage_kin.study.summary import plain_numbers

__all__ = ["Candidate", "Tuned", "read_tuning", "tune", "write_tuning"]

_FORM = {"format": "bodyimage_kin tuning", "version": 2}
_ROUNDING = 1e-6
"""Errors below are of rounding, and count as this."""
_POINTS = 50
"""Points at most for each candidate wanted: a small space has fewer than the budget."""
_CRITERION = (
    "The felt postures of each experience are laid along {draws} directions of joint space, drawn at random. The "
    "farthest quarter along each is hidden once, over all trials and turns, and the tenth beside it is left out; what "
    "is learned from the others is judged on the steps within it by sqrt(sum |displacement(q, dq) - dr|^2 / sum "
    "|dr|^2), at least 1e-6. Score: the geometric mean over directions and experiences; the smallest is chosen, the "
    "first of equals."
)


@dataclass(frozen=True)
class Candidate:
    """Settings that were tried.

    Attributes:
        settings: What the space names; None is the setting's own None.
        errors: Relative displacement error on what was hidden, one an experience and draw; empty after a failure.
        failure: What went wrong; empty when nothing did.
        seconds: CPU time that its fits and their judgement took [s]. No part of equality.
    """

    settings: Mapping[str, Any]
    errors: tuple[tuple[float, ...], ...] = ()
    failure: str = ""
    seconds: float = field(default=0.0, compare=False)

    def score(self, experiences: Sequence[int] | None = None, draws: Sequence[int] | None = None) -> float:
        """Geometric mean of the errors over experiences and draws (by index; None: all); infinite after a failure."""
        rows = [self.errors[index] for index in experiences or range(len(self.errors))] if self.errors else []
        kept = [row[index] for row in rows for index in (draws if draws is not None else range(len(row)))]
        return math.exp(sum(map(math.log, kept)) / len(kept)) if kept else math.inf


@dataclass(frozen=True)
class Tuned:
    """A search and what it chose.

    Attributes:
        chosen: ``{CLASS: settings}``, every setting written out: a spec for a study.
        candidates: Everything that was tried, the default settings first.
        space: What was searched; empty when there is nothing to tune.
        budget: Candidates that were allowed. Fewer are tried only when the space has no more.
        seed: Of the candidates and of the fits.
        draws: Number of directions.
        criterion: How candidates were judged, in words.
    """

    chosen: Table
    candidates: tuple[Candidate, ...]
    space: Table
    budget: int
    seed: int
    draws: int
    criterion: str

    def best(self, experiences: Sequence[int] | None = None, draws: Sequence[int] | None = None) -> Candidate:
        """The candidate with the smallest score over these experiences and draws (by index); None: all, as chosen."""
        return min(self.candidates, key=lambda candidate: candidate.score(experiences, draws))

    def by_draw(self, experiences: Sequence[int] | None = None) -> list[Candidate]:
        """What each draw alone would have chosen: where these differ, what was seen does not decide."""
        return [self.best(experiences, [draw]) for draw in range(self.draws)]

    def table(self) -> Table:
        """The search as JSON can say it; :meth:`from_table` reads it."""
        tried = [
            {
                "settings": dict(one.settings),
                "score": plain_numbers(one.score()),
                "errors": [list(row) for row in one.errors],
                "failure": one.failure,
                "seconds": round(one.seconds, 3),
            }
            for one in self.candidates
        ]
        facts = {"budget": self.budget, "seed": self.seed, "draws": self.draws, "criterion": self.criterion}
        chosen = [self.candidates.index(one) for one in self.by_draw()]
        return {"chosen": self.chosen, "by_draw": chosen, **facts, "space": self.space, "candidates": tried}

    @classmethod
    def from_table(cls, table: Any) -> Tuned:
        """The inverse of :meth:`table`.

        Raises:
            InvalidConfig: Something missing, or settings that their estimator does not take.
        """
        try:
            tried = tuple(
                Candidate(
                    dict(one["settings"]),
                    tuple(tuple(map(float, row)) for row in one["errors"]),
                    one["failure"],
                    one["seconds"],
                )
                for one in table["candidates"]
            )
            chosen = ESTIMATOR.table(table["chosen"])
            facts = [table[name] for name in ("space", "budget", "seed", "draws", "criterion")]
        except (KeyError, TypeError, ValueError) as problem:
            raise InvalidConfig(f"no record of a tuning: {type(problem).__name__} {problem}") from None
        return cls(chosen, tried, *facts)


def tune(
    spec: Any,
    experiences: Iterable[Any],
    *,
    budget: int = 24,
    seed: int = 0,
    body: Embodiment | None = None,
    space: Any = None,
    draws: int = 4,
) -> Tuned:
    """Searches the settings of an estimator over points that fill its space evenly, judged on seen data alone.

    The first candidate is the spec as given; the others differ from it in what the space names. A candidate that
    raises, or foretells what is not finite, is recorded with its failure and never chosen.

    Args:
        spec: An estimator, the name of a class, or ``{CLASS: settings}``; CLASS may be ``"package.module:Class"``.
        experiences: Of the motion that will be learned from, other seeds than those to be reported. Of a recording,
            the truth is dropped.
        budget: Number of candidates; the same for all that are to be compared.
        seed: Same seed, same candidates, directions and fits, whatever else is tuned.
        body: The embodiment, for an estimator that wants one.
        space: Setting -> range (:mod:`bodyimage_kin.study.spaces`); None: that of :data:`SPACES`.
        draws: Directions along which what lies farthest is hidden in turn.

    Raises:
        InvalidConfig: A setting out of range, a space that is missing or names what the estimator does not have, an
            estimator that wants a body and got none, or one of which no candidate succeeded.
        InvalidRecording: An experience whose parts are too small to learn from and to judge.
        UnknownName: No such estimator.
    """
    _checks.whole("budget", budget, least=1)
    _checks.whole("draws", draws, least=1)
    _checks.whole("seed", seed, least=0)
    ((name, base),) = ESTIMATOR.table(spec).items()
    space = checked_space(name, _space_of(name) if space is None else space)
    given = _as_given(name, base, space, body)
    taught = [
        hold_out_far(experience(one), draws, seed=stream(seed, f"tuning/directions/{index}")[0])
        for index, one in enumerate(experiences)
    ]
    if not taught:
        raise InvalidRecording("no experience to tune on; give at least one")
    fit_seeds = stream(seed, f"tuning/{name}/fit", draws * len(taught))
    tried = tuple(
        _try(name, base, settings, taught, fit_seeds, body)
        for settings in _candidates(name, given, space, budget, seed)
    )
    best = min(tried, key=Candidate.score)
    if not best.errors:
        raise InvalidConfig(f"estimator {name}: no candidate succeeded; the first: {tried[0].failure}")
    chosen = ESTIMATOR.table({name: base | dict(best.settings)})
    return Tuned(chosen, tried, space, budget, seed, draws, _CRITERION.format(draws=draws))


def write_tuning(path: str | os.PathLike[str], tuned: Mapping[str, Tuned], **about: Any) -> None:
    """Writes searches as JSON, beside anything else that ``about`` names.

    Args:
        path: Of the file.
        tuned: Name -> search.
        about: What JSON can say: versions, seeds of the recordings, ...
    """
    table = {**_FORM, **about, "tuned": {name: search.table() for name, search in tuned.items()}}
    write_json(Path(path), table)


def read_tuning(path: str | os.PathLike[str]) -> dict[str, Tuned]:
    """The searches that :func:`write_tuning` wrote; their ``chosen`` tables are specs for a study.

    Raises:
        InvalidConfig: A file that cannot be read, or is none of ours.
    """
    try:
        table = json.loads(Path(path).read_text(encoding="utf-8"))
        form = {key: table[key] for key in _FORM}
        searches = dict(table["tuned"])
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise InvalidConfig(f"'{path}' holds no tuning: {problem}") from None
    if form != _FORM:
        raise InvalidConfig(f"'{path}' holds no tuning that this version reads: it is of {form}")
    return {name: Tuned.from_table(search) for name, search in searches.items()}


# Inner ---------------------------------------------------------------------------------------------------------------


def _space_of(name: str) -> Table:
    if name not in SPACES:
        raise InvalidConfig(f"estimator {name} has no space of its own; give space={{SETTING: range}}")
    return SPACES[name]


def _as_given(name: str, base: Table, space: Table, body: Embodiment | None) -> Table:
    """What the space names, as the spec has it."""
    if body is None and ESTIMATOR.wants_body({name: base}):
        raise InvalidConfig(f"estimator {name} wants an embodiment; give body=")
    known = inspect.signature(type(ESTIMATOR.build({name: base}, body=body))).parameters
    for setting in space:
        if setting not in known:
            raise InvalidConfig(str(UnknownName(f"setting of estimator {name}", setting, known)))
    return {setting: written(setting, base.get(setting, known[setting].default)) for setting in space}


def _candidates(name: str, given: Table, space: Table, budget: int, seed: int) -> list[Table]:
    """The settings as given, then others, none twice."""
    found = [given]
    for settings in points(space, _POINTS * budget, stream(seed, f"tuning/{name}/candidates")[0]) if space else ():
        if len(found) == budget:
            break
        if settings not in found:
            found.append(settings)
    return found


def _try(
    name: str,
    base: Table,
    settings: Table,
    taught: Sequence[Sequence[HeldOut]],
    seeds: Sequence[int],
    body: Embodiment | None,
) -> Candidate:
    begin = time.process_time()
    errors: tuple[tuple[float, ...], ...] = ()
    failure = ""
    try:
        spec = ESTIMATOR.build(ESTIMATOR.table({name: base | settings}), body=body)
        learned = iter(fit_all(spec, [part.seen for one in taught for part in one], seeds))
        judged = [[_error(next(learned), part.hidden) for part in one] for one in taught]
        # Five digits: no choice hangs on how sums are rounded.
        errors = tuple(tuple(float(f"{max(error, _ROUNDING):.5g}") for error in one) for one in judged)
    except (Exception, SystemExit) as problem:
        failure = said(problem)
    return Candidate(settings, errors, failure, time.process_time() - begin)


def _error(learned: Any, hidden: Pairs) -> float:
    """Relative displacement error over the hidden steps."""
    with torch.no_grad():
        foreseen = torch.as_tensor(learned.displacement(hidden.q, hidden.dq)).detach()
    error = displacement_error(foreseen, hidden.dr)
    # The metric leaves out rows that are not finite; here each one counts.
    if not (np.isfinite(foreseen.numpy()).all() and np.isfinite(error)):
        raise InvalidArray("displacement is not finite on hidden steps")
    return error
