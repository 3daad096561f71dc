"""The facts of a recording, whatever is learned from it. Estimators may be told them (:attr:`Row.told`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin.metrics import probes
from bodyimage_kin.study.context import IMAGE, Context, Fact
from bodyimage_kin.study.scores import of_maps
from bodyimage_kin.study.store import padded

__all__ = ["FACTS", "SHARED_MAPS"]

_ORACLE_SAMPLE = 64
"""Postures at which another backend's truth is held against Pinocchio's."""
_BY_POSTURE = ("probe", "posture")
_MAPS = ("body", "maps", "true_use")
_UNITS = ("unit_row", "unit_column")


def _of_excitation(name: str) -> Callable[[Context], Any]:
    return lambda context: getattr(context.excitation, name)


def _distance(index: int) -> Callable[[Context], Any]:
    """How far each posture of each probe is from training, in joint space or of the hand."""

    def of(context: Context) -> Any:
        assert context.body is not None
        away = {name: probes.distances(context.body, context.seen, q)[index] for name, q in context.postures.items()}
        return padded([away.get(name) for name in context.probes])

    return of


def _mean_distance(index: int) -> Callable[[Context], Any]:
    def of(context: Context) -> Any:
        rows = _distance(index)(context)
        return padded([one[np.isfinite(one)].mean() if np.isfinite(one).any() else None for one in rows])

    return of


def _rows_and_columns(tactile_map: Float[np.ndarray, "*taxels m"]) -> Float[np.ndarray, "rows columns m"]:
    """A map as rows and columns; of a skin that is no grid, one taxel a row."""
    return tactile_map.reshape(len(tactile_map), -1, tactile_map.shape[-1])


def _depth_ratio(context: Context) -> Any:
    assert context.body is not None
    return metrics.depth_ratio(context.body, context.seen)


FACTS: Mapping[str, Fact] = {
    fact.name: fact
    for fact in (
        Fact("excitation", ("direction",), "G_train v = mu G_use v", _of_excitation("eigenvalues"), needs=("use",)),
        Fact(
            "max_oracle_difference", (), "largest difference of the truth from Pinocchio's",
            lambda context: context.oracle_difference(_ORACLE_SAMPLE), "m/rad", needs=("body",),
        ),
        Fact(
            "mahalanobis_distance", ("probe",), "distance from training in its joint space, mean over postures",
            _mean_distance(0), needs=("body",),
        ),
        Fact(
            "hand_distance", ("probe",), "distance of the hand from where it was in training, mean over postures",
            _mean_distance(1), "m", needs=("body",),
        ),
        Fact(
            "mahalanobis_distance_by_posture", _BY_POSTURE, "distance from training in its joint space", _distance(0),
            needs=("body",),
        ),
        Fact(
            "hand_distance_by_posture", _BY_POSTURE, "distance of the hand from where it was in training",
            _distance(1), "m", needs=("body",),
        ),
        Fact(
            "depth_ratio", (), "mean depth of the hand in training over that on the face", _depth_ratio,
            needs=("body", "skin"), source="depth_ratio", optional=True,
        ),
        Fact(
            "motion_metric", ("joint", "other_joint"), "mean(dq dq') of the motion of use",
            lambda context: context.motion_metric, "rad^2", source="motion_metric", optional=True,
        ),
        Fact(
            "excited_motion", ("joint", "direction"), "v of G_train v = mu G_use v", _of_excitation("eigenvectors"),
            "1/rad", needs=("use",), optional=True,
        ),
        Fact(
            "direct_map_error_to_truth", (),
            "distance of the map of direct sight from the true taxels: the kernel's share",
            of_maps("map_error_to_truth"), IMAGE, needs=_MAPS, optional=True,
        ),
        Fact(
            "direct_map_span", ("axis",), "extent of the map of direct sight over the true one",
            of_maps("map_span"), needs=_MAPS, optional=True,
        ),
        Fact(
            "direct_map_topological_error", (), "taxels of the map of direct sight out of order with a neighbour",
            of_maps("map_topological_error"), needs=_MAPS, optional=True,
        ),
        Fact(
            "direct_map", ("first_map", "row", "column", "axis"), "map of direct sight",
            lambda context: padded([_rows_and_columns(one.tactile_map) for one in context.maps]), IMAGE, needs=_MAPS,
            optional=True,
        ),
        Fact(
            "direct_posture_map", ("first_map", *_UNITS, "axis"), "posture map of direct sight",
            lambda context: padded([one.posture_map for one in context.maps]), IMAGE, needs=_MAPS, optional=True,
        ),
        Fact(
            "posture_units", (*_UNITS, "joint"), "representative postures of the posture map",
            lambda context: context.posture_som.postures, "rad", needs=("maps",), optional=True,
        ),
        Fact(
            "posture_scale", ("joint",), "spread of each joint over the touches",
            lambda context: context.posture_som.scale, "rad", needs=("maps",), optional=True,
        ),
    )
}  # fmt: skip
"""Name -> fact; optional ones are kept when they are named."""
SHARED_MAPS = ("posture_units", "posture_scale", "direct_map", "direct_posture_map")
"""Facts that are computed once a recording for all rows, where maps are learned."""
