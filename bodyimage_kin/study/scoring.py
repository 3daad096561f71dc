"""Every score of one learned Jacobian on one recording: at the probes, on the tour, and of the maps it leads to."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body_image import integrate
from bodyimage_kin.metrics import probes
from bodyimage_kin.recordings import experience
from bodyimage_kin.study import maps
from bodyimage_kin.study.scores import CAUSES, PARTS, SCORES
from bodyimage_kin.study.specs import Table, build_probe

_CHUNK = 5000
"""Postures at which Jacobians are asked for at once: bounds the memory of wide probes."""


_LARGEST = 1e150
"""Beyond it a square is not finite, nor is any score."""


class WrongResult(Exception):
    """What an estimator returned is no learned Jacobian of finite values."""


def score(
    body: Embodiment,
    recordings: Mapping[str, xr.Dataset],
    facts: xr.Dataset,
    learned: Any,
    tables: Mapping[str, Table],
    *,
    excitation_cut: float,
    per_posture: bool,
    map_seeds: Sequence[int],
    keep: Collection[str],
) -> dict[str, Any]:
    """Every score of one learned Jacobian, without the dimension ``seed``.

    Args:
        body: The embodiment.
        recordings: Role -> recording: ``"training"``, ``"tour"``, and ``"touch"`` where there are maps to learn.
        facts: What the recordings say by themselves.
        learned: The learned Jacobian.
        tables: Of the probes, by name.
        excitation_cut: A direction counts as excited from this on.
        per_posture: Whether scores of each posture are wanted.
        map_seeds: Of the first maps; none: no maps are learned.
        keep: Names of the scores that are wanted; of those that take their time, no other is computed.

    Raises:
        WrongResult: Answers of another shape, or that are not finite, or too large to be scored.
    """
    training, tour, touch = recordings["training"], recordings["tour"], recordings.get("touch")
    found = _on_tour(body, tour, learned)
    if "trajectory_split" in keep:
        found["trajectory_split"] = _split(tour, learned)
    if map_seeds and touch is not None:
        hand = _integrated("touching", touch, learned)
        found["touch_trajectory_rmse"] = metrics.trajectory_rmse(touch["true_hand_image"].values, hand.values)
        found |= maps.scores(body, training, touch, hand, facts, map_seeds)
    W = facts["metric"].values
    seen = metrics.Excitation(facts["excitation"].values, facts["excited_motion"].values, W, "true", excitation_cut)
    rows: dict[str, list[Any]] = {}
    for probe, table in tables.items():
        q = probes.probe_postures(build_probe(table), body, training)
        with torch.no_grad():
            J = _in_chunks("true jacobian", body.hand_image_jacobian, q, body.m)
        Jh = _in_chunks(f"jacobian at probe '{probe}'", learned.jacobian, q, body.m)
        for name, value in _at_probe(J, Jh, W, seen.projector(), per_posture).items():
            rows.setdefault(name, []).append(value)
        if "basin_by_posture" in keep:
            on_face = "face" in tables[probe]
            rows.setdefault("basin_by_posture", []).append(_basin(body, q, learned) if on_face else np.empty(0))
    for name, values in rows.items():
        found[name] = probes.by_posture(values) if "posture" in SCORES[name].dims else np.array(values)
    return found


# Inner ---------------------------------------------------------------------------------------------------------------


def _at_probe(
    J: Float[np.ndarray, "postures m p"],
    Jh: Float[np.ndarray, "postures m p"],
    W: Float[np.ndarray, "p p"],
    P: Float[np.ndarray, "p p"],
    per_posture: bool,
) -> dict[str, Any]:
    parts = metrics.attribute(J, Jh, W, P)
    found: dict[str, Any] = {
        "relative_error": metrics.pooled_relative_error(J, Jh, "identity"),
        "relative_error_use": metrics.pooled_relative_error(J, Jh, W),
        "scale_free_error": metrics.pooled_scale_free_error(J, Jh, W),
        "attribution": [getattr(parts, part) for part in PARTS],
        "scale": parts.best_scale,
    }
    if per_posture:
        found["relative_error_by_posture"] = metrics.relative_error(J, Jh, W)
        found["scale_free_error_by_posture"] = metrics.scale_free_error(J, Jh, W)
        found["critical_gain_by_posture"] = metrics.critical_gain(metrics.servo_matrix(J, Jh))
        size = np.einsum("nij,jk,nik->n", J, W, J).mean()
        residual = parts.best_scale * Jh - J
        residual = residual - residual.mean(0)
        found["scale_by_posture"] = (1 - parts.best_scale) ** 2 * np.einsum("nij,jk,nik->n", Jh, W, Jh) / size
        found["variation_by_posture"] = np.einsum("nij,jk,nik->n", residual, W, residual) / size
    return found


def _on_tour(body: Embodiment, tour: xr.Dataset, learned: Any) -> dict[str, Any]:
    """Scores of the displacements on the tour, and of the path that they sum to."""
    q, image = tour["true_q"].values, tour["true_hand_image"].values
    there = np.isfinite(q[:, :-1]).all(-1) & np.isfinite(q[:, 1:]).all(-1)
    before, dq = torch.from_numpy(q[:, :-1][there]), torch.from_numpy(np.diff(q, axis=1)[there])
    with torch.no_grad():
        linear = (body.hand_image_jacobian(before) @ dq[..., None])[..., 0].numpy()
    foreseen = _checked("displacement on the tour", learned.displacement(before, dq), linear.shape)
    path = _integrated("tour", tour, learned, reset="none", initial=image[:, 0]).values
    velocity, estimated = np.diff(image, axis=1), np.diff(path, axis=1)
    return {
        "displacement_error": metrics.displacement_error(foreseen, linear),
        "velocity_correlation": metrics.velocity_correlation(velocity, estimated),
        "velocity_nrmse": metrics.velocity_nrmse(velocity, estimated),
        "trajectory_rmse": metrics.trajectory_rmse(image, path),
    }


def _split(tour: xr.Dataset, learned: Any) -> Float[np.ndarray, "cause"]:
    """RMS of each part of the integrated tour's error [m]."""
    rms = metrics.error_split(
        tour["true_q"].values,
        tour["true_hand_image"].values,
        lambda q, dq: _floats(learned.displacement(torch.from_numpy(q), torch.from_numpy(dq))),
        lambda q: _answers(learned.jacobian, q),
    ).rms
    return np.array([rms[cause] for cause in CAUSES])


