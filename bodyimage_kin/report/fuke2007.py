"""The reproduction of Fuke, Ogino and Asada (2007) as figures and one page."""

from __future__ import annotations

import multiprocessing
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from statistics import fmean as mean
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bodyimage_kin import figures
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.published import fuke2007
from bodyimage_kin.published.fuke2007 import CONDITIONS, DIRECT, PARTS, PROBES, Cell, Settings
from bodyimage_kin.report._limbs import limbs
from bodyimage_kin.report._page import Picture, inlined, write_page

__all__ = ["write_reproduction"]

_SHOWN = ("paper_mlp", "least_squares", "analytic")
_MAPPED = (*_SHOWN, DIRECT)
_PAPER = tuple(condition.name for condition in CONDITIONS if condition.paper)
"""The paper's own two pairs of noise and steps: without noise, and with."""
_LABELS = {
    "kinematic": "kinematic, 200 steps",
    "noise_free_200": "no noise, 200 steps",
    "noise_free_500": "no noise, 500 steps",
    "noisy_200": "noise, 200 steps",
    "noisy_500": "noise, 500 steps",
}
_DOSES = {
    "scale": "factor",
    "rotation": "turn in the image [degrees]",
    "rank": "share of the smaller singular value taken away",
    "noise": "norm of a constant random matrix, relative",
}


