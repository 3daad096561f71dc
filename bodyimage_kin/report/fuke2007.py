"""The reproduction of Fuke, Ogino and Asada (2007) as figures and one page."""

from __future__ import annotations

import base64
import multiprocessing
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from matplotlib.figure import Figure

from bodyimage_kin._files import write_text
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.figures import body_figures, figures, specification, style
from bodyimage_kin.published import fuke2007
from bodyimage_kin.published.fuke2007 import CONDITIONS, DIRECT, PARTS, PROBES, Cell, Settings

_SHOWN = ("paper_mlp", "least_squares", "analytic")
_MAPPED = (*_SHOWN, DIRECT)
_PAPER = tuple(condition.name for condition in CONDITIONS if condition.paper)
"""The paper's own two pairs of noise and steps: without noise, and with."""
_CONDITION_LABELS = {
    "kinematic": "kinematic, 200 steps",
    "noise_free_200": "no noise, 200 steps",
    "noise_free_500": "no noise, 500 steps",
    "noisy_200": "noise, 200 steps",
    "noisy_500": "noise, 500 steps",
}

_DOSE_LABELS = {
    "scale": "factor",
    "rotation": "turn in the image [degrees]",
    "rank": "share of the smaller singular value taken away",
    "noise": "norm of a constant random matrix, relative",
}


@dataclass(frozen=True, eq=False)
class Picture:
    """One figure of the page.

    Attributes:
        name: Of its files.
        section: Which part of the page it stands in.
        draw: Draws the figure.
        title: One line.
        text: What it shows.
    """

    name: str
    section: str
    draw: Callable[[], Figure]
    title: str
    text: str


