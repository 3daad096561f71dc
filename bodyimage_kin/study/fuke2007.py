"""The experiment of Fuke, Ogino and Asada (2007), with the analytic truth beside everything that is learned.

One run is a grid of conditions and seeds. In each cell a Jacobian is learned from the circle in view, tried on the tour
of the face, and integrated to learn the body image while the face is touched at random; the analytic Jacobian and
direct sight of the unseen hand go through the same steps.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.spatial
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin._embodiment_file import load_embodiment
from bodyimage_kin._files import write_text
from bodyimage_kin.body_image import BodyImage, integrate
from bodyimage_kin.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators import Analytic, Estimator, LearnedJacobian, LeastSquares, PaperMLP
from bodyimage_kin.recordings import experience, simulate, write_recording
from bodyimage_kin.recordings.schema import versions

PROBES = ("on_circle", "in_front", "on_face")
"""Posture sets that leave what was seen step by step: seen postures, taxels 3 cm off, taxels touched."""
DIRECT = "direct"
"""The map learned from direct sight of the hand: no Jacobian in it."""
_IN_FRONT = 0.03
_SNAPSHOTS = (0.0, 0.15, 0.3, 0.45, 0.6, 0.9, 1.0)
"""Shares of all map steps at which maps are kept: 0, 1200, 2400, 3600, 4800, 7200 and 8000 of 8000 (Fig. 10)."""


@dataclass(frozen=True)
class Condition:
    """One way to run the experiment.

    Attributes:
        name: Its name in results.
        steps: Descent steps of the paper's network.
    """

    name: str
    steps: int


CONDITIONS = (Condition("kinematic", steps=200),)


@dataclass(frozen=True)
class Settings:
    """What a run is asked for.

    Attributes:
        embodiment: Name, or path of a TOML file.
        seeds: Number of recordings.
        quick: A tenth of the touching time, for a first look.
        backend: Kinematics backend; None: the default.
    """

    embodiment: str = "infant"
    seeds: int = 10
    quick: bool = False
    backend: str | None = None

    def __post_init__(self) -> None:
        if self.seeds < 1:
            raise InvalidConfig(f"seeds={self.seeds}: give a whole number of at least 1")

    @property
    def touch_duration(self) -> float:
        """How long the face is touched [s]."""
        return 80.0 if self.quick else 800.0


@dataclass(frozen=True, eq=False)
class Scored:
    """What came of one estimator in one cell.

    Attributes:
        velocity_correlation: (m,) on the tour.
        velocity_nrmse: (m,) on the tour.
        displacement_error: On the tour.
        trajectory_rmse: On the tour [m].
        jacobian_relative_error: Probe -> pooled relative error.
        error_by_posture: Probe -> (postures,) relative error.
        tour_image: (time, m) integrated hand image on the tour [m].
    """

    velocity_correlation: Float[np.ndarray, "m"]
    velocity_nrmse: Float[np.ndarray, "m"]
    displacement_error: float
    trajectory_rmse: float
    jacobian_relative_error: Mapping[str, float]
    error_by_posture: Mapping[str, np.ndarray]
    tour_image: Float[np.ndarray, "time m"]


@dataclass(frozen=True, eq=False)
class Mapped:
    """The tactile map that one source of hand images led to.

    Attributes:
        steps: Steps of the snapshots.
        maps: (snapshots, rows, columns, m) [m].
        topological_errors: One a snapshot.
        spans: (snapshots, m).
        final: Scores of the last map.
    """

    steps: Sequence[int]
    maps: Float[np.ndarray, "snapshots rows columns m"]
    topological_errors: Sequence[int]
    spans: Float[np.ndarray, "snapshots m"]
    final: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Cell:
    """Everything that came of one condition and seed.

    Attributes:
        condition: Name of the condition.
        seed: The seed.
        scored: Estimator -> scores.
        mapped: Estimator, or :data:`DIRECT` -> map.
        tour_image: (time, m) true hand image on the tour [m].
        circle_position: (time, 3) true hand position on the circle, in the root [m].
        distance: Probe -> (postures,) distance of the hand from the nearest seen place [m].
    """

    condition: str
    seed: int
    scored: Mapping[str, Scored]
    mapped: Mapping[str, Mapped]
    tour_image: Float[np.ndarray, "time m"]
    circle_position: Float[np.ndarray, "time 3"]
    distance: Mapping[str, np.ndarray]


def estimators(body: Embodiment, condition: Condition) -> dict[str, Estimator]:
    """The rivals of a condition, by name."""
    return {
        "paper_mlp": PaperMLP(steps=condition.steps),
        "least_squares": LeastSquares(),
        "analytic": Analytic(body),
    }


def true_map(body: Embodiment) -> Float[np.ndarray, "rows columns m"]:
    """Where the hand's image is while it touches each taxel [m]: what a perfect map holds."""
    with torch.no_grad():
        image = body.hand_image(body.touch_postures(np.arange(body.skin.count)))
    return image.numpy().reshape(*body.skin.shape, body.m)


