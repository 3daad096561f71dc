"""The whole grid of motions and seeds, worked off in processes, and its summary in numbers."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

from bodyimage_kin._files import write_text
from bodyimage_kin.body.check import check_embodiment, refuse_errors
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.published.fuke2007.blindness import DOSES, FALSE_ALARMS, power
from bodyimage_kin.published.fuke2007.cell import Cell, run_cell
from bodyimage_kin.published.fuke2007.claims import judge
from bodyimage_kin.published.fuke2007.conditions import CONDITIONS, MOTIONS, PARTS, PROBES, Settings
from bodyimage_kin.published.fuke2007.scores import Mapped, Scored
from bodyimage_kin.recordings.schema import versions


def check(settings: Settings) -> None:
    """Loads the embodiment once: a wrong name or file, or a body unfit for the protocol, is told here.

    Raises:
        InvalidConfig: The eye sees the hand while it touches, or does not see the circle, or a taxel is out of reach.
    """
    body = load_embodiment(settings.embodiment, settings.backend)
    refuse_errors(body, check_embodiment(body, paper=True))


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
        progress: Called with the number of motions and seeds that are done, and their total.

    Returns:
        Cells in the order of :data:`CONDITIONS`, then of seeds.
    """
    check(settings)
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [(motion, seed) for seed in range(settings.seeds) for motion in MOTIONS]
    cells: dict[tuple[str, int], Cell] = {}
    with _pool(min(workers or os.cpu_count() or 1, len(jobs))) as executor:
        waiting = [executor.submit(run_cell, settings, motion, seed, folder) for motion, seed in jobs]
        try:
            for done, future in enumerate(as_completed(waiting), start=1):
                cells |= {(cell.condition, cell.seed): cell for cell in future.result()}
                progress(done, len(jobs))
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise
    return [cells[condition.name, seed] for condition in CONDITIONS for seed in range(settings.seeds)]


def by_condition(cells: Sequence[Cell]) -> dict[str, list[Cell]]:
    """Condition -> its cells, in order of seed."""
    found: dict[str, list[Cell]] = {}
    for cell in cells:
        found.setdefault(cell.condition, []).append(cell)
    return found


def permuted_error(cells: Sequence[Cell]) -> float:
    """Mean topological error of true Jacobians' maps with their taxels' labels permuted: what chance makes of them."""
    return float(np.mean([cell.blindness.permuted for cell in cells if cell.blindness is not None]))


def summarise(settings: Settings, cells: Sequence[Cell]) -> dict[str, Any]:
    """The run in numbers: means over seeds, not-a-number as None.

    ``jacobian_relative_error_use`` alone is the root of the mean square over seeds, so that the parts of
    ``attribution`` sum to its square on the face.

    Returns:
        ``{"conditions": {condition: {estimator: scores}}, "claims": [...], "blindness": {...}, "seeds": N,
        "versions": {...}}``.
    """
    conditions: dict[str, Any] = {}
    for condition, group in by_condition(cells).items():
        scores: dict[str, Any] = {
            name: _mean_scores([cell.scored[name] for cell in group], [cell.seed for cell in group])
            for name in group[0].scored
        }
        for name in group[0].mapped:
            maps = [cell.mapped[name] for cell in group]
            scores.setdefault(name, {}).update(map=_mean_map(maps), posture_map=_mean_posture_map(maps))
        conditions[condition] = scores
    found = {
        "conditions": conditions,
        "claims": judge(by_condition(cells)),
        "blindness": {
            "false_alarms": FALSE_ALARMS,
            "doses": {kind: list(doses) for kind, doses in DOSES.items()},
            "power": power([cell.blindness for cell in cells if cell.blindness is not None]),
            "permuted_topological_error": permuted_error(cells),
        },
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


def _mean_scores(scored: Sequence[Scored], seeds: Sequence[int]) -> dict[str, Any]:
    def mean(values: Sequence[Any]) -> Any:
        return np.mean(np.asarray(values, dtype=float), axis=0).tolist()

    def each(field: str) -> list[Any]:
        return [getattr(one, field) for one in scored]

    return {
        "velocity_correlation": mean(each("velocity_correlation")),
        "velocity_nrmse": mean(each("velocity_nrmse")),
        "displacement_error": mean(each("displacement_error")),
        "trajectory_rmse": mean(each("trajectory_rmse")),
        "relations_kept": mean(each("relations_kept")),
        "loop_drift": mean(each("loop_drift")),
        "training_residual": mean(each("training_residual")),
        "jacobian_relative_error": {
            probe: mean([one[probe] for one in each("jacobian_relative_error")]) for probe in PROBES
        },
        "jacobian_relative_error_use": {
            probe: math.sqrt(mean([one[probe] ** 2 for one in each("jacobian_relative_error_use")])) for probe in PROBES
        },
        "attribution": {part: mean([one["on_face"][part] for one in each("attribution")]) for part in PARTS},
        "attribution_by_probe": {
            probe: {part: mean([one[probe][part] for one in each("attribution")]) for part in PARTS} for probe in PROBES
        },
        "diverged_seeds": [
            seed
            for seed, one in zip(seeds, scored, strict=True)
            if not (np.isfinite(one.displacement_error) and np.isfinite(one.trajectory_rmse))
        ],
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
        "edge_correlation": float(np.mean([one.edge_correlation for one in mapped])),
    }


def _mean_posture_map(mapped: Sequence[Mapped]) -> dict[str, Any]:
    return {
        score: np.mean([one.posture_scores[score] for one in mapped], axis=0).tolist()
        for score in mapped[0].posture_scores
    }


def _without_nan(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
