"""The reproduction of Fuke, Ogino and Asada (2007) as figures and one page."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from matplotlib.figure import Figure

from bodyimage_kin._embodiment_file import load_embodiment
from bodyimage_kin._files import write_text
from bodyimage_kin.embodiment import Embodiment
from bodyimage_kin.report import figures, style
from bodyimage_kin.study.fuke2007 import DIRECT, PROBES, Cell, Settings, series, true_map

_SHOWN = ("paper_mlp", "least_squares", "analytic")
_CHANCE_TAXELS = 320.0
"""Topological error of a random 21 x 21 map, about; drawn as a line of reference."""


def write_reproduction(settings: Settings, cells: Sequence[Cell], summary: Mapping[str, Any], folder: Path) -> Path:
    """Writes all figures (SVG and PNG) and ``report.html`` into a folder.

    Args:
        settings: Of the run.
        cells: What :func:`bodyimage_kin.study.fuke2007.run` gave.
        summary: The same in numbers.
        folder: Figures go to ``folder/figures``.

    Returns:
        The page.
    """
    body = load_embodiment(settings.embodiment, settings.backend)
    pictures = {}
    for name, (figure, title, text) in _figures(body, cells).items():
        svg, _ = style.save(figure, folder / "figures", name)
        pictures[name] = {"title": title, "text": text, "data": base64.b64encode(svg.read_bytes()).decode()}
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("bodyimage_kin.report"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("fuke2007.html").render(
        pictures=pictures,
        conditions=summary["conditions"],
        seeds=summary["seeds"],
        versions=summary["versions"],
        quick=settings.quick,
        embodiment=body.name,
        labels=style.LABELS,
        probes=PROBES,
        direct=DIRECT,
        millimetres=lambda value: "–" if value is None else f"{1000 * value:.1f}",
        number=lambda value, digits=2: "–" if value is None else f"{value:.{digits}f}",
    )
    write_text(folder / "report.html", page)
    return folder / "report.html"


def _figures(body: Embodiment, cells: Sequence[Cell]) -> dict[str, tuple[Figure, str, str]]:
    """Name -> figure, title and what it shows."""
    condition = cells[0].condition
    of_condition = list(series(cells, condition))
    first = of_condition[0]
    velocity = {name: _velocity(first.scored[name].tour_image) for name in _SHOWN}
    touched = body.touch_postures([body.skin.landmarks["nose"]])[0]
    taxels = {name: body.skin.landmarks[name] for name in body.skin.landmarks}
    perfect = true_map(body)
    places = {name: perfect.reshape(-1, body.m)[taxel] for name, taxel in taxels.items()}
    times = 0.1 * np.arange(len(first.tour_image) - 1)
    return {
        "robot": (
            figures.touching_face(
                body.robot,
                body.robot.named(body.full_posture(touched)),
                body.skin.positions.numpy(),
                taxels,
                first.circle_position,
            ),
            "The robot touches its own face",
            "Drawn from the URDF's own geometry. The dashed circle is what the hand does in view, where the Jacobian "
            "is learned; the dots are the taxels of the face, where it is used and nothing is seen.",
        ),
        "fig08_velocities": (
            figures.velocities(times, _velocity(first.tour_image), velocity),
            "Velocity of the unseen hand (Fig. 8)",
            "The hand visits mouth, nose, right eye, left eye and nose again; first recording. The true Jacobian is "
            "shown beside the learned ones.",
        ),
        "fig09_trajectories": (
            figures.trajectories(first.tour_image, {name: first.scored[name].tour_image for name in _SHOWN}, places),
            "Trajectory of the unseen hand (Fig. 9)",
            "The same motion integrated from the mouth's true image.",
        ),
        "fig10_maps": (
            figures.map_snapshots(
                {name: mapped.maps for name, mapped in first.mapped.items()},
                first.mapped[DIRECT].steps,
                taxels,
                true_map=perfect,
            ),
            "The tactile map as it is learned (Fig. 10)",
            "Where each taxel is thought to be, first recording; the true places are drawn faintly behind.",
        ),
        "fig11_topological_error": (
            figures.topological_error(
                first.mapped[DIRECT].steps,
                {name: [cell.mapped[name].topological_errors for cell in of_condition] for name in first.mapped},
                spans={name: [cell.mapped[name].spans.mean(axis=-1) for cell in of_condition] for name in first.mapped},
                chance=_CHANCE_TAXELS,
            ),
            "Topological error (Fig. 11), and the span it does not see",
            "Mean and standard deviation over recordings. A map that collapses to a point has no topological error, so "
            "its span stands beside it: even a perfectly seen hand leaves a map smaller than the face, by the kernel.",
        ),
        "jacobian_error_by_distance": (
            figures.error_by_distance(
                {probe: 100 * np.concatenate([cell.distance[probe] for cell in of_condition]) for probe in PROBES},
                {
                    name: {
                        probe: np.concatenate([cell.scored[name].error_by_posture[probe] for cell in of_condition])
                        for probe in PROBES
                    }
                    for name in _SHOWN
                    if name != "analytic"
                },
                distance_label="distance of the hand from the seen circle [cm]",
            ),
            "Error of the Jacobian against distance from what was seen",
            "Relative Frobenius error at each posture, on the circle, 3 cm in front of the face and on it. "
            "A Jacobian of zeros has error 1, the analytic one 0.",
        ),
    }


def _velocity(image: np.ndarray) -> np.ndarray:
    """Velocity [m/s] of an image sampled every 0.1 s."""
    return np.diff(image, axis=0) / 0.1