def run_cell(settings: Settings, condition: Condition, seed: int, folder: Path) -> Cell:
    """One condition and seed; the recordings are written into the folder.

    Args:
        settings: Of the run.
        condition: Which one.
        seed: Of recordings, first weights and first maps.
        folder: Where the recordings go, ``CONDITION_seedSEED_KIND.nc``.
    """
    torch.set_num_threads(1)
    body = load_embodiment(settings.embodiment, settings.backend)
    recordings = {
        "circle": simulate.circle(body, seed=seed),
        "face_tour": simulate.face_tour(body, seed=seed),
        "random_touch": simulate.random_touch(body, seed=seed, duration=settings.touch_duration),
    }
    for kind, recording in recordings.items():
        write_recording(recording, folder / f"{condition.name}_seed{seed}_{kind}.nc")
    circle, tour, touch = recordings.values()
    learned = {name: spec.fit(experience(circle), seed=seed) for name, spec in estimators(body, condition).items()}
    probes = probe_postures(body, circle)
    truth = {probe: body.hand_image_jacobian(q).numpy() for probe, q in probes.items()}
    perfect = true_map(body)
    felt = experience(touch)
    image_range = _image_range(circle)
    mapped = {
        name: _map(felt, integrate(felt, jacobian), perfect, seed, image_range) for name, jacobian in learned.items()
    }
    mapped[DIRECT] = _map(felt, touch["true_hand_image"], perfect, seed, image_range)
    return Cell(
        condition=condition.name,
        seed=seed,
        scored={name: _score(body, jacobian, tour, probes, truth) for name, jacobian in learned.items()},
        mapped=mapped,
        tour_image=tour["true_hand_image"].values[0],
        circle_position=circle["true_hand_position"].values[0],
        distance=_distance(body, circle, probes),
    )


def probe_postures(body: Embodiment, circle: xr.Dataset) -> dict[str, Float[torch.Tensor, "postures p"]]:
    """The posture sets at which Jacobians are scored, :data:`PROBES`."""
    seen = circle["true_q"].values.reshape(-1, body.p)
    everywhere = np.arange(body.skin.count)
    return {
        "on_circle": torch.from_numpy(seen[np.isfinite(seen).all(1)]),
        "in_front": body.touch_postures(everywhere, _IN_FRONT),
        "on_face": body.touch_postures(everywhere),
    }


def check(settings: Settings) -> None:
    """Loads the embodiment once: a wrong name or file is told here, and not by every worker."""
    load_embodiment(settings.embodiment, settings.backend)


def run(
    settings: Settings,
    folder: Path,
    *,
    workers: int | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Cell]:
    """Every condition and seed, in a pool of processes.

    The result is the same to the bit whatever the number of workers: each cell has one thread and streams of its own.

    Args:
        settings: Of the run.
        folder: Where recordings go; made when missing.
        workers: Number of processes; None: one a core.
        progress: Called with the number of cells done and their total.
    """
    check(settings)
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [(condition, seed) for condition in CONDITIONS for seed in range(settings.seeds)]
    workers = min(workers or os.cpu_count() or 1, len(jobs))
    cells: dict[tuple[str, int], Cell] = {}
    with _pool(workers) as executor:
        waiting = [executor.submit(run_cell, settings, condition, seed, folder) for condition, seed in jobs]
        try:
            for future in as_completed(waiting):
                cell = future.result()
                cells[cell.condition, cell.seed] = cell
                progress(len(cells), len(jobs))
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise
    return [cells[condition.name, seed] for condition, seed in jobs]


def summary(settings: Settings, cells: Sequence[Cell]) -> dict[str, Any]:
    """The run in numbers: means over seeds, not-a-number as None.

    Returns:
        ``{"conditions": {condition: {estimator: scores}}, "seeds": N, "versions": {...}}``.
    """
    conditions: dict[str, Any] = {}
    for condition in dict.fromkeys(cell.condition for cell in cells):
        of_condition = [cell for cell in cells if cell.condition == condition]
        scores: dict[str, Any] = {
            name: _mean_scores([cell.scored[name] for cell in of_condition]) for name in of_condition[0].scored
        }
        for name in of_condition[0].mapped:
            scores.setdefault(name, {})["map"] = _mean_map([cell.mapped[name] for cell in of_condition])
        conditions[condition] = scores
    found = {
        "conditions": conditions,
        "seeds": settings.seeds,
        "versions": versions(),
    }
    return dict(_without_nan(found))


def write_summary(found: Mapping[str, Any], path: Path) -> None:
    """Writes a summary as JSON, atomically."""
    write_text(path, json.dumps(found, indent=2, allow_nan=False) + "\n")


