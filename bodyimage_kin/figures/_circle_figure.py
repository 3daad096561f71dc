"""The hand on its circle in front of the face, and the circle's image on the virtual screen (Fig. 7)."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch
from matplotlib.patheffects import withStroke

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.figures import style
from bodyimage_kin.figures._panels import numbers, scale_bar
from bodyimage_kin.figures._views import facing, posed
from bodyimage_kin.figures.drawing import Surface, View, Window, draw_surface, hidden, project

_MM = 1000.0
_CIRCLE: dict[str, Any] = {"color": "#882255", "linewidth": 1.4}
_IMAGE: dict[str, Any] = {"color": "#2f9bd8", "linewidth": 1.4}
_SENSES: dict[bool, dict[str, Any]] = {
    True: {"color": "black", "linewidth": 0.9},
    False: {"color": "black", "linewidth": 0.9, "linestyle": (0, (2.5, 1.5))},
}
_RAY: dict[str, Any] = {"color": "0.35", "linewidth": 0.5}
_SCREEN = (0.55, 0.72, 0.90, 1.0)
_OPACITY = 0.5


@style.style()
def seen_circle(body: Embodiment, q: ArrayLike, *, view: View | None = None) -> Figure:
    """The robot with its hand on the circle on which it sees it, and the virtual screen between (Fig. 7 of the paper).

    Args:
        body: The embodiment.
        q: (time, p) felt postures along the circle, ``recording.true_q[trial]``; NaN rows are left out.
        view: Where the robot is seen from; None: obliquely, from the side where the robot covers less of the circle.

    Returns:
        The robot at the first posture, the circle, lines of sight and the circle's image on the screen; and beside it
        the screen as the eye sees it [mm], y down, with the senses of rotation and where the hand's image would be
        while it touches a landmark.

    Raises:
        InvalidArray: Not postures of this embodiment, or fewer than three.
        InvalidGeometry: Visuals that cannot be read.
        NotVisible: A hand that has no image.
    """
    postures = numbers(q, "q", None, body.p)
    postures = postures[np.isfinite(postures).all(1)]
    if len(postures) < 3:
        raise InvalidArray(f"q has {len(postures)} finite postures; a circle takes at least 3")
    felt = torch.from_numpy(postures)
    with torch.no_grad():
        centres, images = body.hand_position(felt).numpy(), body.hand_image(felt).numpy()
        camera = body.kinematics.pose(felt[0], body.camera.link) @ body.camera.link_T_camera
        in_camera = body.hand_in_camera(felt).numpy()
    root_T_camera = camera.numpy()
    surface = posed(body, postures[0], body.robot.link_names)
    h_z = body.camera.screen.distance
    landmarks = _landmark_images(body, root_T_camera, felt[0])
    half = 1.25 * float(np.abs(np.stack([*images, *landmarks.values()])).max())
    corners = _in_root(root_T_camera, np.array([[-half, -half], [half, -half], [half, half], [-half, half]]), h_z)
    view = view or _clearest(body, surface, centres)
    figure = style.new_figure(style.DOUBLE_COLUMN, 3.85)
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1))
    window = _window(body, surface, view, np.concatenate([centres, corners]))
    _draw_with_screen(left, surface, view, window, corners)
    covered = hidden(_along(corners), surface, view)
    _line(left, project(_along(corners), view)[0], covered, color="#1f4e79", linewidth=0.9, zorder=3)
    _line(left, project(centres, view)[0], hidden(centres, surface, view), **_CIRCLE, zorder=5)
    on_screen = _in_root(root_T_camera, images, h_z)
    left.plot(*project(on_screen, view)[0].T, **_IMAGE, zorder=4)
    eye = root_T_camera[:3, 3]
    for index in np.linspace(0, _once_round(in_camera), 5).astype(int)[:-1]:
        ray = np.linspace(eye, centres[index], 60)
        _line(left, project(ray, view)[0], hidden(ray, surface, view), **_RAY, zorder=3)
    left.plot(*project(centres[0], view)[0], "o", color=_CIRCLE["color"], markersize=4, zorder=7)
    left.plot(*project(eye, view)[0], "x", color="black", markersize=4.5, zorder=7)
    _turns(left, root_T_camera, in_camera, view)
    scale_bar(left, 0.05)
    left.set(xticks=[], yticks=[], title="seen from outside")
    left.spines[:].set_visible(False)
    left.set_title("(a)", loc="left")
    _eye_sees(right, images, half, landmarks)
    handles: list[Any] = [
        Line2D([], [], **_CIRCLE, label="circle of the hand's centre"),
        Line2D([], [], **_IMAGE, label="its image on the screen"),
        Patch(facecolor=_SCREEN, alpha=_OPACITY, edgecolor="#1f4e79", label=f"virtual screen, z = {h_z * _MM:g} mm"),
        Line2D([], [], **_RAY, label="line of sight"),
        Line2D([], [], **_SENSES[True], marker=">", markersize=3, label="clockwise, to the eye"),
        Line2D([], [], **_SENSES[False], marker="<", markersize=3, label="anticlockwise, to the eye"),
        Line2D(
            [], [], linestyle="", marker="D", color="0.4", markerfacecolor="white", label="hand on a landmark, unseen"
        ),
        Line2D([], [], linestyle="", marker="x", color="black", markersize=4.5, label="optical centre"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, columnspacing=1.2)
    return figure


def _eye_sees(
    axes: Axes, images: Float[np.ndarray, "time 2"], half: float, landmarks: dict[str, Float[np.ndarray, "2"]]
) -> None:
    """The screen with the image of the circle, its senses, and where the landmarks would be."""
    axes.plot(*(images * _MM).T, **_IMAGE, label="image")
    axes.plot(*(images[0] * _MM), "o", color=_CIRCLE["color"], markersize=4, label="start", zorder=4)
    middle = (images.max(0) + images.min(0)) / 2 * _MM
    radius = 0.5 * float(np.ptp(images, axis=0).mean()) * _MM
    for clockwise, text in ((True, "clockwise"), (False, "anticlockwise")):
        size = radius * (1.16 if clockwise else 0.84)
        # y runs down, so a growing angle turns clockwise.
        angles = np.radians(np.linspace(-125, -55, 40) if clockwise else np.linspace(-55, -125, 40))
        arc = middle + size * np.stack([np.cos(angles), np.sin(angles)], 1)
        _arrow(axes, arc, clockwise)
        axes.annotate(
            text,
            middle - [0, size + 0.06 * radius if clockwise else 0.74 * size],
            ha="center",
            va="bottom" if clockwise else "top",
        )
    axes.set(xlim=(-half * _MM, half * _MM), ylim=(half * _MM, -half * _MM), aspect="equal")
    for name, place in landmarks.items():
        look = style.landmark(name) | {"markerfacecolor": "white", "markeredgecolor": style.landmark(name)["color"]}
        axes.plot(*(place * _MM), **look | {"markeredgewidth": 1.0}, markersize=5, zorder=3, label=name)
        note = axes.annotate(
            style.label(name),
            (float(place[0]) * _MM, float(place[1]) * _MM),
            (0, -4),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=6.5,
        )
        note.set_path_effects([withStroke(linewidth=2, foreground="white")])
    axes.set(xlabel="x [mm]", ylabel="y [mm]", title="the screen, as the eye sees it")
    axes.set_title("(b)", loc="left")
    axes.set_facecolor((*_SCREEN[:3], 0.18))
    axes.spines[:].set(visible=True, color="#1f4e79")


def _landmark_images(
    body: Embodiment, root_T_camera: Float[np.ndarray, "4 4"], q: torch.Tensor
) -> dict[str, Float[np.ndarray, "2"]]:
    """Where the hand's image would be while it touches each landmark [m]; those that have none are left out."""
    if not body.require_skin().landmarks:
        return {}
    with torch.no_grad():
        camera_T_skin = torch.from_numpy(
            np.linalg.solve(root_T_camera, body.kinematics.pose(q, body.require_skin().link).numpy())
        )
        centres = (
            body.touch_centres(list(body.require_skin().landmarks.values())) @ camera_T_skin[:3, :3].T
            + camera_T_skin[:3, 3]
        )
        images = body.camera.model.project(centres).numpy()
    return {
        name: image
        for name, image in zip(body.require_skin().landmarks, images, strict=True)
        if np.isfinite(image).all()
    }


