"""From what a user names, a recording, a study or an embodiment, to the scene that shows it."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin import calibration
from bodyimage_kin._checks import whole
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.file import embodiments, load_embodiment
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig
from bodyimage_kin.estimators import Analytic, Estimator, LeastSquares, PaperMLP, RationalTrig
from bodyimage_kin.metrics.probes import Face, JointSpace, Probe
from bodyimage_kin.recordings import experience, motions, read_recording
from bodyimage_kin.recordings.simulation import simulate
from bodyimage_kin.study import read_study
from bodyimage_kin.study.bodies import body_of
from bodyimage_kin.study.grid import row_of
from bodyimage_kin.study.results import recording_of
from bodyimage_kin.study.specs import ESTIMATOR
from bodyimage_kin.view.scene import Scene, Teacher

__all__ = ["open_scene"]

_TOUCHING = 120.0
"""Of the random touch that an embodiment is shown with [s]."""
_ON_SKIN = {"relative_error_by_posture": "relative error", "critical_gain_by_posture": "critical gain"}


def open_scene(
    target: str | os.PathLike[str] = "infant",
    *,
    embodiment: str | None = None,
    learn_from: str | os.PathLike[str] | None = None,
    mesh_folder: str | os.PathLike[str] | None = None,
    next_postures: int = 0,
) -> Scene:
    """The scene of a recording, of a study or of an embodiment.

    Of a recording: itself, with some estimators that learn from it. Of a study: every recording of its first seed, its
    estimators, and their errors on the skin where these were kept (``per_posture``). Of an embodiment: a circle and a
    random touch, without dynamics, where the hand gets there.

    Args:
        target: A recording's file, a study's folder, or an embodiment's name or TOML file.
        embodiment: Name or TOML file of a recording's body; None: what the recording says.
        learn_from: Another recording that estimators learn from; None: the one that is looked at.
        mesh_folder: Where meshes may be read; None: beside the URDF.
        next_postures: So many postures to go to next, to know the Jacobian on the skin (or everywhere), are shown as
            ghosts; of a study none.

    Raises:
        InvalidConfig: Nothing of these, or a recording that does not say whose it is.
        BodyImageKinError: As reading does.
    """
    place, count = Path(target), whole("next_postures", next_postures, least=0)
    seen = None if learn_from is None else read_recording(learn_from)
    if place.is_dir():
        return _study(place, mesh_folder)
    if str(target) in embodiments() or place.suffix == ".toml":
        return _embodiment(load_embodiment(str(target)), mesh_folder, count)
    if not place.is_file():
        raise InvalidConfig(
            f"'{target}' is no file, no study's folder and no embodiment ({', '.join(embodiments())}); name one"
        )
    recording = read_recording(place)
    named = embodiment or str(recording.attrs.get("embodiment", ""))
    if not named:
        raise InvalidConfig(f"'{place.name}' does not say whose recording it is; give --embodiment NAME or FILE.toml")
    body = load_embodiment(named)
    ghosts = _next(body, recording if seen is None else seen, count)
    return Scene(body, {place.stem: recording}, _estimators(body), seen, ghosts=ghosts, mesh_folder=mesh_folder)


def _estimators(body: Embodiment) -> dict[str, Teacher]:
    return {
        "analytic": Analytic(body),
        "least_squares": LeastSquares(),
        "rational_trig": RationalTrig(),
        "paper_mlp": PaperMLP(),
    }


def _next(body: Embodiment, seen: xr.Dataset | None, count: int) -> np.ndarray | None:
    if count == 0:
        return None
    probe: Probe = Face() if body.skin is not None else JointSpace()
    return calibration.next_postures(body, None if seen is None else experience(seen), probe, count).q


def _embodiment(body: Embodiment, mesh_folder: str | os.PathLike[str] | None, count: int) -> Scene:
    found: dict[str, xr.Dataset] = {}
    ways = {"circle": motions.Circle(), "touch": motions.RandomTouch(duration=_TOUCHING)}
    for name, motion in ways.items():
        try:
            found[name] = simulate(body, motion, seed=0, dynamics=False)
        except BodyImageKinError:
            continue
    estimators = _estimators(body) if found else {}
    seen = found.get("circle")
    return Scene(body, found, estimators, seen, ghosts=_next(body, seen, count), mesh_folder=mesh_folder)


def _study(folder: Path, mesh_folder: str | os.PathLike[str] | None) -> Scene:
    results = read_study(folder)
    config = json.loads(results.attrs["config"])
    name = str(results["embodiment"].values[0])
    table: dict[str, Any] = config["embodiments"][name]
    begin = Path()
    body = body_of(table, begin, folder.absolute())
    if body is None:
        raise InvalidConfig(f"the study in '{folder}' knows no body, and there is none to show; view a recording of it")
    seed = int(results["seed"].values[0])
    recordings: dict[str, xr.Dataset] = {}
    training: xr.Dataset | None = None
    for recording in map(str, results["recording"].values):
        for role in ("training", "use"):
            try:
                found = recording_of(folder, recording, seed, role, name)
            except InvalidConfig:
                continue
            recordings[f"{recording}, {role}"] = found
            training = found if training is None and role == "training" else training
    return Scene(
        body,
        recordings,
        _rows(config["estimators"], begin, body),
        training,
        _scores(results, name, body),
        mesh_folder=mesh_folder,
    )


def _rows(tables: Mapping[str, Any], folder: Path, body: Embodiment) -> dict[str, Teacher]:
    """The estimators of a study that need nothing told beside the experience."""
    found: dict[str, Teacher] = {}
    for name, table in tables.items():
        row = row_of(table, folder)
        if row.estimator is None or row.told:
            continue
        built = ESTIMATOR.build(row.estimator, folder, body)
        if isinstance(built, Estimator):
            found[name] = built
    return found


def _scores(results: xr.Dataset, name: str, body: Embodiment) -> dict[str, np.ndarray]:
    """Scores on the face, one a taxel, means over seeds and recordings."""
    found: dict[str, np.ndarray] = {}
    if body.skin is None or "probe" not in results.dims or "on_face" not in results["probe"].values:
        return found
    for score, said in _ON_SKIN.items():
        if score not in results:
            continue
        one = results[score].sel(embodiment=name, probe="on_face").mean(("recording", "seed"))
        for estimator in map(str, one["estimator"].values):
            values = one.sel(estimator=estimator).values
            if values.size == body.skin.count and np.isfinite(values).any():
                found[f"{said}, {estimator}"] = values
    return found