def _pool(workers: int) -> Executor:
    # Forked children would inherit torch's threads in whatever state they are.
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))


def _score(
    body: Embodiment,
    learned: LearnedJacobian,
    tour: xr.Dataset,
    probes: Mapping[str, torch.Tensor],
    truth: Mapping[str, np.ndarray],
) -> Scored:
    """Scores of a learned Jacobian on the tour and at the probes."""
    image = tour["true_hand_image"].values[0]
    q = torch.from_numpy(tour["true_q"].values[0])
    dq = q[1:] - q[:-1]
    with torch.no_grad():
        foreseen = learned.displacement(q[:-1], dq).numpy()
        linear = (body.hand_image_jacobian(q[:-1]) @ dq[..., None])[..., 0].numpy()
        estimated = {probe: learned.jacobian(postures).numpy() for probe, postures in probes.items()}
    integrated = integrate(experience(tour), learned, reset="none", initial=image[0]).values[0]
    velocity, estimated_velocity = np.diff(image, axis=0), np.diff(integrated, axis=0)
    return Scored(
        velocity_correlation=metrics.velocity_correlation(velocity, estimated_velocity),
        velocity_nrmse=metrics.velocity_nrmse(velocity, estimated_velocity),
        displacement_error=metrics.displacement_error(foreseen, linear),
        trajectory_rmse=metrics.trajectory_rmse(image, integrated),
        jacobian_relative_error={
            probe: metrics.pooled_relative_error(truth[probe], estimated[probe]) for probe in probes
        },
        error_by_posture={probe: metrics.relative_error(truth[probe], estimated[probe]) for probe in probes},
        tour_image=integrated,
    )


def _map(
    felt: xr.Dataset, hand: xr.DataArray, perfect: np.ndarray, seed: int, image_range: Float[np.ndarray, "m 2"]
) -> Mapped:
    """The tactile map that these hand images lead to, and its scores at each snapshot."""
    steps = felt.sizes["time"]
    snapshots = [round(share * steps) for share in _SNAPSHOTS]
    learned = BodyImage.learn(
        felt, hand, seed=seed, grid=perfect.shape[:2], snapshots=snapshots, image_range=image_range
    )
    maps = np.asarray(learned.history["tactile_maps"])
    return Mapped(
        steps=[int(step) for step in learned.history["steps"]],
        maps=maps,
        topological_errors=[metrics.topological_error(map) for map in maps],
        spans=np.array([metrics.span(map, perfect) for map in maps]),
        final=metrics.scores(maps[-1], perfect),
    )


def _image_range(circle: xr.Dataset) -> Float[np.ndarray, "m 2"]:
    """Lowest and highest image of the hand that was ever seen [m]: first maps are drawn from there."""
    seen = circle["hand_image"].values.reshape(-1, circle.sizes["axis"])
    return np.stack([np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)], axis=1)


def _distance(body: Embodiment, circle: xr.Dataset, probes: Mapping[str, torch.Tensor]) -> dict[str, np.ndarray]:
    """How far the hand is from where it was ever seen [m]."""
    seen = circle["true_hand_position"].values.reshape(-1, 3)
    tree = scipy.spatial.KDTree(seen[np.isfinite(seen).all(1)])
    with torch.no_grad():
        return {probe: np.asarray(tree.query(body.hand_position(q).numpy())[0]) for probe, q in probes.items()}


def _mean_scores(scored: Sequence[Scored]) -> dict[str, Any]:
    def mean(field: str) -> Any:
        return np.mean([getattr(one, field) for one in scored], axis=0).tolist()

    return {
        "velocity_correlation": mean("velocity_correlation"),
        "velocity_nrmse": mean("velocity_nrmse"),
        "displacement_error": mean("displacement_error"),
        "trajectory_rmse": mean("trajectory_rmse"),
        "jacobian_relative_error": {
            probe: float(np.mean([one.jacobian_relative_error[probe] for one in scored])) for probe in PROBES
        },
    }


def _mean_map(mapped: Sequence[Mapped]) -> dict[str, Any]:
    errors = np.array([one.topological_errors for one in mapped], dtype=float)
    spread = errors.std(axis=0, ddof=1) if len(mapped) > 1 else np.full(errors.shape[1], np.nan)
    final = {
        score: np.mean([one.final[score] for one in mapped], axis=0).tolist()
        for score in ("span", "folded_cells", "disparity", "scale")
    }
    return {
        "steps": list(mapped[0].steps),
        "topological_error_mean": errors.mean(axis=0).tolist(),
        "topological_error_sd": spread.tolist(),
        **final,
    }


def _without_nan(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def series(cells: Sequence[Cell], condition: str) -> Iterator[Cell]:
    """The cells of one condition, in order of seed."""
    return (cell for cell in cells if cell.condition == condition)
