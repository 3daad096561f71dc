"""The camera and its virtual screen in two sections through the optical centre, drawn from the geometry (Fig. 6)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon

from bodyimage_kin._arrays import ArrayLike, as_postures
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidPosture
from bodyimage_kin.figures import style
from bodyimage_kin.robot.shapes import cast

_MM = 1000.0
_LINES, _COARSE = 401, 8001
_HANDS = ("#d55e00", "#0072b2")
_HAND_LINES: tuple[Any, ...] = ("-", (0, (4, 1.5)))
_SCREEN: dict[str, Any] = {"color": "black", "linewidth": 2.0, "solid_capstyle": "butt"}
_NEAR: dict[str, Any] = {"color": "0.35", "linewidth": 0.9, "linestyle": (0, (1, 1.2))}
_SKIN, _CONE = "#ecd3c2", "#e8eef5"


@style.style()
def virtual_screen(body: Embodiment, postures: Mapping[str, ArrayLike] | None = None) -> Figure:
    """The virtual screen, and how the hand is projected on it (Fig. 6 of the paper), in the camera's axes.

    Args:
        body: The embodiment.
        postures: At most two felt postures (p,) by name, the hand in front of the camera plane; None: the hand at the
            reference taxel, and at home in view.

    Returns:
        The section x = 0 from the side and y = 0 from above [mm]: optical centre, screen at z = h_z, near plane, cone
        of view, skin; and each hand with its ray and its image (lines labelled ``image: NAME``), seen along the normal
        of the section.

    Raises:
        InvalidPosture: None at all, more than two, or no postures of this embodiment.
        NotVisible: A hand that has no image.
        Unreachable: The reference taxel, when that is what is drawn.
    """
    if postures is None:
        touching = body.touch_postures([body.require_skin().reference])[0]
        named = [
            style.label(name)
            for name, taxel in body.require_skin().landmarks.items()
            if taxel == body.require_skin().reference
        ]
        postures = {f"touching the {(*named, 'reference taxel')[0]}": touching, "in view": body.felt_home}
    if not 0 < len(postures) <= len(_HANDS):
        raise InvalidPosture(f"{len(postures)} postures; give one or two to draw")
    q = {name: as_postures(posture, body.p) for name, posture in postures.items()}
    with torch.no_grad():
        hands = {name: body.hand_in_camera(posture).numpy() * _MM for name, posture in q.items()}
        images = {name: body.hand_image(posture).numpy() * _MM for name, posture in q.items()}
    h_z = body.camera.screen.distance * _MM
    # Depth one axis, x or y the other; both sections share the scale.
    reach = 1.1 * max(hand[2] + body.hand.radius * _MM for hand in hands.values())
    aside = max(float(np.abs(hand[:2]).max()) for hand in hands.values()) + 1.6 * body.hand.radius * _MM
    aside = max(aside, 0.55 * reach)
    behind = -0.45 * reach
    figure = style.new_figure(style.DOUBLE_COLUMN, 1.4 + 3.0 * 2 * aside / (reach - behind))
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    camera_T_skin = _skin_in_camera(body, next(iter(q.values())))
    for axes, letter, axis, name, seen in zip(
        panels, "ab", (1, 0), "yx", ("from the robot's right", "from above"), strict=True
    ):
        _scene(axes, body, camera_T_skin, axis, (behind, reach), aside)
        for (hand, centre), colour, line in zip(hands.items(), _HANDS, _HAND_LINES, strict=False):
            _hand(axes, centre, images[hand], axis, body.hand.radius * _MM, h_z, colour, line, hand)
        last = list(hands)[-1]
        _dimensions(axes, hands[last], images[last], axis, name, h_z, aside)
        axes.set(xlim=(behind, reach), ylim=(aside, -aside), aspect="equal")
        axes.set(xlabel="z [mm]", ylabel=f"{name} [mm]", title=f"section {'x' if axis else 'y'} = 0, seen {seen}")
        axes.set_title(f"({letter})", loc="left")
        axes.tick_params(labelleft=True)
    handles: list[Any] = [
        Line2D([], [], **_SCREEN, label="virtual screen, z = $h_z$"),
        Line2D([], [], **_NEAR, label=f"near plane, z = {body.camera.screen.near * _MM:g} mm"),
        Patch(
            facecolor=_CONE,
            edgecolor="0.6",
            label=f"in view: beyond it, within {np.degrees(body.camera.screen.half_angle):.0f}\N{DEGREE SIGN} of z",
        ),
        Patch(facecolor=_SKIN, edgecolor="black", label=f"{style.label(body.require_skin().link)}, section"),
        Line2D([], [], marker="o", markersize=2.2, color="black", linestyle="", label="taxels near the section"),
        Line2D([], [], marker="X", markersize=4.5, color="0.35", linestyle="", label="image of the hand on the screen"),
    ]
    handles += [
        Line2D(
            [],
            [],
            color=colour,
            linestyle=line,
            marker="X",
            markersize=4.5,
            label=_numbers(name, hands[name], images[name]),
        )
        for name, colour, line in zip(hands, _HANDS, _HAND_LINES, strict=False)
    ]
    figure.legend(handles=handles[:6], loc="outside upper center", ncols=3, handlelength=1.8)
    figure.legend(handles=handles[6:], loc="outside lower center", ncols=1, handlelength=3)
    return figure


def _scene(
    axes: Axes,
    body: Embodiment,
    camera_T_skin: Float[np.ndarray, "4 4"],
    axis: int,
    depths: tuple[float, float],
    aside: float,
) -> None:
    """Skin, cone, near plane, screen and optical centre in the section where the other image axis is 0."""
    screen = body.camera.screen
    h_z, near, slope = screen.distance * _MM, screen.near * _MM, np.tan(screen.half_angle)
    far = depths[1]
    cone = [(near, -near * slope), (far, -far * slope), (far, far * slope), (near, near * slope)]
    axes.add_patch(Polygon(cone, facecolor=_CONE, edgecolor="none", zorder=0))
    for sign in (-1, 1):
        axes.plot([0, far], [0, sign * far * slope], color="0.6", linewidth=0.5, zorder=1)
    _section(axes, body, camera_T_skin, axis, aside)
    axes.plot([near, near], [-near * slope, near * slope], **_NEAR, zorder=2)
    half = min(h_z * slope, 0.97 * aside)
    axes.plot([h_z, h_z], [-half, half], **_SCREEN, zorder=3, label="screen")
    axes.axhline(0, color="0.3", linewidth=0.6, linestyle=(0, (8, 2, 1, 2)), zorder=2)
    axes.plot(0, 0, "o", color="black", markersize=4.5, zorder=7, label="optical centre")
    axes.annotate(
        "optical centre",
        (0, 0),
        (depths[0] * 0.5, -0.3 * aside),
        ha="center",
        fontsize=6.5,
        arrowprops={"arrowstyle": "-", "linewidth": 0.5, "shrinkB": 3},
    )


def _section(axes: Axes, body: Embodiment, camera_T_skin: Float[np.ndarray, "4 4"], axis: int, aside: float) -> None:
    """The skin's link cut by the plane, from lines along z, which meet each convex shape in one piece."""
    rotation, origin = camera_T_skin[:3, :3], camera_T_skin[:3, 3]

    def crossings(across: np.ndarray, ahead: float) -> tuple[np.ndarray, np.ndarray]:
        """Lines along z at these places, from a metre ahead or behind: starts and directions in the skin's link."""
        starts = np.zeros((len(across), 3))
        starts[:, axis], starts[:, 2] = across / _MM, ahead
        return (starts - origin) @ rotation, np.broadcast_to([0.0, 0.0, -ahead], starts.shape) @ rotation

    everywhere = np.linspace(-1.05 * aside, 1.05 * aside, _COARSE)
    met = everywhere[np.isfinite(cast(body.require_skin().shapes, *crossings(everywhere, 1.0))[0]).all(1)]
    if len(met) == 0:
        return
    # Lines lie close where the outline turns away from them.
    across = (met[0] + met[-1]) / 2 - (met[-1] - met[0]) / 2 * np.cos(np.linspace(0, np.pi, _LINES))
    for shape in body.require_skin().shapes:
        enter, leave = shape.crossing(*crossings(across, 1.0))
        front, back = (np.where(enter <= leave, (1.0 - t) * _MM, np.nan) for t in (enter, leave))
        axes.fill_betweenx(across, back, front, color=_SKIN, linewidth=0, zorder=1)
    front, back = (
        (cast(body.require_skin().shapes, *crossings(across, ahead))[0] @ rotation.T + origin)[:, 2] * _MM
        for ahead in (1.0, -1.0)
    )
    outline: dict[str, Any] = {"color": "black", "linewidth": 0.9, "zorder": 2}
    axes.plot(front, across, **outline, label="profile")
    axes.plot([front[0], *back, front[-1]], [across[0], *across, across[-1]], **outline)
    taxels = (body.require_skin().link_positions @ rotation.T + origin) * _MM
    spacing = (
        max(np.divide(body.require_skin().patch.size, np.maximum(np.subtract(body.require_skin().shape, 1), 1))) * _MM
    )
    near = taxels[np.abs(taxels[:, 1 - axis]) <= 0.5 * spacing]
    axes.plot(near[:, 2], near[:, axis], "o", color="black", markersize=1.8, zorder=4, label="taxels")


