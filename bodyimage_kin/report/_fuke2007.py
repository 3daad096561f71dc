"""The figures of the reproduction of Fuke, Ogino and Asada (2007), each from the results of its study."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bodyimage_kin import figures
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.published import fuke2007
from bodyimage_kin.published.fuke2007 import CONDITIONS, DIRECT, PROBES, Conditions
from bodyimage_kin.report._page import Picture
from bodyimage_kin.study import recording_of
from bodyimage_kin.study.maps import true_map

_SHOWN = ("paper_mlp", "least_squares", "analytic")
_MAPPED = (*_SHOWN, DIRECT)
PAPER = tuple(condition.name for condition in CONDITIONS if condition.paper)
"""The paper's own two pairs of noise and steps: without noise, and with."""
_DOSES = {
    "scale": "factor",
    "rotation": "turn in the image [degrees]",
    "rank": "share of the smaller singular value taken away",
    "noise": "norm of a constant random matrix, relative",
}


@dataclass(frozen=True, eq=False)
class Run:
    """The results of the experiment, and where its recordings are.

    Attributes:
        results: Of the study.
        store: Its folder.
        body: The embodiment.
    """

    results: xr.Dataset
    store: Path
    body: Embodiment

    @cached_property
    def found(self) -> Conditions:
        """Results by condition."""
        return Conditions(self.results)

    @cached_property
    def steps(self) -> list[int]:
        """Of the snapshots of the maps."""
        return [int(step) for step in json.loads(self.results.attrs["config"])["maps"]["snapshots"]]

    def first(self, condition: str, estimator: str, score: str) -> Float[np.ndarray, "..."]:
        """A score of the first recording."""
        return self.found.score(condition, estimator, score)[0]

    def recording(self, condition: str, role: str) -> xr.Dataset:
        """The first recording of a condition."""
        recording = next(one.recording for one in CONDITIONS if one.name == condition)
        return recording_of(self.store, recording, self.found.seeds[0], role)

    def tour(self, condition: str) -> tuple[Float[np.ndarray, "time"], Float[np.ndarray, "time m"]]:
        """Time [s] and true hand image of the tour, in the camera's unit."""
        tour = self.recording(condition, "tour")
        return tour["time"].values, tour["true_hand_image"].values[0]

    def tour_path(self, condition: str, estimator: str, count: int) -> Float[np.ndarray, "time m"]:
        """The integrated tour, of so many samples."""
        return self.first(condition, estimator, "tour_path")[:count]

    def postures(self, condition: str) -> Float[np.ndarray, "rows columns p"]:
        """Representative postures of the posture map."""
        recording = next(one.recording for one in CONDITIONS if one.name == condition)
        return self.found.fact(recording, "posture_units")[0]