def _basin(body: Embodiment, goals: torch.Tensor, learned: Any) -> Float[np.ndarray, "postures"]:
    """Distance on the screen from which a servo still converges to each posture's image [m]."""
    return metrics.servo_basin(
        lambda q: _answers(lambda part: body.hand_image(part, on_invisible="nan"), q),
        lambda q: _answers(body.hand_image_jacobian, q),
        lambda q: _answers(learned.jacobian, q),
        goals.numpy(),
        lower=body.felt_robot.lower.numpy(),
        upper=body.felt_robot.upper.numpy(),
    ).radius


def _answers(of: Callable[..., Any], q: Float[np.ndarray, "postures p"]) -> Float[np.ndarray, "postures ..."]:
    """What a function of postures says, asked for few of them at a time."""
    return np.concatenate([_floats(of(part)) for part in torch.split(torch.from_numpy(q), _CHUNK)])


def _integrated(what: str, recording: xr.Dataset, learned: Any, **settings: Any) -> xr.DataArray:
    """The integrated hand image, once it is known to be finite wherever a posture was felt."""
    felt = experience(recording)
    with torch.no_grad():
        path = integrate(felt, learned, **settings)
    # Scores of a path leave out what is not finite: one that explodes would seem to be a good one.
    there = np.isfinite(felt["q"].values).all(-1)
    _checked(f"the integrated {what}", path.values[there], path.values[there].shape)
    return path


def _in_chunks(what: str, jacobian: Callable[..., Any], q: torch.Tensor, m: int) -> Float[np.ndarray, "postures m p"]:
    """Jacobians at postures, few of them at a time."""
    found = np.empty((len(q), m, q.shape[-1]))
    for part, here in zip(np.split(found, range(_CHUNK, len(q), _CHUNK)), torch.split(q, _CHUNK), strict=True):
        part[...] = _checked(what, jacobian(here), part.shape)
    return found


def _checked(what: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """What an estimator answers, once its shape and values are known to be right."""
    values = _floats(value)
    if values.shape != shape:
        raise WrongResult(f"{what} has shape {values.shape}; it must be {shape}")
    for problem, sound in (("not finite", np.isfinite(values)), ("too large to be scored", abs(values) < _LARGEST)):
        wrong = int((~sound).reshape(len(values), -1).any(1).sum())
        if wrong:
            raise WrongResult(f"{what} is {problem} in {wrong} of {len(values)} postures")
    return values


def _floats(value: Any) -> Float[np.ndarray, "..."]:
    return np.asarray(value.detach() if hasattr(value, "detach") else value, dtype=np.float64)