def _hand(
    axes: Axes,
    centre: Float[np.ndarray, "3"],
    image: Float[np.ndarray, "2"],
    axis: int,
    radius: float,
    h_z: float,
    colour: str,
    line: Any,
    name: str,
) -> None:
    place = (float(centre[2]), float(centre[axis]))
    axes.add_patch(Circle(place, radius, facecolor=colour, alpha=0.16, linewidth=0, zorder=3))
    axes.add_patch(Circle(place, radius, fill=False, edgecolor=colour, linewidth=1.0, linestyle=line, zorder=5))
    axes.plot(*place, "+", color=colour, markersize=5, zorder=6, label=f"hand: {name}")
    axes.plot([0, place[0]], [0, place[1]], color=colour, linewidth=0.9, linestyle=line, zorder=5)
    axes.plot(
        h_z,
        image[axis],
        "X",
        color=colour,
        markeredgecolor="white",
        markeredgewidth=0.4,
        markersize=6,
        zorder=8,
        label=f"image: {name}",
    )


def _dimensions(
    axes: Axes,
    hand: Float[np.ndarray, "3"],
    image: Float[np.ndarray, "2"],
    axis: int,
    name: str,
    h_z: float,
    aside: float,
) -> None:
    """Arrows for h_z and h'_z along the far side, and for the hand's and its image's distances from the axis."""
    arrow = {
        "arrowstyle": "<|-|>,head_length=0.25,head_width=0.12",
        "linewidth": 0.7,
        "color": "black",
        "shrinkA": 0,
        "shrinkB": 0,
    }
    side = -1.0 if hand[axis] > 0 else 1.0
    for level, depth, text in ((0.72, h_z, "$h_z$"), (0.87, float(hand[2]), "$h'_z$")):
        y = side * level * aside
        axes.annotate("", (0, y), (depth, y), arrowprops=arrow, zorder=6)
        for x in (0.0, depth):
            axes.plot(
                [x, x],
                [0.0 if x == 0 else float(hand[axis]) if level > 0.8 else 0, y],
                color="0.5",
                linewidth=0.4,
                zorder=1,
            )
        _text(axes, depth / 2 if depth == h_z else (h_z + depth) / 2, y, text)
    for depth, value, text in (
        (h_z, float(image[axis]), f"$h_{name}$"),
        (float(hand[2]), float(hand[axis]), f"$h'_{name}$"),
    ):
        x = depth - 4 if depth == h_z else depth
        if abs(value) > 0.02 * aside:
            axes.annotate("", (x, 0), (x, value), arrowprops=arrow, zorder=7)
        _text(axes, x, value / 2, text, ha="right" if depth == h_z else "left", pad=1.5 if depth != h_z else -1.5)


def _text(axes: Axes, x: float, y: float, text: str, ha: str = "center", pad: float = 0.0) -> None:
    axes.text(
        x + pad,
        y,
        text,
        ha=ha,
        va="center",
        zorder=9,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.85},
    )


def _numbers(name: str, hand: Float[np.ndarray, "3"], image: Float[np.ndarray, "2"]) -> str:
    def signed(values: np.ndarray) -> str:
        return ", ".join(f"{value:.1f}".replace("-", "\N{MINUS SIGN}") for value in values)

    return (
        f"hand {name}: $(h'_x, h'_y, h'_z)$ = ({signed(hand)}) mm  \N{RIGHTWARDS ARROW}  "
        f"$(h_x, h_y)$ = ({signed(image)}) mm"
    )


def _skin_in_camera(body: Embodiment, q: torch.Tensor) -> Float[np.ndarray, "4 4"]:
    with torch.no_grad():
        root_T_camera = body.kinematics.pose(q, body.camera.link).numpy() @ body.camera.link_T_camera.numpy()
        root_T_skin = body.kinematics.pose(q, body.require_skin().link).numpy()
    return np.linalg.solve(root_T_camera, root_T_skin)