def _turns(
    axes: Axes, root_T_camera: Float[np.ndarray, "4 4"], in_camera: Float[np.ndarray, "time 3"], view: View
) -> None:
    """Arrows beside the circle: clockwise, as the eye sees it, outside; anticlockwise inside."""
    low, high = in_camera.min(0), in_camera.max(0)
    middle, radii = (low + high) / 2, (high - low)[:2] / 2
    for clockwise, size in ((True, 1.17), (False, 0.83)):
        angles = np.radians(np.linspace(-130, -60, 40) if clockwise else np.linspace(-60, -130, 40))
        arc = np.stack([np.cos(angles), np.sin(angles)], 1) * radii * size + middle[:2]
        points = np.concatenate([arc, np.full((len(arc), 1), middle[2]), np.ones((len(arc), 1))], 1)
        flat = project((points @ root_T_camera.T)[:, :3], view)[0]
        _arrow(axes, flat, clockwise)


def _arrow(axes: Axes, arc: Float[np.ndarray, "points 2"], clockwise: bool) -> None:
    axes.plot(*arc.T, **_SENSES[clockwise], zorder=6)
    axes.add_patch(
        FancyArrowPatch(
            tuple(arc[-3]),
            tuple(arc[-1]),
            arrowstyle="-|>",
            mutation_scale=8,
            color="black",
            shrinkA=0,
            shrinkB=0,
            zorder=6,
        )
    )