def write_reproduction(settings: Settings, cells: Sequence[Cell], summary: Mapping[str, Any], folder: Path) -> Path:
    """Writes all figures (SVG and PNG) and ``report.html`` into a folder.

    Args:
        settings: Of the run.
        cells: What :func:`bodyimage_kin.published.fuke2007.run` gave.
        summary: The same in numbers.
        folder: Figures go to ``folder/figures``.

    Returns:
        The page.
    """
    body = load_embodiment(settings.embodiment, settings.backend)
    groups = fuke2007.by_condition(cells)
    pictures = []
    drawn = _draw_all(settings, cells, folder / "figures")
    for picture in _pictures(body, groups):
        data = base64.b64encode(drawn[picture.name].read_bytes()).decode()
        pictures.append({"section": picture.section, "title": picture.title, "text": picture.text, "data": data})
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("bodyimage_kin.report"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("fuke2007.html").render(
        pictures=pictures,
        sentences=_sentences(groups, summary),
        summary=summary,
        table_1=_table_1(body),
        settings=settings,
        conditions=CONDITIONS,
        condition_labels=_CONDITION_LABELS,
        embodiment=body.name,
        labels=style.LABELS,
        probes=PROBES,
        parts=PARTS,
        direct=DIRECT,
        chance=fuke2007.permuted_error(cells),
        millimetres=lambda value, digits=1: "–" if value is None else f"{1000 * value:.{digits}f}",  # noqa: RUF001
        number=lambda value, digits=2: "–" if value is None else f"{value:.{digits}f}",  # noqa: RUF001
    )
    write_text(folder / "report.html", page)
    return folder / "report.html"


def _draw_all(settings: Settings, cells: Sequence[Cell], folder: Path) -> dict[str, Path]:
    """Draws and saves every figure, in this process and another: one begins at the first, the other at the last.

    Returns:
        Name -> SVG.
    """
    drawn: dict[str, Path] = {}
    body = load_embodiment(settings.embodiment, settings.backend)
    pictures = _pictures(body, fuke2007.by_condition(cells))
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        theirs = {
            picture.name: executor.submit(_draw, settings, cells, folder, picture.name) for picture in pictures[::-1]
        }
        for picture in pictures:
            # What the other has not begun is drawn here.
            if theirs[picture.name].cancel():
                drawn[picture.name] = style.save(picture.draw(), folder, picture.name)[0]
        return drawn | {name: future.result() for name, future in theirs.items() if not future.cancelled()}


def _draw(settings: Settings, cells: Sequence[Cell], folder: Path, name: str) -> Path:
    body = load_embodiment(settings.embodiment, settings.backend)
    picture = next(one for one in _pictures(body, fuke2007.by_condition(cells)) if one.name == name)
    return style.save(picture.draw(), folder, name)[0]


def _table_1(body: Embodiment) -> tuple[specification.Parameter, ...]:
    """Table 1 with what was really used."""
    quiet, noisy = (condition for condition in CONDITIONS if condition.paper)
    return specification.table_1(
        gamma=fuke2007.GAMMA,
        screen_distance=body.camera.screen.distance,
        quiet=quiet.network,
        noisy=noisy.network,
        noise=noisy.motion.noise,
    )


def _sentences(groups: Mapping[str, Sequence[Cell]], summary: Mapping[str, Any]) -> list[str]:
    """The page in three sentences, every number from the run."""
    noisy = summary["conditions"][_PAPER[-1]]
    net, flat, direct = noisy["paper_mlp"], noisy["least_squares"], noisy[DIRECT]
    size = np.mean(net["map"]["span"]) / np.mean(direct["map"]["span"])
    paper = [claim for claim in summary["claims"] if claim["asked_by"] == "paper" and claim["holds"] is not None]
    held = sum(claim["holds"] for claim in paper)
    rival = "more" if flat["displacement_error"] > net["displacement_error"] else "less"
    seen = fuke2007.power([cell.blindness for cell in groups[fuke2007.BLINDNESS] if cell.blindness is not None])
    half = fuke2007.DOSES["scale"].index(0.5)
    noticed = ", ".join(
        f"{name} notices {100 * seen['scale'][measure][half]:.0f} %"
        for measure, name in (
            ("velocity_correlation", "velocity correlation"),
            ("topological_error", "the topological error"),
            ("trajectory_rmse", "the trajectory's position error"),
        )
    )
    verdict = f"{held} of the paper's {len(paper)} claims hold by criteria written beforehand. " if paper else ""
    return [
        f"Learned in view and used on the unseen face, the paper's network tells direction well (velocity correlation "
        f"{net['velocity_correlation'][0]:.2f} and {net['velocity_correlation'][1]:.2f}), and the map it leads to ends "
        f"with {net['map']['topological_error_mean'][-1]:.1f} of 441 taxels out of order.",
        f"But its displacements on the face are {100 * net['displacement_error']:.0f} % off, its map is "
        f"{size:.2f} times as large as the one that direct sight of the hand leads to, and one constant Jacobian by "
        f"least squares errs {rival} ({100 * flat['displacement_error']:.0f} %).",
        f"{verdict}Its measures hide what is wrong: of true Jacobians cut to half, {noticed}.",
    ]


def _pictures(body: Embodiment, groups: Mapping[str, Sequence[Cell]]) -> list[Picture]:
    """Every figure, in the order of the page."""
    noise_free, noisy = (groups[name][0] for name in _PAPER)
    touched = body.robot.named(body.full_posture(body.touch_postures([body.require_skin().landmarks["nose"]])[0]))
    landmarks = dict(body.require_skin().landmarks)
    perfect = fuke2007.true_map(body)
    places = {name: perfect.reshape(-1, body.m)[taxel] for name, taxel in landmarks.items()}
    many = list(groups[_PAPER[-1]])
    blindness = [cell.blindness for cell in groups[fuke2007.BLINDNESS] if cell.blindness is not None]
    return [
        Picture(
            "robot",
            "first",
            lambda: figures.touching_face(
                body.robot, touched, body.require_skin().positions.numpy(), landmarks, noise_free.circle_position
            ),
            "The robot touches its own face",
            "Drawn from the URDF's own geometry. The circle is what the hand does in view, where the Jacobian is "
            "learned; the dots are the taxels of the face, where it is used and nothing is seen.",
        ),
        Picture(
            "fig03_postures",
            "experiment",
            lambda: body_figures.posture_grid(body, noisy.postures),
            "Representative postures (Fig. 3)",
            "The units of the posture map, trained on the postures of touching.",
        ),
        Picture(
            "fig04_robot",
            "experiment",
            lambda: body_figures.specification(body),
            "The robot and its specification (Fig. 4)",
            "The felt joints are marked. The paper's figure with the dimensions of its robot is not at hand; this "
            "robot's are those of a one-year-old.",
        ),
        Picture(
            "fig05_face",
            "experiment",
            lambda: body_figures.face(body),
            "The face and its taxels (Fig. 5)",
            "The marks of eyes, nose and mouth are for the reader alone.",
        ),
        Picture(
            "fig06_camera",
            "experiment",
            lambda: body_figures.virtual_screen(body),
            "The camera and its virtual screen (Fig. 6)",
            "Drawn to scale: a hand at the face is at about the depth of the screen.",
        ),
        Picture(
            "fig07_circle",
            "experiment",
            lambda: body_figures.seen_circle(body, noise_free.circle_q),
            "The circle in view (Fig. 7)",
            "The hand is dragged along circles both ways; the square is the virtual screen.",
        ),
        Picture(
            "fig08_velocities",
            "results",
            lambda: _velocities([noise_free, noisy]),
            "Velocity of the unseen hand (Fig. 8)",
            "The hand visits mouth, nose, right eye, left eye and nose again; first recording. Truth, least squares "
            "and the true Jacobian beside the paper's network.",
        ),
        *(
            Picture(
                f"fig09_trajectories_{cell.condition}",
                "results",
                partial(_trajectories, cell, places),
                f"Trajectory of the unseen hand (Fig. 9): {_CONDITION_LABELS[cell.condition]}",
                "The same motion, integrated from the mouth's true image.",
            )
            for cell in (noise_free, noisy)
        ),
        Picture(
            "fig10_maps",
            "results",
            lambda: figures.map_snapshots(
                {name: noisy.mapped[name].maps for name in _MAPPED},
                noisy.mapped[DIRECT].steps,
                landmarks,
                true_map=perfect,
            ),
            "The tactile map as it is learned (Fig. 10)",
            "Where each taxel is thought to be, with noise, first recording; the true places are drawn behind.",
        ),
        Picture(
            "fig11_topological_error",
            "results",
            lambda: figures.topological_error(
                noisy.mapped[DIRECT].steps,
                {name: [cell.mapped[name].topological_errors for cell in many] for name in _MAPPED},
                spans={name: [cell.mapped[name].spans.mean(axis=-1) for cell in many] for name in _MAPPED},
                chance=fuke2007.permuted_error(groups[fuke2007.BLINDNESS]),
            ),
            "Topological error (Fig. 11), and the span it does not see",
            "Mean and standard deviation over recordings, with noise. A map that collapses to a point has no "
            "topological error, so its span stands beside it: even a perfectly seen hand leaves a map smaller than the "
            "face, by the kernel.",
        ),
        Picture(
            "posture_map",
            "results",
            lambda: body_figures.posture_map(
                {name: noisy.mapped[name].posture_map for name in _MAPPED}, _true_posture_map(body, noisy)
            ),
            "The posture map",
            "Where the hand is thought to be in each representative posture, with noise, first recording.",
        ),
        Picture(
            "jacobian_error_by_distance",
            "attribution",
            lambda: _error_by_distance(many),
            "Error of the Jacobian against distance from what was seen",
            "Relative Frobenius error at each posture, on the circle, 3 cm in front of the face and on it, with noise. "
            "A Jacobian of zeros has error 1, the analytic one 0.",
        ),
        Picture(
            "attribution",
            "attribution",
            lambda: body_figures.attribution_bars(
                {
                    _CONDITION_LABELS[condition]: {
                        name: {
                            part: float(np.mean([cell.scored[name].attribution["on_face"][part] for cell in cells]))
                            for part in PARTS
                        }
                        for name in ("paper_mlp", "least_squares", "least_squares_scaled")
                    }
                    for condition, cells in groups.items()
                }
            ),
            "Why it is wrong on the face",
            "The squared relative error in the unit metric of the touching motion, as a sum of four parts.",
        ),
        Picture(
            "dose_response",
            "blindness",
            lambda: body_figures.dose_response(
                fuke2007.DOSES,
                fuke2007.power(blindness),
                false_alarms=fuke2007.FALSE_ALARMS,
                dose_labels=_DOSE_LABELS,
            ),
            "What each measure sees of a corrupted Jacobian",
            f"Share of recordings in which a measure goes beyond what it makes of true Jacobians, at "
            f"{100 * fuke2007.FALSE_ALARMS:.0f} % false alarms.",
        ),
    ]


def _trajectories(cell: Cell, places: Mapping[str, np.ndarray]) -> Figure:
    """Fig. 9."""
    return figures.trajectories(cell.tour_image, {name: cell.scored[name].tour_image for name in _SHOWN}, places)


def _velocities(cells: Sequence[Cell]) -> Figure:
    """Fig. 8: x above y, a column for each condition."""
    longest = max((cell.tour_time for cell in cells), key=len)

    def padded(images: Sequence[np.ndarray]) -> np.ndarray:
        steps = np.full((len(images), len(longest) - 1, 2), np.nan)
        for row, (image, cell) in enumerate(zip(images, cells, strict=True)):
            steps[row, : len(image) - 1] = np.diff(image, axis=0) / np.diff(cell.tour_time)[:, None]
        return steps

    return figures.velocities(
        longest[:-1],
        padded([cell.tour_image for cell in cells]),
        {name: padded([cell.scored[name].tour_image for cell in cells]) for name in _SHOWN},
        conditions=[_CONDITION_LABELS[cell.condition] for cell in cells],
    )


def _error_by_distance(cells: Sequence[Cell]) -> Figure:
    learned = [name for name in _SHOWN if name != "analytic"]
    return figures.error_by_distance(
        {probe: 100 * np.concatenate([cell.distance[probe] for cell in cells]) for probe in PROBES},
        {
            name: {
                probe: np.concatenate([cell.scored[name].error_by_posture[probe] for cell in cells]) for probe in PROBES
            }
            for name in learned
        },
        distance_label="distance of the hand from the seen circle [cm]",
    )


def _true_posture_map(body: Embodiment, cell: Cell) -> np.ndarray:
    """Image of the hand in each representative posture [m]."""
    return body.hand_image(cell.postures, on_invisible="nan").numpy()
