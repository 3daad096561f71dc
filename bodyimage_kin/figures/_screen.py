"""The virtual screen in section, and how the hand is projected on it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon

from bodyimage_kin._arrays import ArrayLike, as_postures
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidPosture
from bodyimage_kin.figures._layout import SINGLE_COLUMN, drawing_on
from bodyimage_kin.figures._views import camera_pose
from bodyimage_kin.figures.labels import drawn, label
from bodyimage_kin.robot.shapes import cast
from bodyimage_kin.robot.triangles import Triangles

_MM = 1000.0
_LINES, _COARSE = 401, 8001
_HANDS: tuple[tuple[str, Any], ...] = (("#d55e00", "-"), ("#0072b2", (0, (4, 1.5))))
_SCREEN: dict[str, Any] = {"color": "black", "linewidth": 2.0, "solid_capstyle": "butt"}
_NEAR: dict[str, Any] = {"color": "0.35", "linewidth": 0.9, "linestyle": (0, (1, 1.2))}
_SKIN, _CONE = "#ecd3c2", "#e8eef5"


def virtual_screen(
    body: Embodiment, postures: Mapping[str, ArrayLike] | None = None, ax: Axes | None = None, *, axis: int = 1
) -> Axes:
    """The virtual screen in a section through the optical centre, and how the hand is projected on it (Fig. 6).

    Args:
        body: The embodiment; its camera is a virtual screen.
        postures: At most two felt postures (p,) by name, the hand in front of the camera plane; None: the hand at the
            reference taxel, and at home in view.
        ax: Axes to draw on; None: those of a new figure.
        axis: Of the image that is drawn upright: 1, seen from the robot's right, or 0, from above.

    Returns:
        The axes [mm], in the camera's coordinates: optical centre, screen at z = h_z, near plane, cone of view, skin;
        and each hand with its ray and its image, seen along the normal of the section.

    Raises:
        InvalidPosture: No posture, more than two, or others than of this body.
        InvalidConfig: The camera is no virtual screen.
        NotVisible: A hand that has no image.
        Unreachable: The reference taxel, when that is what is drawn.
    """
    screen = body.camera.screen
    named = _touching_and_in_view(body) if postures is None else dict(postures)
    if not 0 < len(named) <= len(_HANDS):
        raise InvalidPosture(f"{len(named)} postures; give one or two to draw")
    q = {name: as_postures(posture, body.p) for name, posture in named.items()}
    with torch.no_grad():
        hands = {name: body.hand_in_camera(posture).numpy() * _MM for name, posture in q.items()}
        images = {name: body.hand_image(posture).numpy() * _MM for name, posture in q.items()}
    radius, h_z = body.hand.radius * _MM, screen.distance * _MM
    # Depth one axis, x or y the other; sections of either share the scale.
    reach = 1.1 * max(hand[2] + radius for hand in hands.values())
    aside = max(float(np.abs(hand[:2]).max()) for hand in hands.values()) + 1.6 * radius
    aside = max(aside, 0.55 * reach)
    behind = -0.45 * reach
    with drawing_on(ax, height=1.4 + SINGLE_COLUMN * 2 * aside / (reach - behind)) as axes:
        _scene(axes, body, next(iter(q.values())), axis, (behind, reach), aside)
        for (name, centre), (colour, line) in zip(hands.items(), _HANDS, strict=False):
            _hand(axes, centre, images[name], axis, radius, h_z, colour, line, name)
        last = list(hands)[-1]
        _dimensions(axes, hands[last], images[last], axis, h_z, aside)
        axes.set(xlim=(behind, reach), ylim=(aside, -aside), aspect="equal")
        axes.set(xlabel="z [mm]", ylabel=f"{'xy'[axis]} [mm]", title=("from above", "from the robot's right")[axis])
        return axes


def _touching_and_in_view(body: Embodiment) -> dict[str, torch.Tensor]:
    skin = body.require_skin()
    at = [label(name) for name, taxel in skin.landmarks.items() if taxel == skin.reference]
    touching = body.touch_postures([skin.reference])[0]
    return {f"touching the {(*at, 'reference taxel')[0]}": touching, "in view": body.felt_home}


def _scene(axes: Axes, body: Embodiment, q: torch.Tensor, axis: int, depths: tuple[float, float], aside: float) -> None:
    """Skin, cone, near plane, screen and optical centre in the section where the other image axis is 0."""
    screen = body.camera.screen
    h_z, near, slope = screen.distance * _MM, screen.near * _MM, np.tan(screen.half_angle)
    far = depths[1]
    cone = [(near, -near * slope), (far, -far * slope), (far, far * slope), (near, near * slope)]
    half = min(h_z * slope, 0.97 * aside)
    axes.plot([h_z, h_z], [-half, half], **_SCREEN, zorder=3, label=f"virtual screen, z = {h_z:g} mm")
    axes.plot([near, near], [-near * slope, near * slope], **_NEAR, zorder=2, label=f"near plane, z = {near:g} mm")
    angle = f"{np.degrees(screen.half_angle):.0f}\N{DEGREE SIGN}"
    axes.add_patch(Polygon(cone, facecolor=_CONE, edgecolor="none", zorder=0, label=f"in view: within {angle} of z"))
    for sign in (-1, 1):
        axes.plot([0, far], [0, sign * far * slope], color="0.6", linewidth=0.5, zorder=1)
    if body.skin is not None:
        _section(axes, body, q, axis, aside)
    axes.axhline(0, color="0.3", linewidth=0.6, linestyle=(0, (8, 2, 1, 2)), zorder=2)
    axes.plot(0, 0, "o", color="black", markersize=4.5, zorder=7)
    axes.annotate(
        "optical centre",
        (0, 0),
        (depths[0] * 0.5, -0.3 * aside),
        ha="center",
        fontsize=6.5,
        arrowprops={"arrowstyle": "-", "linewidth": 0.5, "shrinkB": 3},
    )


def _section(axes: Axes, body: Embodiment, q: torch.Tensor, axis: int, aside: float) -> None:
    """The skin's link cut by the plane, from lines along z, which meet each convex shape in one piece."""
    skin = body.require_skin()
    root_T_skin = body.kinematics.pose(q, skin.link).detach().numpy()
    camera_T_skin = np.linalg.solve(camera_pose(body, q), root_T_skin)
    rotation, origin = camera_T_skin[:3, :3], camera_T_skin[:3, 3]

    def crossings(across: np.ndarray, ahead: float) -> tuple[np.ndarray, np.ndarray]:
        """Lines along z at these places, from a metre ahead or behind: starts and directions in the skin's link."""
        starts = np.zeros((len(across), 3))
        starts[:, axis], starts[:, 2] = across / _MM, ahead
        return (starts - origin) @ rotation, np.broadcast_to([0.0, 0.0, -ahead], starts.shape) @ rotation

    everywhere = np.linspace(-1.05 * aside, 1.05 * aside, _COARSE)
    met = everywhere[np.isfinite(cast(skin.surface or (), *crossings(everywhere, 1.0))[0]).all(1)]
    if len(met) == 0:
        return
    # Lines lie close where the outline turns away from them.
    across = (met[0] + met[-1]) / 2 - (met[-1] - met[0]) / 2 * np.cos(np.linspace(0, np.pi, _LINES))
    for shape in skin.surface or ():
        if isinstance(shape, Triangles):
            continue
        enter, leave = shape.crossing(*crossings(across, 1.0))
        front, back = (np.where(enter <= leave, (1.0 - t) * _MM, np.nan) for t in (enter, leave))
        axes.fill_betweenx(across, back, front, color=_SKIN, linewidth=0, zorder=1)
    front, back = (
        (cast(skin.surface or (), *crossings(across, ahead))[0] @ rotation.T + origin)[:, 2] * _MM
        for ahead in (1.0, -1.0)
    )
    outline: dict[str, Any] = {"color": "black", "linewidth": 0.9, "zorder": 2}
    axes.plot(front, across, **outline, label=f"{drawn(skin.link)}, section")
    axes.plot([front[0], *back, front[-1]], [across[0], *across, across[-1]], **outline)
    taxels = (skin.link_positions @ rotation.T + origin) * _MM
    spacing = (max(skin.layout.steps) if skin.layout is not None else skin.spacing) * _MM
    near = taxels[np.abs(taxels[:, 1 - axis]) <= 0.5 * spacing]
    look: dict[str, Any] = {"marker": "o", "color": "black", "markersize": 1.8, "linestyle": ""}
    axes.plot(near[:, 2], near[:, axis], **look, zorder=4, label="taxels near the section")


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
    axes.plot([0, place[0]], [0, place[1]], color=colour, linewidth=0.9, linestyle=line, zorder=5)
    axes.plot(*place, "+", color=colour, markersize=6, linestyle="", zorder=6, label=f"hand {drawn(name)}")
    cross: dict[str, Any] = {"marker": "X", "color": colour, "markeredgecolor": "white", "markeredgewidth": 0.4}
    axes.plot(h_z, image[axis], **cross, markersize=6, linestyle="", zorder=8, label=f"its image, {drawn(name)}")