def _draw_with_screen(
    axes: Axes, surface: Surface, view: View, window: Window, corners: Float[np.ndarray, "4 3"]
) -> None:
    """The robot, and the screen as a pane of glass in it: what is in front of the pane covers it."""
    first, second = corners[[0, 1, 2]], corners[[0, 2, 3]]
    panes = np.stack([first, second, first[::-1], second[::-1]])
    glazed = Surface(
        np.concatenate([surface.corners, panes]),
        # Normals along the light: the pane has its own colour from both sides.
        np.concatenate([surface.normals, np.broadcast_to(_towards_light(view), panes.shape)]),
        np.concatenate([surface.colours, np.broadcast_to(_SCREEN, (4, 4))]),
        np.concatenate([surface.links, np.zeros(4, dtype=np.int64)]),
        surface.link_names,
    )
    painted = draw_surface(axes, surface, view, window=window)
    pane = draw_surface(axes, glazed, view, window=window)
    behind, before = (_on_white(np.asarray(image.get_array())) for image in (painted, pane))
    painted.set_data((1 - _OPACITY) * behind + _OPACITY * before)
    pane.remove()


def _towards_light(view: View) -> Float[np.ndarray, "3"]:
    right, up, forward = view.axes()
    light = -0.35 * right + 0.55 * up - 0.76 * forward
    return np.asarray(light / np.linalg.norm(light))


def _on_white(image: Float[np.ndarray, "height width 4"]) -> Float[np.ndarray, "height width 3"]:
    return image[..., :3] * image[..., 3:] + 1 - image[..., 3:]


def _in_root(
    root_T_camera: Float[np.ndarray, "4 4"], places: Float[np.ndarray, "points 2"], depth: float
) -> Float[np.ndarray, "points 3"]:
    """Places on the screen, in the root [m]."""
    points = np.concatenate([places, np.full((len(places), 1), depth), np.ones((len(places), 1))], axis=1)
    return (points @ root_T_camera.T)[:, :3]


def _along(corners: Float[np.ndarray, "4 3"]) -> Float[np.ndarray, "points 3"]:
    ends = np.concatenate([corners, corners[:1]])
    return np.concatenate([np.linspace(a, b, 40) for a, b in itertools.pairwise(ends)])


def _line(axes: Axes, line: Float[np.ndarray, "points 2"], covered: np.ndarray, **look: Any) -> None:
    """Solid where it is seen, faint where it is covered."""
    axes.plot(*np.where(covered[:, None], np.nan, line).T, **look)
    axes.plot(*np.where(covered[:, None], line, np.nan).T, **look | {"alpha": 0.45, "linestyle": (0, (1, 1.5))})


def _once_round(in_camera: Float[np.ndarray, "time 3"]) -> int:
    """Samples until the hand has gone round once, or all of them."""
    aside = in_camera[:, :2] - (in_camera[:, :2].max(0) + in_camera[:, :2].min(0)) / 2
    turned = np.abs(np.unwrap(np.arctan2(aside[:, 1], aside[:, 0])) - np.arctan2(aside[0, 1], aside[0, 0]))
    round_once = np.flatnonzero(turned >= 2 * np.pi)
    return int(round_once[0]) if len(round_once) else len(in_camera) - 1


def _clearest(body: Embodiment, surface: Surface, centres: Float[np.ndarray, "time 3"]) -> View:
    middle = body.require_skin().positions.numpy().mean(0)
    views = [View.around(middle, azimuth=facing(body) + turn, elevation=14) for turn in (-58, 58)]
    return min(views, key=lambda view: int(hidden(centres, surface, view).sum()))


def _window(body: Embodiment, surface: Surface, view: View, points: Float[np.ndarray, "points 3"]) -> Window:
    """The skin's link, the hand's, the points, and some of what is below them."""
    shown = [surface.link_names.index(link) for link in (body.require_skin().link, body.hand.link)]
    drawn = surface.corners[np.isin(surface.links, shown)].reshape(-1, 3)
    flat = project(np.concatenate([drawn, points]), view)[0]
    (left, bottom), (right, top) = flat.min(0), flat.max(0)
    edge = 0.05 * max(right - left, top - bottom)
    return float(left - edge), float(right + edge), float(bottom - 3 * edge), float(top + edge)
