"""Draws cameras.png, the picture of ``conventions.md``: python docs/pictures/cameras.py (from anywhere)."""

from pathlib import Path

import matplotlib
import numpy as np
import torch

matplotlib.use("agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Rectangle

import bodyimage_kin as bk

INK, SOFT, HAND, X, Y, Z = "#222222", "#8a8f98", "#c2410c", "#b91c1c", "#15803d", "#1d4ed8"


def arrow(ax: Axes, start, end, colour: str, text: str = "", offset=(0.0, 0.0), **style) -> None:
    """An arrow, and a word at its tip."""
    look = {"arrowstyle": "-|>", "color": colour, "lw": 1.6, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 11} | style
    ax.annotate("", end, start, arrowprops=look, zorder=3)
    if text:
        ax.text(end[0] + offset[0], end[1] + offset[1], text, color=colour, ha="center", va="center", fontsize=9)


def eye(ax: Axes, place, forward=(1.0, 0.0), size=0.11) -> None:
    """A small camera: a triangle that opens forward."""
    forward = np.array(forward)
    aside = np.array([-forward[1], forward[0]])
    tip = np.array(place)
    ax.add_patch(
        Polygon([tip, tip + size * (forward + 0.6 * aside), tip + size * (forward - 0.6 * aside)], color=SOFT, lw=0)
    )
    ax.plot(*place, "o", color=INK, ms=4, zorder=4)


def clean(ax: Axes, title: str, x, y) -> None:
    """An empty sheet with a title."""
    ax.set(xlim=x, ylim=y, aspect="equal")
    ax.axis("off")
    ax.set_title(title, fontsize=10.5, loc="left", color=INK)


def axes_of_the_camera(ax: Axes) -> None:
    """What right, down and forward are."""
    clean(ax, "The camera's axes", (-0.35, 2.15), (-1.05, 0.75))
    # Seen from behind the camera's left shoulder: x to the right, y down, z away.
    project = np.array([[0.62, -0.10, 0.80], [-0.16, -0.72, 0.26]])
    origin = np.zeros(2)
    for axis, (colour, text, offset) in enumerate(
        [(X, "x, image right", (0.2, -0.1)), (Y, "y, image down", (0.0, -0.1)), (Z, "z, forward", (0.2, 0.08))]
    ):
        arrow(ax, origin, project[:, axis], colour, text, offset)
    corners = project @ np.array([[-0.5, 0.5, 0.5, -0.5], [-0.35, -0.35, 0.35, 0.35], [1.0, 1.0, 1.0, 1.0]])
    ax.add_patch(Polygon(corners.T, fill=True, fc="#1d4ed81a", ec=SOFT, lw=1))
    for corner in corners.T:
        ax.plot(*np.stack([origin, corner]).T, color=SOFT, lw=0.7)
    hand = project @ np.array([0.55, 0.3, 1.75])
    ax.plot(*np.stack([origin, hand]).T, color=HAND, lw=1, ls="--")
    ax.plot(*hand, "o", color=HAND, ms=8)
    ax.text(hand[0], hand[1] + 0.13, "hand  c = (x, y, z)", color=HAND, ha="center", fontsize=9)
    ax.text(-0.05, 0.09, "optical centre", color=INK, fontsize=8.5, ha="center")
    ax.text(1.2, -0.98, "link_T_camera: its columns are right, down,\nforward and the optical centre, in the link",
            color=INK, fontsize=8.5, ha="center")  # fmt: skip


def virtual_screen(ax: Axes) -> None:
    """The screen from the side."""
    clean(ax, "VirtualScreen [m]", (-0.25, 2.25), (-1.05, 0.75))
    model = bk.VirtualScreen(distance=0.7, near=0.95, half_angle=np.radians(32.0))
    hand = np.array([1.75, -0.55])  # depth, and minus y
    seen = -float(model.project(torch.tensor([0.0, -hand[1], hand[0]], dtype=torch.float64))[1])
    edge = np.tan(model.half_angle)
    cone = [(depth, side * depth * edge) for depth, side in ((0.95, 1), (2.25, 1), (2.25, -1), (0.95, -1))]
    ax.add_patch(Polygon(cone, fc="#1d4ed814", lw=0))
    for sign in (1, -1):
        ax.plot([0, 2.2], [0, sign * 2.2 * edge], color=SOFT, lw=0.8, ls=":")
    ax.plot([0.7, 0.7], [-0.62, 0.62], color=INK, lw=2)
    ax.text(0.7, 0.68, "screen", ha="center", fontsize=8.5)
    ax.plot([0.95, 0.95], [-0.62, 0.62], color=SOFT, lw=1, ls="--")
    ax.text(1.0, 0.55, "near", color=SOFT, fontsize=8.5)
    arrow(ax, (0, 0), (2.15, 0), Z, "z", (0.06, 0.07))
    arrow(ax, (0, 0), (0, -0.45), Y, "y", (-0.08, 0))
    ax.plot([0, hand[0]], [0, hand[1]], color=HAND, lw=1, ls="--")
    ax.plot(*hand, "o", color=HAND, ms=8)
    ax.plot(0.7, seen, "o", color=HAND, ms=5, mfc="white", zorder=5)
    ax.text(0.66, seen - 0.1, "$h_z\\,y/z$", color=HAND, ha="right", fontsize=9)
    ax.text(hand[0] + 0.06, hand[1], "(y, z)", color=HAND, fontsize=9, va="center")
    ax.annotate("", (0.7, -0.82), (0, -0.82), arrowprops={"arrowstyle": "<->", "color": INK, "lw": 1})
    ax.text(0.35, -0.93, "distance $h_z$", ha="center", fontsize=8.5)
    ax.text(1.6, -0.98, "seen: deeper than near, inside the cone", ha="center", fontsize=8.5)
    eye(ax, (0, 0))


def pinhole(ax: Axes) -> None:
    """A real lens: straight lines of the world in its image, and where its polynomial folds."""
    model = bk.Pinhole(420.0, 420.0, 319.5, 239.5, distortion=(-0.16, 0.008, 0.0, 0.0, 0.0), size=(640, 480))
    ax.set_title("Pinhole [px]", fontsize=10.5, loc="left", color=INK)
    ax.add_patch(Rectangle((-0.5, -0.5), 640, 480, fc="#1d4ed80d", ec=INK, lw=1.5))
    along = np.linspace(-1.4, 1.4, 200)
    for value in np.linspace(-1.4, 1.4, 15):
        for line in (np.stack([along, np.full(200, value)]), np.stack([np.full(200, value), along])):
            points = torch.from_numpy(np.vstack([line, np.ones(200)]).T)
            image = model.project(points).numpy()
            image[~model.visible(points).numpy()] = np.nan
            ax.plot(*image.T, color=SOFT, lw=0.7)
    arrow(ax, (0, 0), (150, 0), X, "u", (14, 22))
    arrow(ax, (0, 0), (0, 130), Y, "v", (22, 12))
    ax.plot(319.5, 239.5, "+", color=INK, ms=10, mew=1.6)
    ax.text(328, 226, "(cx, cy)", fontsize=9, ha="left", bbox={"fc": "white", "ec": "none", "pad": 0.8})
    hand = model.project(torch.tensor([0.12, 0.27, 1.0], dtype=torch.float64)).numpy()
    ax.plot(*hand, "o", color=HAND, ms=8)
    ax.text(hand[0] + 14, hand[1] + 4, "f d(x/z, y/z) + c", color=HAND, fontsize=9, va="center",
            bbox={"fc": "white", "ec": "none", "pad": 0.8})  # fmt: skip
    for place, text, at in (((0, 0), "middle of the first pixel: (0, 0)", (150, -42)),
                            ((639.5, 479.5), "edge of the last: (639.5, 479.5)", (430, 528))):  # fmt: skip
        ax.annotate(
            text,
            place,
            at,
            fontsize=8.5,
            arrowprops={"arrowstyle": "-", "color": SOFT, "lw": 0.8},
            ha="left" if at[1] < 0 else "center",
        )
    ax.set(xlim=(-60, 700), ylim=(545, -70), aspect="equal")
    ax.axis("off")


def stereo_and_tracker(ax: Axes) -> None:
    """Models of four and of three coordinates."""
    clean(ax, "Stereo [px, m = 4] and Tracker [m, m = 3]", (-0.45, 2.4), (-1.05, 0.75))
    left, right, hand = (0.0, 0.25), (0.0, -0.35), np.array([1.15, 0.05])
    for place, name in ((left, "left = the mount"), (right, "right")):
        eye(ax, place)
        ax.plot(*np.stack([place, hand]).T, color=HAND, lw=1, ls="--")
        ax.text(0.02, place[1] + (0.12 if name[0] == "l" else -0.15), name, fontsize=8.5, ha="center")
    ax.annotate("", right, left, arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.2, "shrinkA": 4, "shrinkB": 4})
    ax.text(-0.06, -0.06, "left_T_right", rotation=90, fontsize=8.5, ha="right", va="center")
    ax.plot(*hand, "o", color=HAND, ms=8)
    ax.text(0.62, -0.62, "(left u, left v,\n right u, right v)", color=HAND, ha="center", fontsize=9)
    base = np.array([1.55, -0.35])
    arrow(ax, base, base + np.array([0.36, 0.08]), X, "x", (0.07, 0.02))
    arrow(ax, base, base + np.array([-0.16, 0.24]), Y, "y", (-0.05, 0.06))
    arrow(ax, base, base + np.array([0.0, 0.42]), Z, "z", (0.0, 0.08))
    ax.plot(*base, "s", color=INK, ms=6)
    there = np.array([2.12, 0.28])
    ax.plot(*np.stack([base, there]).T, color=HAND, lw=1, ls="--")
    ax.plot(*there, "o", color=HAND, ms=8)
    ax.text(there[0], there[1] + 0.13, "(x, y, z)", color=HAND, ha="center", fontsize=9)
    ax.text(1.8, -0.62, "the point itself, in the\nmount's own axes", ha="center", fontsize=8.5)
    ax.text(
        1.0,
        -0.98,
        "Each may stand in the world, ride on the arm, or on a neck that is felt.",
        ha="center",
        fontsize=8.5,
    )


def main() -> None:
    """Draws all four beside this file."""
    plt.rcParams["font.family"] = "DejaVu Sans"
    figure, ((first, second), (third, fourth)) = plt.subplots(2, 2, figsize=(10.0, 7.6), layout="constrained")
    for draw, ax in (
        (axes_of_the_camera, first), (virtual_screen, second), (pinhole, third), (stereo_and_tracker, fourth),
    ):  # fmt: skip
        draw(ax)
    figure.get_layout_engine().set(rect=(0.0, 0.0, 1.0, 0.965))
    figure.savefig(Path(__file__).with_name("cameras.png"), dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