def _dimensions(
    axes: Axes, hand: Float[np.ndarray, "3"], image: Float[np.ndarray, "2"], axis: int, h_z: float, aside: float
) -> None:
    """Arrows for h_z and h'_z along the far side, and for the hand's and its image's distances from the axis."""
    arrow = {"arrowstyle": "<|-|>,head_length=0.25,head_width=0.12", "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0}
    depth, name = float(hand[2]), "xy"[axis]
    side = -1.0 if hand[axis] > 0 else 1.0
    for level, end, middle, text in (
        (0.72, h_z, h_z / 2, "$h_z$"),
        (0.87, depth, (h_z + depth) / 2, "$h\N{PRIME}_z$"),
    ):
        y = side * level * aside
        axes.annotate("", (0, y), (end, y), arrowprops=arrow, zorder=6)
        axes.plot([0, 0], [0, y], color="0.5", linewidth=0.4, zorder=1)
        axes.plot([end, end], [float(hand[axis]) if end == depth else 0.0, y], color="0.5", linewidth=0.4, zorder=1)
        _text(axes, middle, y, text)
    for x, value, text, ha, pad in (
        (h_z - 4, float(image[axis]), f"$h_{name}$", "right", -1.5),
        (depth, float(hand[axis]), f"$h\N{PRIME}_{name}$", "left", 1.5),
    ):
        if abs(value) > 0.02 * aside:
            axes.annotate("", (x, 0), (x, value), arrowprops=arrow, zorder=7)
        _text(axes, x + pad, value / 2, text, ha=ha)


def _text(axes: Axes, x: float, y: float, text: str, ha: str = "center") -> None:
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.85}
    axes.text(x, y, text, ha=ha, va="center", zorder=9, bbox=box)
