"""The reproduction of Fuke, Ogino and Asada (2007) as one page."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin import figures
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.published import fuke2007
from bodyimage_kin.published.fuke2007 import CONDITIONS, DIRECT, PROBES
from bodyimage_kin.report._fuke2007 import PAPER, Run, pictures_of
from bodyimage_kin.report._limbs import limbs
from bodyimage_kin.report._page import Picture, inlined, write_page
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.geometry import Mesh
from bodyimage_kin.robot.meshes import mesh_path

__all__ = ["write_reproduction"]

_LABELS = {
    "kinematic": "kinematic, 200 steps",
    "noise_free_200": "no noise, 200 steps",
    "noise_free_500": "no noise, 500 steps",
    "noisy_200": "noise, 200 steps",
    "noisy_500": "noise, 500 steps",
}


def write_reproduction(
    results: xr.Dataset, summary: Mapping[str, Any], store: Path, folder: Path, *, quick: bool = False
) -> Path:
    """Writes all figures (SVG, PNG and CSV) and ``report.html`` into a folder.

    Args:
        results: Of the study that :func:`bodyimage_kin.published.fuke2007.grid` gives.
        summary: What :func:`bodyimage_kin.published.fuke2007.judge` says of them.
        store: Folder of the study.
        folder: Figures go to ``folder/figures``.
        quick: Whether the face was touched for a tenth of the time.

    Returns:
        The page.
    """
    run = Run(results, store, _body(results))
    with figures.labelled(_LABELS):
        files = _draw_all(run, folder / "figures")
        pictures = [
            inlined(picture, files[picture.name][0].read_text("utf-8"), _text(files[picture.name][2:]), index)
            for index, picture in enumerate(pictures_of(run))
        ]
        write_page(
            folder / "report.html",
            "fuke2007.html",
            pictures=pictures,
            sentences=_sentences(run, summary),
            summary=summary,
            table_1=_table_1(run.body),
            limbs=limbs(run.body.robot),
            body=run.body,
            quick=quick,
            conditions=CONDITIONS,
            probes=PROBES,
            direct=DIRECT,
            chance=summary["blindness"]["permuted_topological_error"],
            steps=run.steps,
        )
    return folder / "report.html"


def _body(results: xr.Dataset) -> Embodiment:
    config = json.loads(results.attrs["config"])
    (table,) = config["embodiments"].values()
    body = load_embodiment(table["embodiment"], table.get("backend"), mesh_folder=table.get("mesh_folder"))
    return replace(body, robot=_drawable(body.robot))


def _drawable(robot: Robot) -> Robot:
    """The robot, drawn as rods where a mesh of its visuals is not there: what was computed is worth a page."""
    try:
        for link, geometry in robot.geometry.items():
            for visual in geometry.visuals:
                if isinstance(visual.shape, Mesh):
                    mesh_path(visual.shape, link, robot.file, robot.mesh_folder)
    except InvalidGeometry:
        bare = {link: replace(geometry, visuals=()) for link, geometry in robot.geometry.items()}
        return replace(robot, geometry=bare)
    return robot


def _draw_all(run: Run, folder: Path) -> dict[str, tuple[Path, ...]]:
    """Draws and saves every figure, in this process and another: one begins at the first, the other at the last.

    Returns:
        Name -> files, SVG first.
    """
    saved: dict[str, tuple[Path, ...]] = {}
    pictures = pictures_of(run)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        theirs = {
            picture.name: executor.submit(_draw, run.results, run.store, folder, picture.name)
            for picture in pictures[::-1]
        }
        for picture in pictures:
            # What the other has not begun is drawn here.
            if theirs[picture.name].cancel():
                saved[picture.name] = _save(picture, folder)
        return saved | {name: future.result() for name, future in theirs.items() if not future.cancelled()}


def _draw(results: xr.Dataset, store: Path, folder: Path, name: str) -> tuple[Path, ...]:
    run = Run(results, store, _body(results))
    with figures.labelled(_LABELS):
        return _save(next(one for one in pictures_of(run) if one.name == name), folder)


def _save(picture: Picture, folder: Path) -> tuple[Path, ...]:
    with figures.style():
        return figures.save(picture.draw(), folder, picture.name)


def _text(files: Sequence[Path]) -> str:
    return files[0].read_text("utf-8") if files else ""


def _table_1(body: Embodiment) -> list[tuple[str, str, str]]:
    """The parameters of the experiment, the paper's (its Table 1) beside those that were really used."""
    quiet, noisy = (condition for condition in CONDITIONS if condition.paper)
    rows = [
        ("scaling factor \N{GREEK SMALL LETTER GAMMA} of the touched taxels (eq. 16)", "40", f"{fuke2007.GAMMA:g}"),
        ("distance h_z of the virtual screen (Fig. 6)", "0.04 m", f"{body.camera.screen.distance:g} m"),
    ]
    for condition, said, steps in ((quiet, "without noise", "200"), (noisy, "with noise", "500")):
        network = fuke2007.network(condition.steps)
        rows += [
            (f"back-propagation {said}: learning rate", "0.2", f"{network.learning_rate:g}"),
            (f"back-propagation {said}: learning steps", steps, f"{network.steps:g}"),
            (f"back-propagation {said}: hidden units", "10", f"{network.hidden:g}"),
        ]
    # The random torque is drawn about zero (bodyimage_kin.recordings.dynamics); the paper gives no unit.
    variance = f"{fuke2007.MOTIONS[noisy.recording]['noise'].torque ** 2:g} N\N{SUPERSCRIPT TWO}m\N{SUPERSCRIPT TWO}"
    return [
        *rows,
        ("noise: mean of the normal distribution", "0.0", "0.0"),
        ("noise: variance of the normal distribution", "0.01", variance),
    ]