def pictures_of(run: Run) -> list[Picture]:
    """Every figure, in the order of the page."""
    body, (noise_free, noisy) = run.body, PAPER
    return [
        Picture(
            "robot",
            "first",
            partial(_robot, run, noise_free),
            "The robot touches its own face",
            "The circle is what the hand does in view, where the Jacobian is learned; the dots are the taxels of the "
            "face, where it is used and nothing is seen. Drawn from the URDF's own geometry.",
        ),
        Picture(
            "fig03_postures",
            "experiment",
            partial(figures.row, partial(figures.postures, body, run.postures(noisy)), height=6.2),
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
            partial(_circle, run, noise_free),
            "The circle in view (Fig. 7)",
            "(a) from outside, (b) the screen as the eye sees it. The hand is dragged along circles both ways.",
        ),
        Picture(
            "fig08_velocities",
            "results",
            partial(_velocities, run, PAPER),
            "Velocity of the unseen hand (Fig. 8)",
            "The hand visits mouth, nose, right eye, left eye and nose again; first recording. Truth, least squares "
            "and the true Jacobian beside the paper's network.",
        ),
        *(
            Picture(
                f"fig09_trajectories_{condition}",
                "results",
                partial(_trajectories, run, condition),
                f"Trajectory of the unseen hand (Fig. 9): {figures.label(condition)}",
                "The same motion, integrated from the mouth's true image.",
            )
            for condition in PAPER
        ),
        *(
            Picture(
                "fig10_maps" if index == len(run.steps) - 1 else f"fig10_maps_{index}",
                "growth",
                partial(_maps, run, noisy, index),
                f"The tactile map after {step} steps (Fig. 10)",
                "Where each taxel is thought to be, with noise, first recording; the true places are drawn behind.",
            )
            for index, step in enumerate(run.steps)
        ),
        Picture(
            "fig11_topological_error",
            "maps",
            partial(_learning, run),
            "Topological error (Fig. 11), and the span it does not see",
            "Mean and standard deviation over recordings, with noise. A map that collapses to a point has no "
            "topological error, so its span stands beside it: even a perfectly seen hand leaves a map smaller than the "
            "face, by the kernel.",
        ),
        Picture(
            "posture_map",
            "maps",
            partial(_posture_maps, run, noisy),
            "The posture map",
            "Where the hand is thought to be in each representative posture, with noise, first recording.",
        ),
        Picture(
            "jacobian_error_by_distance",
            "attribution",
            partial(_error_by_distance, run, noisy),
            "Error of the Jacobian against distance from what was seen",
            "Relative error at each posture, on the circle, 3 cm in front of the face and on it, with noise. A "
            "Jacobian of zeros has error 1, the analytic one 0.",
        ),
        Picture(
            "attribution",
            "attribution",
            partial(_attribution, run),
            "Why it is wrong on the face",
            "The squared relative error in the metric of the touching motion, as a sum of four parts.",
        ),
        Picture(
            "dose_response",
            "blindness",
            partial(_doses, run),
            "What each measure sees of a corrupted Jacobian",
            f"Share of recordings in which a measure goes beyond what it makes of true Jacobians, at "
            f"{100 * fuke2007.FALSE_ALARMS:.0f} % false alarms.",
        ),
    ]


def _robot(run: Run, condition: str) -> Figure:
    body, circle = run.body, run.recording(condition, "training")["true_hand_position"].values[0]
    skin, paths = body.require_skin(), {"seen circle of the hand": circle}
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


def _circle(run: Run, condition: str) -> Figure:
    q = run.recording(condition, "training")["true_q"].values[0]
    outside, seen = (partial(draw, run.body, q) for draw in (figures.line_of_sight, figures.hand_image))
    return figures.row(outside, seen, columns=3, below=True, height=3.85, width_ratios=(1.25, 1))


def _velocities(run: Run, conditions: Sequence[str]) -> Figure:
    """X above y, a column for each condition."""
    figure, grid = figures.panels(2, len(conditions), sharex=True, sharey="row")
    for column, condition in zip(grid.T, conditions, strict=True):
        time, image = run.tour(condition)
        interval = np.diff(time)[:, None]
        true, *estimated = (
            np.diff(one, axis=0) / interval
            for one in (image, *(run.tour_path(condition, name, len(time)) for name in _SHOWN))
        )
        for axis, axes in enumerate(column):
            figures.velocities(time[:-1], true, dict(zip(_SHOWN, estimated, strict=True)), axes, axis=axis)
            axes.label_outer()
        column[0].set_title(figures.drawn(condition))
    figures.letters(grid.T.flat)
    figures.legend(figure)
    return figure


def _trajectories(run: Run, condition: str) -> Figure:
    _, image = run.tour(condition)
    estimates = {name: run.tour_path(condition, name, len(image)) for name in _SHOWN}
    perfect = true_map(run.body).reshape(-1, run.body.m)
    places = {name: perfect[taxel] for name, taxel in run.body.require_skin().landmarks.items()}
    draw = partial(figures.trajectories, image, estimates, landmarks=places)
    return figures.row(draw, pictures=True, width=figures.SINGLE_COLUMN)


