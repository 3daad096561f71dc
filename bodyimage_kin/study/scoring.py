"""Every score of one learned Jacobian on one recording, by the very functions that the cells of a study use."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr

from bodyimage_kin._checks import whole
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.metrics import probes as probe_specs
from bodyimage_kin.recordings import check
from bodyimage_kin.study import scores as registry
from bodyimage_kin.study.context import Context
from bodyimage_kin.study.grid import stream
from bodyimage_kin.study.scores import Score
from bodyimage_kin.study.specs import PROBE, plain_name, snake

PROBES: Mapping[str, probe_specs.Probe] = {
    "training": probe_specs.Training(),
    "in_front": probe_specs.Face(distance=0.03),
    "on_face": probe_specs.Face(),
    "joint_space": probe_specs.JointSpace(),
}
"""Posture sets that leave what was seen step by step."""


def score(
    learned: Any,
    body: Embodiment | None,
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
) -> xr.Dataset:
    """Scores of a learned Jacobian.

    Args:
        learned: Anything with ``displacement(q, dq)`` and ``jacobian(q)`` (:class:`bodyimage_kin.estimators.Learned`).
        body: Whose truth it is held against; None: it is not known, and only what needs no truth is scored.
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
    named = _named_probes(probes, body)
    names = registry.default_scores() if scores is None else scores
    asked = [one for one in map(registry.resolve, names) if one.name != "fit_seconds"]
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
        of=metric_of,
    )
    found, lacking = registry.computed(context, asked)
    labels: dict[str, Any] = {"probe": list(named)}
    if "axis" in seen.coords:
        labels["axis"] = seen["axis"].values
    variables = {}
    for one in asked:
        if one.name in found:
            variables[one.name] = (one.dims, found[one.name], one.attributes)
            labels |= {dim: list(values) for dim, values in (one.labels or {}).items()}
    used = {dim for dims, _, _ in variables.values() for dim in dims}
    return xr.Dataset(
        variables,
        {dim: values for dim, values in labels.items() if dim in used},
        {"motion_metric": f"{metric_of} motion of {'what was seen' if use is None else 'use'}", "left_out": json.dumps(lacking)},
    )


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


def built_probe(given: Any) -> Any:
    """A probe from an object, a name of :data:`PROBES`, a class or a table.

    Raises:
        InvalidConfig: None of these.
        UnknownName: Another name.
    """
    return PROBES[given] if isinstance(given, str) and given in PROBES else PROBE.build(given)


def probe_name(probe: Any) -> str:
    """What results call a probe that was given without a name."""
    return next((name for name, one in PROBES.items() if one == probe), snake(type(probe).__name__))
