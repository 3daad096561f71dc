"""Scores by name, and every score of one learned Jacobian by the very functions that the cells of a study use."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin._checks import choice, whole
from bodyimage_kin._named import named_object
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.calibration import Calibrated, halves
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.estimators.analytic import AnalyticJacobian
from bodyimage_kin.metrics import probes as probe_specs
from bodyimage_kin.recordings import check
from bodyimage_kin.study.context import FOLDS, Context, LeftOut, Score, image_unit
from bodyimage_kin.study.facts import FACTS
from bodyimage_kin.study.held_out import held_out_scores, learned_scores
from bodyimage_kin.study.random_streams import stream
from bodyimage_kin.study.scores import HELD_OUT, SCORES
from bodyimage_kin.study.specs import ESTIMATOR, PROBE, plain_name, snake

__all__ = [
    "PROBES",
    "built_probe",
    "computed",
    "default_facts",
    "default_scores",
    "need_maps",
    "probe_name",
    "resolve",
    "score",
    "written_score",
]

PROBES: Mapping[str, probe_specs.Probe] = {
    "training": probe_specs.Training(),
    "in_front": probe_specs.Face(distance=0.03),
    "on_face": probe_specs.Face(),
    "joint_space": probe_specs.JointSpace(),
}
"""Posture sets that leave what was seen step by step."""


_DRAWS = 16
"""Bodies drawn from the posterior of a calibrated one."""


def score(
    learned: Any,
    body: Embodiment | Calibrated | None,
    seen: xr.Dataset,
    use: xr.Dataset | None = None,
    probes: Sequence[Any] | Mapping[str, Any] | None = None,
    *,
    tour: xr.Dataset | None = None,
    scores: Sequence[str | Score] | None = None,
    first_maps: int = 1,
    seed: int = 0,
    excitation_cut: float = 0.1,
    metric_of: str = "felt",
    draws: int = _DRAWS,
    folds: int = FOLDS,
    noise: float | None = None,
) -> xr.Dataset:
    """Scores of a learned Jacobian.

    Args:
        learned: Anything with ``displacement(q, dq)`` and ``jacobian(q)`` (:class:`bodyimage_kin.estimators.Learned`).
            Without a body also an estimator, or name -> estimator: each learns without a part of the recording in turn,
            and is held against that part (:func:`bodyimage_kin.study.held_out_scores`).
        body: Whose truth it is held against. A calibrated body is no certain truth: scores are means over bodies drawn
            from its posterior, each with its standard deviation beside it (``relative_error_sd``), and
            ``halves_apart`` is how far two bodies differ that were fitted to one half of the observations each. None:
            the body is not known, and only what needs no truth is scored, against images of ``use``, or else of
            ``seen``.
        seen: The recording that was learned from.
        use: The motion that the Jacobian is used for: its metric counts in ``relative_error_use``. None: that of
            ``seen``, and errors are not split into excited and unexcited ones.
        probes: Where Jacobians are held against each other: probes, their names, or name -> probe. None:
            :data:`PROBES`; without a skin those of them that need none.
        tour: A recording with the truth, for scores of displacements and paths.
        scores: Names, or scores of one's own; None: all that take little time.
        first_maps: Initial weights that maps are tried with, where scores of maps are asked for.
        seed: Of these.
        excitation_cut: A direction counts as excited when training moves along it this much of what use does.
        metric_of: ``"felt"`` or ``"true"``: whose motion the metric and the excitation are of.
        draws: Bodies drawn from a calibrated one's posterior.
        folds: Parts that are hidden in turn from an estimator.
        noise: Root of the mean squared noise of one image [its unit], for errors without a truth; None: from repeats.

    Returns:
        One variable a score, over ``probe``, ``part``, ``axis``, ``posture`` ... as it has them: ``relative_error`` in
        the identity metric, ``relative_error_use`` in the motion's. The attribute ``left_out`` says, as JSON, what was
        not scored and what it lacks.

    Raises:
        InvalidRecording: Not a recording.
        InvalidConfig: A probe or a score that is none.
        UnknownName: Another name.
        WrongResult: What was learned answers in other shapes, or not in finite numbers.
    """
    if body is None and (isinstance(learned, Mapping) or not hasattr(learned, "displacement")):
        named_ones = learned if isinstance(learned, Mapping) else {"": learned}
        specs = {name or "estimator": ESTIMATOR.build(one) for name, one in named_ones.items()}
        rows = held_out_scores(specs, seen, folds=folds, noise=noise, seed=seed)
        return rows if isinstance(learned, Mapping) else rows.isel(estimator=0, drop=True)
    if isinstance(body, Calibrated):
        settings: dict[str, Any] = {
            "tour": tour,
            "scores": scores,
            "first_maps": first_maps,
            "excitation_cut": excitation_cut,
        }
        every = [body.body, *body.draws(whole("draws", draws, least=2), seed)]
        result = _over_draws(
            [score(learned, one, seen, use, probes, seed=seed, metric_of=metric_of, **settings) for one in every]
        )
        half, other_half = halves(body, seed)
        known = AnalyticJacobian(half, unit=half.camera.model.unit)
        apart = score(known, other_half, seen, probes=probes, scores=["relative_error"])["relative_error"]
        return result.assign(halves_apart=apart.assign_attrs(long_name="relative difference of bodies of two halves"))
    if body is None and scores is None:
        return learned_scores(learned, seen, use, noise)
    named = _named_probes(probes, body)
    names = default_scores() if scores is None else scores
    asked = [one for one in map(resolve, names) if one.name != "fit_seconds"]
    count = 1 + whole("first_maps", first_maps, least=1)
    context = Context(
        body,
        check(seen),
        use if use is None else check(use),
        tour if tour is None else check(tour),
        learned,
        named,
        map_seeds=stream(whole("seed", seed, least=0), "first maps", count),
        cut=excitation_cut,
        of=choice("metric_of", metric_of, ("felt", "true")),  # type: ignore[arg-type]
    )
    found, lacking = computed(context, asked)
    labels: dict[str, Any] = {"probe": list(named)}
    if "axis" in seen.coords:
        labels["axis"] = seen["axis"].values
    variables = {}
    for one in asked:
        if one.name in found:
            variables[one.name] = (one.dims, found[one.name], one.attributes(image_unit(seen)))
            labels |= {dim: list(values) for dim, values in (one.labels or {}).items()}
    used = {dim for dims, _, _ in variables.values() for dim in dims}
    return xr.Dataset(
        variables,
        {dim: values for dim, values in labels.items() if dim in used},
        {
            "motion_metric": f"{metric_of} motion of {'what was seen' if use is None else 'use'}",
            "left_out": json.dumps(lacking),
        },
    )


def _over_draws(found: Sequence[xr.Dataset]) -> xr.Dataset:
    """Mean and standard deviation of scores over bodies that may each be the true one; the first is the likeliest."""
    likeliest, *drawn = found
    result = likeliest.copy()
    for name, one in likeliest.data_vars.items():
        if one.dtype.kind != "f":
            continue
        # Postures that a probe has on one body and not on another have no mean.
        if not all(other[name].shape == one.shape for other in drawn):
            result = result.drop_vars(str(name))
            continue
        values = np.stack([other[name].values for other in drawn])
        result[name] = (one.dims, values.mean(0), one.attrs)
        sd = {**one.attrs, "long_name": f"{one.attrs.get('long_name', name)}, standard deviation over bodies"}
        result[f"{name}_sd"] = (one.dims, values.std(0, ddof=1), sd)
    result.attrs["truth"] = f"{len(drawn)} bodies drawn from the posterior of a calibrated one"
    return result


# By name -------------------------------------------------------------------------------------------------------------


def resolve(asked: str | Score, folder: Path = Path()) -> Score:
    """The score or fact of a name.

    Args:
        asked: The object itself, a name of :data:`SCORES` or :data:`FACTS`, or ``"package.module:NAME"``.
        folder: Where a module may lie beside where Python looks.

    Raises:
        UnknownName: None of ours.
        InvalidConfig: Something that is no score.
    """
    if isinstance(asked, Score):
        return asked
    if not isinstance(asked, str):
        raise InvalidConfig(f"score {asked!r}: give its name, or a bk.study.Score")
    known = {**SCORES, **FACTS}
    if asked in known:
        return known[asked]
    if ":" not in asked:
        raise UnknownName("score", asked[:100], (*known, "package.module:NAME"))
    found = named_object("score", asked, folder)
    if not isinstance(found, Score):
        raise InvalidConfig(f"score {asked!r} is {type(found).__name__}; give a bk.study.Score")
    return found


def written_score(asked: str | Score, folder: Path = Path()) -> str:
    """How a score is named in a study's file: ours by name, any other as ``package.module:NAME``.

    Raises:
        UnknownName: None of ours.
        InvalidConfig: Something that is no score, or one that workers cannot find.
    """
    found = resolve(asked, folder)
    if isinstance(asked, str) or {**SCORES, **FACTS}.get(found.name) is found:
        return asked if isinstance(asked, str) else found.name
    module = sys.modules.get(found.of.__module__)
    names = [name for name, value in vars(module).items() if value is found] if module is not None else []
    if not names or found.of.__module__ == "__main__":
        raise InvalidConfig(
            f"score '{found.name}' cannot be found by workers; keep it at the top of its function's module"
        )
    return f"{found.of.__module__}:{names[0]}"


def computed(context: Context, scores: Sequence[Score]) -> tuple[dict[str, Any], dict[str, str]]:
    """Scores of a context by name, and of those that are left out what they lack.

    Raises:
        InvalidConfig: A score of other dimensions than it says.
    """
    found: dict[str, Any] = {}
    lacking: dict[str, str] = {}
    for score in scores:
        if missing := [need for need in score.needs if need not in context.has]:
            lacking[score.name] = f"there is no {' and no '.join(one.replace('_', ' ') for one in missing)}"
            continue
        try:
            value = np.asarray(score.of(context))
        except LeftOut as problem:
            lacking[score.name] = str(problem)
            continue
        value = value if value.dtype.kind == "U" else value.astype(np.float64)
        if value.ndim != len(score.dims):
            raise InvalidConfig(f"score '{score.name}' has {value.ndim} dimensions, but says {score.dims}")
        found[score.name] = value
    return found, lacking


def _default(known: Mapping[str, Score], per_posture: bool) -> tuple[str, ...]:
    kept = (one for one in known.values() if not one.optional and (per_posture or "posture" not in one.dims))
    return tuple(one.name for one in kept)


def default_scores(per_posture: bool = False, given: bool = False) -> tuple[str, ...]:
    """Names of the scores that a study keeps unless it says otherwise.

    Args:
        per_posture: Those of each posture too.
        given: Of recordings that it was handed: also those that need no truth, for which each row learns once a fold.
    """
    return (*(HELD_OUT if given else ()), *_default(SCORES, per_posture))


def default_facts(per_posture: bool = False, with_maps: bool = False) -> tuple[str, ...]:
    """Names of the facts that a study keeps unless it says otherwise."""
    of_maps = [name for name in FACTS if name.startswith("direct_map_")] if with_maps else []
    return (*_default(FACTS, per_posture), *of_maps)


def need_maps(names: Collection[str | Score], folder: Path = Path()) -> bool:
    """Whether maps are to be learned for any of these scores."""
    return any("maps" in resolve(name, folder).needs for name in names)


# Probes --------------------------------------------------------------------------------------------------------------


def _named_probes(given: Sequence[Any] | Mapping[str, Any] | None, body: Embodiment | None) -> dict[str, Any]:
    if given is None:
        skin = body is not None and body.skin is not None
        return {name: one for name, one in PROBES.items() if skin or not isinstance(one, probe_specs.Face)}
    if isinstance(given, Mapping):
        return {plain_name("probe", name): built_probe(one) for name, one in given.items()}
    found: dict[str, Any] = {}
    for one in given:
        probe = built_probe(one)
        name = one if isinstance(one, str) else probe_name(probe)
        found[name if name not in found else f"{name}_{len(found)}"] = probe
    return found


def built_probe(given: Any, folder: Path = Path()) -> Any:
    """A probe from an object, a name of :data:`PROBES`, a class or a table.

    Args:
        given: Any of these.
        folder: Where a module may lie beside where Python looks.

    Raises:
        InvalidConfig: None of these.
        UnknownName: Another name.
    """
    if isinstance(given, str) and given not in PROBE.classes and ":" not in given:
        if given not in PROBES:
            raise UnknownName("probe", given[:100], (*PROBES, *PROBE.classes, "package.module:Class"))
        return PROBES[given]
    return PROBE.build(given, folder)


def probe_name(probe: Any) -> str:
    """What results call a probe that was given without a name."""
    return next((name for name, one in PROBES.items() if one == probe), snake(type(probe).__name__))