def write_reproduction(settings: Settings, cells: Sequence[Cell], summary: Mapping[str, Any], folder: Path) -> Path:
    """Writes all figures (SVG, PNG and CSV) and ``report.html`` into a folder.

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
    with figures.labelled(_LABELS):
        files = _draw_all(settings, cells, folder / "figures")
        pictures = [
            inlined(picture, files[picture.name][0].read_text("utf-8"), _text(files[picture.name][2:]), index)
            for index, picture in enumerate(_pictures(body, groups))
        ]
        write_page(
            folder / "report.html",
            "fuke2007.html",
            pictures=pictures,
            sentences=_sentences(body, groups, summary),
            summary=summary,
            table_1=_table_1(body),
            limbs=limbs(body.robot),
            body=body,
            settings=settings,
            conditions=CONDITIONS,
            probes=PROBES,
            direct=DIRECT,
            chance=fuke2007.permuted_error(cells),
            steps=[int(step) for step in groups[_PAPER[-1]][0].mapped[DIRECT].steps],
        )
    return folder / "report.html"


def _draw_all(settings: Settings, cells: Sequence[Cell], folder: Path) -> dict[str, tuple[Path, ...]]:
    """Draws and saves every figure, in this process and another: one begins at the first, the other at the last.

    Returns:
        Name -> files, SVG first.
    """
    saved: dict[str, tuple[Path, ...]] = {}
    body = load_embodiment(settings.embodiment, settings.backend)
    pictures = _pictures(body, fuke2007.by_condition(cells))
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        theirs = {
            picture.name: executor.submit(_draw, settings, cells, folder, picture.name) for picture in pictures[::-1]
        }
        for picture in pictures:
            # What the other has not begun is drawn here.
            if theirs[picture.name].cancel():
                saved[picture.name] = _save(picture, folder)
        return saved | {name: future.result() for name, future in theirs.items() if not future.cancelled()}


def _draw(settings: Settings, cells: Sequence[Cell], folder: Path, name: str) -> tuple[Path, ...]:
    body = load_embodiment(settings.embodiment, settings.backend)
    with figures.labelled(_LABELS):
        picture = next(one for one in _pictures(body, fuke2007.by_condition(cells)) if one.name == name)
        return _save(picture, folder)


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
        network = condition.network
        rows += [
            (f"back-propagation {said}: learning rate", "0.2", f"{network.learning_rate:g}"),
            (f"back-propagation {said}: learning steps", steps, f"{network.steps:g}"),
            (f"back-propagation {said}: hidden units", "10", f"{network.hidden:g}"),
        ]
    # The random torque is drawn about zero (bodyimage_kin.recordings.dynamics); the paper gives no unit.
    variance = f"{noisy.motion.noise.torque**2:g} N\N{SUPERSCRIPT TWO}m\N{SUPERSCRIPT TWO}"
    return [
        *rows,
        ("noise: mean of the normal distribution", "0.0", "0.0"),
        ("noise: variance of the normal distribution", "0.01", variance),
    ]


def _sentences(body: Embodiment, groups: Mapping[str, Sequence[Cell]], summary: Mapping[str, Any]) -> list[str]:
    """The page in three sentences, every number from the run."""
    noisy = summary["conditions"][_PAPER[-1]]
    net, flat, direct = noisy["paper_mlp"], noisy["least_squares"], noisy[DIRECT]
    size = np.mean(net["map"]["span"]) / np.mean(direct["map"]["span"])
    paper = [claim for claim in summary["claims"] if claim["asked_by"] == "paper" and claim["holds"] is not None]
    rival = "more" if flat["displacement_error"] > net["displacement_error"] else "less"
    seen = fuke2007.power([cell.blindness for cell in groups[fuke2007.BLINDNESS] if cell.blindness is not None])
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
    order = (
        f"{wrong:.1f} of {body.require_skin().count} taxels out of order" if wrong >= 0.05 else "no taxel out of order"
    )
    verdict = (
        f"{sum(claim['holds'] for claim in paper)} of the paper's {len(paper)} claims hold by criteria written "
        "beforehand. "
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


def _pictures(body: Embodiment, groups: Mapping[str, Sequence[Cell]]) -> list[Picture]:
    """Every figure, in the order of the page."""
    noise_free, noisy = (groups[name][0] for name in _PAPER)
    perfect = fuke2007.true_map(body)
    places = {name: perfect.reshape(-1, body.m)[taxel] for name, taxel in body.require_skin().landmarks.items()}
    steps = noisy.mapped[DIRECT].steps
    return [
        Picture(
            "robot",
            "first",
            partial(_robot, body, noise_free),
            "The robot touches its own face",
            "The circle is what the hand does in view, where the Jacobian is learned; the dots are the taxels of the "
            "face, where it is used and nothing is seen. Drawn from the URDF's own geometry.",
        ),
        Picture(
            "fig03_postures",
            "experiment",
            partial(figures.row, partial(figures.postures, body, noisy.postures), height=6.2),
            "Representative postures (Fig. 3)",
            "The units of the posture map, trained on the postures of touching.",
        ),
        Picture(
            "fig04_robot",
            "experiment",
            partial(_joints, body),
            "The robot and its felt joints (Fig. 4)",
            "Purple: the felt joints and their axes. The paper's figure with the dimensions of its robot is not at "
            "hand; this robot's, in the table below, are those of a one-year-old.",
        ),
        Picture(
            "fig05_face",
            "experiment",
            partial(_face, body),
            "The face and its taxels (Fig. 5)",
            "The marks of eyes, nose and mouth are for the reader alone.",
        ),
        Picture(
            "fig06_camera",
            "experiment",
            partial(_camera, body),
            "The camera and its virtual screen (Fig. 6)",
            "Two sections through the optical centre, drawn to scale: a hand at the face is at about the depth of the "
            "screen.",
        ),
        Picture(
            "fig07_circle",
            "experiment",
            partial(_circle, body, noise_free),
            "The circle in view (Fig. 7)",
            "(a) from outside, (b) the screen as the eye sees it. The hand is dragged along circles both ways.",
        ),
        Picture(
            "fig08_velocities",
            "results",
            partial(_velocities, [noise_free, noisy]),
            "Velocity of the unseen hand (Fig. 8)",
            "The hand visits mouth, nose, right eye, left eye and nose again; first recording. Truth, least squares "
            "and the true Jacobian beside the paper's network.",
        ),
        *(
            Picture(
                f"fig09_trajectories_{cell.condition}",
                "results",
                partial(_trajectories, cell, places),
                f"Trajectory of the unseen hand (Fig. 9): {figures.label(cell.condition)}",
                "The same motion, integrated from the mouth's true image.",
            )
            for cell in (noise_free, noisy)
        ),
        *(
            Picture(
                "fig10_maps" if index == len(steps) - 1 else f"fig10_maps_{index}",
                "growth",
                partial(_maps, body, noisy, index, perfect),
                f"The tactile map after {step:.0f} steps (Fig. 10)",
                "Where each taxel is thought to be, with noise, first recording; the true places are drawn behind.",
            )
            for index, step in enumerate(steps)
        ),
        Picture(
            "fig11_topological_error",
            "maps",
            partial(_learning, groups),
            "Topological error (Fig. 11), and the span it does not see",
            "Mean and standard deviation over recordings, with noise. A map that collapses to a point has no "
            "topological error, so its span stands beside it: even a perfectly seen hand leaves a map smaller than the "
            "face, by the kernel.",
        ),
        Picture(
            "posture_map",
            "maps",
            partial(_posture_maps, body, noisy),
            "The posture map",
            "Where the hand is thought to be in each representative posture, with noise, first recording.",
        ),
        Picture(
            "jacobian_error_by_distance",
            "attribution",
            partial(_error_by_distance, groups[_PAPER[-1]]),
            "Error of the Jacobian against distance from what was seen",
            "Relative error at each posture, on the circle, 3 cm in front of the face and on it, with noise. A "
            "Jacobian of zeros has error 1, the analytic one 0.",
        ),
        Picture(
            "attribution",
            "attribution",
            partial(_attribution, groups),
            "Why it is wrong on the face",
            "The squared relative error in the unit metric of the touching motion, as a sum of four parts.",
        ),
        Picture(
            "dose_response",
            "blindness",
            partial(_doses, groups),
            "What each measure sees of a corrupted Jacobian",
            f"Share of recordings in which a measure goes beyond what it makes of true Jacobians, at "
            f"{100 * fuke2007.FALSE_ALARMS:.0f} % false alarms.",
        ),
    ]


def _robot(body: Embodiment, cell: Cell) -> Figure:
    skin, paths = body.require_skin(), {"seen circle of the hand": cell.circle_position}
    touching = body.touch_postures([skin.landmarks.get("nose", skin.reference)])[0]
    far, near = (partial(figures.robot, body, touching, paths=paths, close=close) for close in (False, True))
    return figures.row(far, near, pictures=True, below=True)


def _joints(body: Embodiment) -> Figure:
    front, side = partial(figures.joints, body), partial(figures.joints, body, turn=90, named=False)
    return figures.row(front, side, lettered=False, height=4.2, width=0.75 * figures.DOUBLE_COLUMN)


def _face(body: Embodiment) -> Figure:
    front, side = (partial(figures.skin, body, None, turn=turn) for turn in (0, 50))
    return figures.row(front, side, pictures=True, below=True)


def _camera(body: Embodiment) -> Figure:
    side, above = (partial(figures.virtual_screen, body, None, axis=axis) for axis in (1, 0))
    return figures.row(side, above, pictures=True, columns=3)


def _circle(body: Embodiment, cell: Cell) -> Figure:
    outside, seen = (partial(draw, body, cell.circle_q) for draw in (figures.line_of_sight, figures.hand_image))
    return figures.row(outside, seen, columns=3, below=True, height=3.85, width_ratios=(1.25, 1))


def _velocities(cells: Sequence[Cell]) -> Figure:
    """X above y, a column for each condition."""
    figure, grid = figures.panels(2, len(cells), sharex=True, sharey="row")
    for column, cell in zip(grid.T, cells, strict=True):
        interval = np.diff(cell.tour_time)[:, None]
        true, *estimated = (
            np.diff(image, axis=0) / interval
            for image in (cell.tour_image, *(cell.scored[name].tour_image for name in _SHOWN))
        )
        for axis, axes in enumerate(column):
            figures.velocities(cell.tour_time[:-1], true, dict(zip(_SHOWN, estimated, strict=True)), axes, axis=axis)
            axes.label_outer()
        column[0].set_title(figures.drawn(cell.condition))
    figures.letters(grid.T.flat)
    figures.legend(figure)
    return figure


def _trajectories(cell: Cell, places: Mapping[str, np.ndarray]) -> Figure:
    estimates = {name: cell.scored[name].tour_image for name in _SHOWN}
    draw = partial(figures.trajectories, cell.tour_image, estimates, landmarks=places)
    return figures.row(draw, pictures=True, width=figures.SINGLE_COLUMN)


def _maps(body: Embodiment, cell: Cell, index: int, perfect: np.ndarray) -> Figure:
    """Every map at one step, on the scale of all steps."""
    everything = np.concatenate([perfect[None], *(cell.mapped[name].maps for name in _MAPPED)]).reshape(-1, 2) * 1000
    (left, top), (right, bottom) = np.nanmin(everything, 0) - 2, np.nanmax(everything, 0) + 2

    def draw(name: str, axes: Axes) -> None:
        landmarks = body.require_skin().landmarks
        figures.tactile_map(cell.mapped[name].maps[index], axes, true=perfect, landmarks=landmarks)
        axes.set(title=figures.drawn(name), xlim=(left, right), ylim=(bottom, top))

    draws = [partial(draw, name) for name in _MAPPED]
    return figures.row(*draws, pictures=True, lettered=False, columns=5, sharex=True, sharey=True)


def _posture_maps(body: Embodiment, cell: Cell) -> Figure:
    true = body.hand_image(cell.postures, on_invisible="nan").numpy()

    def draw(name: str, axes: Axes) -> None:
        figures.posture_map(cell.mapped[name].posture_map, true, axes, name=name)
        axes.set_title(figures.drawn(name))

    draws = [partial(draw, name) for name in _MAPPED]
    return figures.row(*draws, pictures=True, lettered=False, columns=3, sharex=True, sharey=True)


def _learning(groups: Mapping[str, Sequence[Cell]]) -> Figure:
    cells = groups[_PAPER[-1]]
    steps = cells[0].mapped[DIRECT].steps
    chance = (fuke2007.permuted_error(groups[fuke2007.BLINDNESS]), "chance")
    errors = {name: [cell.mapped[name].topological_errors for cell in cells] for name in _MAPPED}
    spans = {name: [cell.mapped[name].spans.mean(axis=-1) for cell in cells] for name in _MAPPED}
    return figures.row(
        partial(figures.learning, steps, errors, ylabel="topological error [taxels]", level=chance),
        partial(figures.learning, steps, spans, ylabel="map span / true span", level=(1.0, "true size")),
        height=2.6,
    )


def _error_by_distance(cells: Sequence[Cell]) -> Figure:
    def draw(probe: str, axes: Axes) -> None:
        errors = {
            name: np.concatenate([cell.scored[name].error_by_posture[probe] for cell in cells])
            for name in _SHOWN
            if name != "analytic"
        }
        away = 100 * np.concatenate([cell.distance[probe] for cell in cells])
        figures.error_by_distance(away, errors, axes, xlabel="distance from the seen circle [cm]")
        axes.set_title(figures.drawn(probe))

    return figures.row(*(partial(draw, probe) for probe in PROBES), height=2.7, sharex=True, sharey=True)


def _attribution(groups: Mapping[str, Sequence[Cell]]) -> Figure:
    figure, grid = figures.panels(2, 3, height=3.1, sharex=True, sharey=True)
    for axes, (condition, cells) in zip(grid.flat, groups.items(), strict=False):
        means = {
            name: {part: mean([cell.scored[name].attribution["on_face"][part] for cell in cells]) for part in PARTS}
            for name in ("paper_mlp", "least_squares", "least_squares_scaled")
        }
        figures.attribution(means, axes)
        axes.set_title(figures.drawn(condition))
        axes.label_outer()
    for axes in grid.flat[len(groups) :]:
        axes.remove()
    figures.letters(grid.flat[: len(groups)])
    figures.legend(figure)
    return figure


def _doses(groups: Mapping[str, Sequence[Cell]]) -> Figure:
    power = fuke2007.power([cell.blindness for cell in groups[fuke2007.BLINDNESS] if cell.blindness is not None])
    figure, grid = figures.panels(2, 2, height=4.3, sharey=True)
    for axes, (corruption, of) in zip(grid.flat, power.items(), strict=True):
        alarms, doses = fuke2007.FALSE_ALARMS, fuke2007.DOSES[corruption]
        figures.dose_response(doses, of, axes, false_alarms=alarms, xlabel=_DOSES[corruption])
        axes.set_title(figures.drawn(corruption))
    figures.letters(grid.flat)
    figures.legend(figure)
    return figure
