"""A study's work: a ground (one embodiment and motion, a block of seeds) and the cells of estimators that stand on it.

Everything here runs in a worker, from plain tables and datasets to datasets. Each seed has random streams of its own,
spawned from the study's by the cell's name, so that nothing depends on who works, on how many do, or in what order.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
import xarray as xr

from bodyimage_kin import metrics
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.metrics import probes
from bodyimage_kin.recordings import experience, simulate_many
from bodyimage_kin.study import maps, scoring
from bodyimage_kin.study.scores import CAUSES, PARTS, SCORES
from bodyimage_kin.study.scoring import WrongResult
from bodyimage_kin.study.specs import Table, build_estimator, build_probe, motion_arguments

_AXES = ["x", "y"]
"""Of the hand image, as recordings name them."""
_ORACLE_SAMPLE = 64
"""Postures at which another backend's truth is held against Pinocchio's."""


@dataclass(frozen=True)
class Ground:
    """What all estimators of one embodiment, motion and block of seeds share.

    Attributes:
        embodiment: Its name in the study.
        recording: Likewise.
        seeds: The block's.
        body: Table of the embodiment, its path resolved.
        sha256: Hash of the embodiment that the study began with.
        motions: Table of the recording.
        probes: Name -> table.
        entropy: Of the study's random streams.
        excitation_cut: A direction counts as excited from this on.
        per_posture: Whether scores of each posture are kept.
        first_maps: Number of first maps that each recording is tried with; 0: no maps are learned.
    """

    embodiment: str
    recording: str
    seeds: tuple[int, ...]
    body: Table
    sha256: str
    motions: Table
    probes: Mapping[str, Table]
    entropy: int
    excitation_cut: float
    per_posture: bool
    first_maps: int = 0

    @property
    def roles(self) -> tuple[str, ...]:
        """Of the recordings that cells need: touches only where there are maps to learn."""
        return ("training", "touch", "tour") if self.first_maps else ("training", "tour")

    @property
    def motion(self) -> str:
        """Name of the motion that is learned from."""
        return next(name for name in self.motions if name not in ("touch", "tour"))


@dataclass(frozen=True, eq=False)
class Scene:
    """The recordings of a ground, and what they say before anything is learned.

    Attributes:
        recordings: ``"training"``, ``"touch"`` and ``"tour"`` -> one recording a seed.
        facts: Dims (seed, probe, posture, direction, joint): ``metric``, ``excitation``, ``mahalanobis_distance``,
            ``hand_distance``, ``max_oracle_difference``; with maps, those of :func:`maps.direct_facts`.
    """

    recordings: Mapping[str, Sequence[xr.Dataset]]
    facts: xr.Dataset


def stream(entropy: int, name: str, count: int = 1) -> list[int]:
    """Seeds of a cell: the study's ``SeedSequence``, spawned by the cell's name.

    Args:
        entropy: The study's own seed.
        name: Such as ``embodiment/recording/seed``.
        count: How many.

    Returns:
        Numbers below 2^32, which every library takes.
    """
    key = np.frombuffer(hashlib.sha256(name.encode()).digest(), dtype="<u4")
    return [int(value) for value in np.random.SeedSequence(entropy, spawn_key=key.tolist()).generate_state(count)]


def make_scene(ground: Ground) -> Scene | str:
    """Simulates the recordings of a ground and measures what they excite; or says what went wrong."""
    try:
        return _simulate(ground, load_body(ground))
    except Exception as problem:
        # Said in words: not every error can travel from a worker.
        return describe(problem)


def run_cell(ground: Ground, scene: Scene, name: str, table: Table, keep: Sequence[str]) -> xr.Dataset:
    """Trains one estimator on a block of seeds together, and scores what each learned.

    Args:
        ground: Of the cell.
        scene: Its recordings, those of the ground's ``roles``, and facts.
        name: The estimator's name in the study.
        table: Its table.
        keep: Names of the scores to keep.

    Returns:
        Scores over ``seed``; ``failure`` says what went wrong with a seed, empty where nothing did. A seed that failed
        has NaN for every score.
    """
    body = load_body(ground)
    begin = time.thread_time()
    try:
        all_learned = _fit(ground, scene, name, build_estimator(table, body))
    except (Exception, SystemExit) as problem:
        return failed(ground, keep, describe(problem))
    seconds = (time.thread_time() - begin) / len(ground.seeds)
    found = []
    for index, learned in enumerate(all_learned):
        try:
            values = scoring.score(
                body,
                {role: scene.recordings[role][index] for role in ground.roles},
                scene.facts.isel(seed=index),
                learned,
                ground.probes,
                excitation_cut=ground.excitation_cut,
                per_posture=ground.per_posture,
                map_seeds=_map_seeds(ground, ground.seeds[index])[1:] if ground.first_maps else (),
                keep=keep,
            )
            values["fit_seconds"] = np.float64(seconds)
            found.append(_dataset(ground, values, keep))
        except (Exception, SystemExit) as problem:
            found.append(_nothing(ground, keep, describe(problem)))
    return stack(found, ground.seeds)


def fit_all(spec: Any, experiences: Sequence[xr.Dataset], seeds: Sequence[int]) -> list[Any]:
    """What an estimator learns from experiences, one seed each; a user's own need not have ``fit_many``.

    Raises:
        WrongResult: ``fit_many`` gave more or fewer.
    """
    if not callable(getattr(spec, "fit_many", None)):
        return [spec.fit(exp, seed) for exp, seed in zip(experiences, seeds, strict=True)]
    learned = list(spec.fit_many(experiences, seeds))
    if len(learned) != len(seeds):
        raise WrongResult(f"fit_many returned {len(learned)} learned Jacobians for {len(seeds)} seeds")
    return learned


def failed(ground: Ground, keep: Sequence[str], failure: str) -> xr.Dataset:
    """The result of a cell of which nothing came."""
    return stack([_nothing(ground, keep, failure)] * len(ground.seeds), ground.seeds)


def describe(problem: BaseException) -> str:
    """An error in one line: its class and what it says."""
    said = " ".join(str(problem).split())
    return f"{type(problem).__name__}: {said}" if said else type(problem).__name__


def stack(datasets: Sequence[xr.Dataset], seeds: Sequence[int]) -> xr.Dataset:
    """One dataset a seed as one over ``seed``, padded with NaN where postures are fewer."""
    return concat(datasets, labels("seed", seeds))


def concat(datasets: Sequence[xr.Dataset], dim: Any) -> xr.Dataset:
    """Datasets side by side; what one of them lacks is NaN."""
    return xr.concat(list(datasets), dim, data_vars="all", join="outer", combine_attrs="override")


def labels(dim: str, values: Sequence[Any]) -> xr.DataArray:
    """A new dimension with these labels, for :func:`concat`."""
    return xr.DataArray(list(values), dims=[dim], name=dim)


# Inner ---------------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=8)
def _load(name: str, backend: str | None, sha256: str) -> Embodiment:
    body = load_embodiment(name, backend)
    if body.sha256 != sha256:
        raise InvalidConfig(f"embodiment '{name}' has changed since the study began; begin a new one")
    return body


def load_body(ground: Ground) -> Embodiment:
    """The embodiment of a ground, loaded once a process; makes the process one that computes with one thread."""
    # Bits depend on how sums are divided among threads, and the processes of a pool divide the work already.
    torch.set_num_threads(1)
    return _load(ground.body["embodiment"], ground.body.get("backend"), ground.sha256)


def _simulate(ground: Ground, body: Embodiment) -> Scene:
    kinds = {"training": ground.motion, "touch": "random_touch", "tour": "face_tour"}
    streams = [stream(ground.entropy, f"{ground.embodiment}/{ground.recording}/{seed}", 3) for seed in ground.seeds]
    recordings = {
        role: simulate_many(
            body,
            seeds=[one[index] for one in streams],
            threads=1,
            **motion_arguments(kind, ground.motions[kind if role == "training" else role]),
        )
        for index, (role, kind) in enumerate(kinds.items())
    }
    facts = []
    for seed, training, touch in zip(ground.seeds, recordings["training"], recordings["touch"], strict=True):
        facts.append(_facts(ground, body, training, touch))
        if ground.first_maps:
            facts[-1] = facts[-1].merge(maps.direct_facts(body, training, touch, _map_seeds(ground, seed)))
    return Scene(recordings, stack(facts, ground.seeds))


def _map_seeds(ground: Ground, seed: int) -> list[int]:
    """Seeds of the posture map, then of each of the first maps: the same for every estimator."""
    # No estimator has a space in its name.
    return stream(ground.entropy, f"{ground.embodiment}/{ground.recording}/{seed}/first maps", 1 + ground.first_maps)


def _facts(ground: Ground, body: Embodiment, training: xr.Dataset, touch: xr.Dataset) -> xr.Dataset:
    postures = {
        name: probes.probe_postures(build_probe(table), body, training) for name, table in ground.probes.items()
    }
    away = {probe: probes.distances(body, training, q) for probe, q in postures.items()}
    found = metrics.excitation(training, touch, "true", ground.excitation_cut)
    return xr.Dataset(
        {
            "metric": (("joint", "other_joint"), found.motion_metric, {"units": "rad^2"}),
            "excitation": (("direction",), found.eigenvalues, {"long_name": "G_train v = mu G_use v", "units": "1"}),
            "excited_motion": (("joint", "direction"), found.eigenvectors, {"long_name": "v", "units": "1/rad"}),
            "mahalanobis_distance": (
                ("probe", "posture"),
                probes.by_posture([one[0] for one in away.values()]),
                {"long_name": "distance from training in its joint space", "units": "1"},
            ),
            "hand_distance": (
                ("probe", "posture"),
                probes.by_posture([one[1] for one in away.values()]),
                {"long_name": "distance of the hand from where it was in training", "units": "m"},
            ),
            "max_oracle_difference": (
                (),
                _oracle_difference(ground, body, torch.cat(list(postures.values()))),
                {"long_name": "largest difference of the truth from Pinocchio's", "units": "m/rad"},
            ),
        },
        {
            "probe": list(ground.probes),
            "posture": np.arange(max(map(len, postures.values()))),
            "direction": np.arange(body.p),
        },
    )


def _oracle_difference(ground: Ground, body: Embodiment, q: torch.Tensor) -> float:
    if ground.body.get("backend") == "pinocchio":
        return 0.0
    oracle = _load(ground.body["embodiment"], "pinocchio", ground.sha256)
    sample = q[:: max(1, len(q) // _ORACLE_SAMPLE)]
    with torch.no_grad():
        return float((body.hand_image_jacobian(sample) - oracle.hand_image_jacobian(sample)).abs().max())


def _fit(ground: Ground, scene: Scene, name: str, spec: Any) -> list[Any]:
    """What the estimator learns from each recording of the block."""
    experiences = [experience(recording) for recording in scene.recordings["training"]]
    seeds = [
        stream(ground.entropy, f"{ground.embodiment}/{ground.recording}/{seed}/{name}")[0] for seed in ground.seeds
    ]
    return fit_all(spec, experiences, seeds)


def _dataset(ground: Ground, values: Mapping[str, Any], keep: Sequence[str], failure: str = "") -> xr.Dataset:
    """Scores of one seed, labelled."""
    variables = {
        score: xr.Variable(SCORES[score].dims, values[score], SCORES[score].attributes)
        for score in keep
        if score in values
    }
    coords: dict[str, Any] = {"probe": list(ground.probes), "part": list(PARTS), "cause": list(CAUSES), "axis": _AXES}
    used = {dim for variable in variables.values() for dim in variable.dims}
    coords = {dim: values for dim, values in coords.items() if dim in used}
    if "posture" in used:
        # With labels, seeds of unlike numbers of postures can be put side by side.
        coords["posture"] = np.arange(next(v.sizes["posture"] for v in variables.values() if "posture" in v.dims))
    return xr.Dataset({**variables, "failure": ((), failure)}, coords)


def _nothing(ground: Ground, keep: Sequence[str], failure: str) -> xr.Dataset:
    """What a seed that failed leaves: NaN for every score."""
    sizes = {"probe": len(ground.probes), "part": len(PARTS), "cause": len(CAUSES), "axis": len(_AXES), "posture": 0}
    values = {
        score: np.full([sizes[dim] for dim in SCORES[score].dims], np.nan)
        for score in keep
        if ground.per_posture or SCORES[score].optional or "posture" not in SCORES[score].dims
    }
    return _dataset(ground, values, keep, failure)