def _sentences(run: Run, summary: Mapping[str, Any]) -> list[str]:
    """The page in three sentences, every number from the run."""
    noisy = summary["conditions"][PAPER[-1]]
    net, flat, direct = noisy["paper_mlp"], noisy["least_squares"], noisy[DIRECT]
    size = np.mean(net["map"]["span"]) / np.mean(direct["map"]["span"])
    paper = [claim for claim in summary["claims"] if claim["asked_by"] == "paper" and claim["holds"] is not None]
    rival = "more" if flat["displacement_error"] > net["displacement_error"] else "less"
    seen = summary["blindness"]["power"]
    half = fuke2007.DOSES["scale"].index(0.5)
    noticed = ", ".join(
        f"{name} in {100 * seen['scale'][measure][half]:.0f} %"
        for measure, name in (
            ("velocity_correlation", "velocity correlation"),
            ("topological_error", "the topological error"),
            ("trajectory_rmse", "the trajectory's position error"),
        )
    )
    wrong = net["map"]["topological_error_mean"][-1]
    count = run.body.require_skin().count
    order = f"{wrong:.1f} of {count} taxels out of order" if wrong >= 0.05 else "no taxel out of order"
    idle = sum(claim["met"] and claim["cannot_fail"] for claim in paper)
    holding = sum(claim["holds"] for claim in paper)
    verdict = (
        f"{holding} of the paper's {len(paper)} claims {'holds' if holding == 1 else 'hold'} by criteria written "
        f"beforehand; {idle} more are met by spoiled truths too, and so say nothing. "
        if paper
        else ""
    )
    return [
        "A robot watches its hand circle in view and learns how joint motion moves the hand in its image; then it "
        "touches its face, where it cannot see the hand, and sums what it learned to know where it is touching: the "
        "experiment of Fuke, Ogino and Asada (2007), held against the exact truth.",
        f"On the face the paper's network gets the direction of motion right (velocity correlation "
        f"{min(net['velocity_correlation']):.2f}) but not its size: displacements are "
        f"{100 * net['displacement_error']:.0f} % off (one constant matrix, by least squares: {rival}, "
        f"{100 * flat['displacement_error']:.0f} %), and the map of the face, with {order}, is {size:.2f} times as "
        "large as the one that direct sight of the hand leads to.",
        f"{verdict}The paper's measures do not look at size: when true Jacobians are cut to half, this is noticed by "
        f"{noticed} of recordings.",
    ]