def _maps(run: Run, condition: str, index: int) -> Figure:
    """Every map at one step, on the scale of all steps."""
    perfect, landmarks = true_map(run.body), run.body.require_skin().landmarks
    maps = {name: run.first(condition, name, "tactile_maps") for name in _MAPPED}
    everything = np.concatenate([perfect[None], *maps.values()]).reshape(-1, 2) * 1000
    (left, top), (right, bottom) = np.nanmin(everything, 0) - 2, np.nanmax(everything, 0) + 2

    def draw(name: str, axes: Axes) -> None:
        figures.tactile_map(maps[name][index], axes, true=perfect, landmarks=landmarks)
        axes.set(title=figures.drawn(name), xlim=(left, right), ylim=(bottom, top))

    draws = [partial(draw, name) for name in _MAPPED]
    return figures.row(*draws, pictures=True, lettered=False, columns=5, sharex=True, sharey=True)


def _posture_maps(run: Run, condition: str) -> Figure:
    true = fuke2007.true_posture_map(run.body, run.postures(condition))

    def draw(name: str, axes: Axes) -> None:
        figures.posture_map(run.first(condition, name, "posture_map"), true, axes, name=name)
        axes.set_title(figures.drawn(name))

    draws = [partial(draw, name) for name in _MAPPED]
    return figures.row(*draws, pictures=True, lettered=False, columns=3, sharex=True, sharey=True)


def _learning(run: Run) -> Figure:
    chance, noisy, steps = (fuke2007.permuted_error(run.found), "chance"), PAPER[-1], run.steps
    errors = {name: list(run.found.score(noisy, name, "topological_errors")[:, 0]) for name in _MAPPED}
    spans = {name: list(run.found.score(noisy, name, "spans").mean(axis=-1)) for name in _MAPPED}
    return figures.row(
        partial(figures.learning, steps, errors, ylabel="topological error [taxels]", level=chance),
        partial(figures.learning, steps, spans, ylabel="map span / true span", level=(1.0, "true size")),
        height=2.6,
    )


def _error_by_distance(run: Run, condition: str) -> Figure:
    recording = next(one.recording for one in CONDITIONS if one.name == condition)

    def draw(probe: str, axes: Axes) -> None:
        errors = {
            name: _there(run.found.score(condition, name, "identity_error_by_posture", probe=probe))
            for name in _SHOWN
            if name != "analytic"
        }
        away = 100 * _there(run.found.fact(recording, "hand_distance_by_posture", probe=probe))
        figures.error_by_distance(away, errors, axes, xlabel="distance from the seen circle [cm]")
        axes.set_title(figures.drawn(probe))

    return figures.row(*(partial(draw, probe) for probe in PROBES), height=2.7, sharex=True, sharey=True)


def _there(values: Float[np.ndarray, "seed posture"]) -> Float[np.ndarray, "there"]:
    """All that is not padding, in a row."""
    return values[np.isfinite(values)]


def _attribution(run: Run) -> Figure:
    parts = [str(part) for part in run.results["part"].values]
    figure, grid = figures.panels(2, 3, height=3.1, sharex=True, sharey=True)
    for index, (axes, condition) in enumerate(zip(grid.flat, CONDITIONS, strict=False)):
        of = {
            name: run.found.score(condition.name, name, "attribution", probe="on_face").mean(0)
            for name in ("paper_mlp", "least_squares", "least_squares_scaled")
        }
        means = {name: dict(zip(parts, values.tolist(), strict=True)) for name, values in of.items()}
        figures.attribution(means, axes)
        axes.set_title(figures.drawn(condition.name))
        below = axes.get_xlabel()
        axes.label_outer()
        if index + grid.shape[1] >= len(CONDITIONS):
            # The lowest of its column, though not of the figure.
            axes.set_xlabel(below)
            axes.tick_params(labelbottom=True)
    for axes in grid.flat[len(CONDITIONS) :]:
        axes.remove()
    figures.letters(grid.flat[: len(CONDITIONS)])
    figures.legend(figure)
    return figure


def _doses(run: Run) -> Figure:
    power = fuke2007.power(run.found)
    figure, grid = figures.panels(2, 2, height=4.3, sharey=True)
    for axes, (corruption, of) in zip(grid.flat, power.items(), strict=True):
        alarms, doses = fuke2007.FALSE_ALARMS, fuke2007.DOSES[corruption]
        figures.dose_response(doses, of, axes, false_alarms=alarms, xlabel=_DOSES[corruption])
        axes.set_title(figures.drawn(corruption))
    figures.letters(grid.flat)
    figures.legend(figure)
    return figure
