"""What is varied: how the arm moves, how long the network learns, and how far true Jacobians are corrupted.

The paper changes noise and learning steps at once (Table 1). Here both are crossed, so that each has its own effect;
the paper's own two pairs are marked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bodyimage_kin.body.check import check_embodiment, refuse_errors
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.estimators import PaperMLP
from bodyimage_kin.metrics.probes import Face, Training
from bodyimage_kin.published.fuke2007.corruption import DOSES, Corrupted
from bodyimage_kin.published.fuke2007.scores import FACTS, SCORES
from bodyimage_kin.recordings import Noise
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.study import Row, Simulation, Study, specs

__all__ = [
    "BLINDNESS",
    "CONDITIONS",
    "DIRECT",
    "ESTIMATORS",
    "GAMMA",
    "MOTIONS",
    "NETWORK",
    "NULLS",
    "Condition",
    "check",
    "corrupted_row",
    "grid",
    "network",
]

GAMMA = 40.0
"""Scaling factor of the taxels' activation (Table 1)."""
DIRECT = "direct"
"""The row that is handed the true image of the hand: no Jacobian in it."""
NETWORK = "paper_mlp"
BLINDNESS = "noise_free"
"""The recording on which true Jacobians are corrupted."""
_SNAPSHOTS = (0.0, 0.15, 0.3, 0.45, 0.6, 0.9, 1.0)
"""Shares of all map steps at which maps are kept: 0, 1200, 2400, 3600, 4800, 7200 and 8000 of 8000 (Fig. 10)."""
_FIRST_MAPS = 10
"""First maps over the first seed's recording, as in the paper's Fig. 11."""
_SAMPLING = 0.1
MOTIONS: Mapping[str, Mapping[str, Any]] = {
    "kinematic": {"dynamics": False},
    "noise_free": {},
    "noisy": {"noise": Noise(torque=0.1)},
}
"""Recording -> how the arm moves: led with the least displacement, or passive, without and with torque noise."""


@dataclass(frozen=True)
class Condition:
    """One way to run the experiment.

    Attributes:
        name: Its name in results.
        recording: How the arm moves, one of :data:`MOTIONS`.
        steps: Descent steps of the paper's network.
        paper: Whether the paper has this pair of noise and steps.
    """

    name: str
    recording: str
    steps: int
    paper: bool = False

    def row(self, estimator: str) -> str:
        """The row of the study that an estimator is in this condition."""
        return f"{NETWORK}_{self.steps}" if estimator == NETWORK else estimator


CONDITIONS = (
    Condition("kinematic", "kinematic", steps=200),
    Condition("noise_free_200", "noise_free", steps=200, paper=True),
    Condition("noise_free_500", "noise_free", steps=500),
    Condition("noisy_200", "noisy", steps=200),
    Condition("noisy_500", "noisy", steps=500, paper=True),
)
NULLS: Mapping[str, Mapping[str, Any]] = {
    f"null_{specs.snake(name)}": {f"bodyimage_kin.estimators.nulls:{name}": {"truth": {"Analytic": {}}}}
    for name in ("Scaled", "Rotated", "RankOne", "OtherArm", "Zero")
}
"""Rows of true Jacobians spoiled beyond use, to which each claim is put: a tenth of the size, turned by 30 degrees, of
rank one, another arm's, zero."""
ESTIMATORS = (NETWORK, "least_squares", "least_squares_scaled", "analytic", "analytic_midpoint", DIRECT)
"""Rows of every condition."""


def network(steps: int) -> PaperMLP:
    """The paper's network."""
    return PaperMLP(hidden=10, learning_rate=0.2, steps=steps)


def corrupted_row(kind: str, dose: float) -> str:
    """Name of the row of a corrupted truth."""
    return f"{kind}_{dose:g}"


def check(embodiment: str = "infant", mesh_folder: Path | None = None) -> None:
    """Looks at a body before anything is computed.

    Args:
        embodiment: Name, or path of a TOML file.
        mesh_folder: As of :func:`bodyimage_kin.load_embodiment`.

    Raises:
        InvalidConfig: A body that is unfit for the protocol: the eye sees the hand while it touches, or does not see
            the circle, or a taxel is out of reach.
        UnknownName: No such embodiment.
    """
    body = load_embodiment(embodiment, mesh_folder=mesh_folder)
    refuse_errors(body, check_embodiment(body, paper=True))


def grid(
    embodiment: str = "infant",
    seeds: int = 10,
    *,
    quick: bool = False,
    backend: str | None = None,
    mesh_folder: Path | None = None,
    folder: Path = Path(),
) -> Study:
    """The experiment as a study.

    Args:
        embodiment: Name, or path of a TOML file.
        seeds: Recordings of each motion.
        quick: A tenth of the touching time, for a first look.
        backend: Kinematics backend; None: the default.
        mesh_folder: As of :func:`bodyimage_kin.load_embodiment`.
        folder: Where relative paths begin.

    Raises:
        InvalidConfig: No recordings.
        UnknownName: No such embodiment.
    """
    duration = 80.0 if quick else 800.0
    touching, tour = RandomTouch(duration=duration, sampling=_SAMPLING), FaceTour(sampling=_SAMPLING)
    recordings = {
        name: Simulation(Circle(sampling=_SAMPLING), use=touching, tour=tour, **how) for name, how in MOTIONS.items()
    }
    rows: dict[str, Any] = {
        f"{NETWORK}_{steps}": Row(
            network(steps),
            on=tuple(one.recording for one in CONDITIONS if one.steps == steps),
            first_maps={"0": _FIRST_MAPS},
        )
        for steps in (200, 500)
    }
    rows |= {
        "least_squares": "LeastSquares",
        "least_squares_scaled": Row("LeastSquares", told={"scale": "depth_ratio"}),
        "analytic": "Analytic",
        "analytic_midpoint": Row("Analytic", method="midpoint"),
        DIRECT: Row(),
    }
    judged = tuple(name for name in MOTIONS if name != "kinematic")
    rows |= {name: Row(table, on=judged, first_maps={"0": _FIRST_MAPS}) for name, table in NULLS.items()}
    for kind, doses in DOSES.items():
        for dose in doses:
            rows[corrupted_row(kind, dose)] = Row(Corrupted(None, kind, dose), on=(BLINDNESS,))
    steps = round(duration / _SAMPLING)
    how = {"backend": backend, "mesh_folder": None if mesh_folder is None else mesh_folder.absolute().as_posix()}
    return Study(
        {"body": {"embodiment": embodiment, **{name: one for name, one in how.items() if one}}},
        recordings,
        rows,
        probes={"on_circle": Training(), "in_front": Face(0.03), "on_face": Face()},
        seeds=seeds,
        scores=SCORES,
        facts=FACTS,
        maps={"gamma": GAMMA, "snapshots": [round(share * steps) for share in _SNAPSHOTS]},
        folder=folder,
    )
