"""A pad, an arm, and a link that grew: ``python comparisons/tactile_arm/run.py --data FOLDER``, results beside this.

FOLDER holds ``tactile_arm/`` with the files of ``event-driven-robotics/LEARNING-NEUROMORPHIC-BODY-SCHEMA``, or is named
by ``BODYIMAGE_KIN_DATA``; without it nothing is done, and that is said. Under a minute of one quiet core.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

import bodyimage_kin as bk
from bodyimage_kin import figures
from bodyimage_kin.body_image import PostureSOM

HERE = Path(__file__).parent
LINK = 0.2
"""Of both links [m]; joint 1 is at zero at 70 degrees."""
ZERO = np.radians(70.0)
GRID = (12, 21)
TOOLS = {"link 1 grew by 20 mm": "tool_l1plus20mm", "link 2 grew by 20 mm": "tool_l2plus20mm"}
SIZES = (5, 10, 20, 50, 100, 200)
DRAWS = 400
MAPS = 100
CAUCHY = 2.0
"""Residuals beyond so many taxels begin to lose their weight: one touch in ten is far off."""


def arm(lengths: tuple[float, float] = (LINK, LINK)) -> bk.Embodiment:
    """The planar arm, its hand's place in the plane as a tracker would tell it [m]."""
    rows = [(lengths[0], 0.0, 0.0, ZERO), (lengths[1], 0.0, 0.0, 0.0)]
    robot = bk.Robot.from_dh(rows, joints=["shoulder", "elbow"], name="tactile_arm")
    return bk.Embodiment.build(
        robot,
        joints=["shoulder", "elbow"],
        hand=bk.Hand(robot.link_names[-1]),
        camera=bk.Camera(robot.root, np.eye(4), bk.Tracker()),
    )


class Touches:
    """A recording of touches: postures, and the touched row and column; nothing of the recorded positions."""

    def __init__(self, q: np.ndarray, taxel: np.ndarray) -> None:
        self.q, self.taxel = q, taxel

    @classmethod
    def read(cls, folder: Path, name: str) -> Touches:
        """One of the files, whose last name stands for 252 columns."""
        table = np.loadtxt(folder / "tactile_arm" / f"{name}.csv", delimiter=",", skiprows=1, usecols=range(9))
        return cls(table[:, 3:5], table[:, 7:9])

    def __len__(self) -> int:
        return len(self.q)

    def only(self, rows: np.ndarray) -> Touches:
        """Some of them."""
        return Touches(self.q[rows], self.taxel[rows])

    def place(self, body: bk.Embodiment) -> np.ndarray:
        """Where a body believes its hand to be, (touches, 2) [m]."""
        return np.asarray(body.hand_image(torch.from_numpy(self.q)).numpy()[:, :2])

    def grown(self, body: bk.Embodiment, pad: np.ndarray) -> np.ndarray:
        """How the foreseen taxel moves with the two lengths, (touches, 2, 2) [taxels/m]."""
        angle = ZERO + np.stack([self.q[:, 0], self.q.sum(1)], 1)
        place = np.stack([np.cos(angle), np.sin(angle)], 1)
        return np.einsum("xt,nxl->ntl", pad[:2], place)


def fitted_pad(touches: Touches, body: bk.Embodiment) -> np.ndarray:
    """Row and column as an affine function of the hand's place, (3, 2); touches far off weigh less."""
    X = np.c_[touches.place(body), np.ones(len(touches))]
    weight = np.ones(len(X))
    for _ in range(20):
        root = np.sqrt(weight)[:, None]
        pad = np.linalg.lstsq(X * root, touches.taxel * root, rcond=None)[0]
        weight = 1 / (1 + ((touches.taxel - X @ pad) ** 2).sum(1) / CAUCHY**2)
    return pad


def off(touches: Touches, body: bk.Embodiment, pad: np.ndarray) -> np.ndarray:
    """Touched less foreseen taxel, (touches, 2)."""
    return touches.taxel - np.c_[touches.place(body), np.ones(len(touches))] @ pad


def growth(left: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, float]:
    """By how much both links seem to have grown [m], and by how much that lowers the cost (Cauchy's)."""
    found = np.zeros(2)
    for _ in range(20):
        now = left - slope @ found
        weight = 1 / (1 + (now**2).sum(1) / CAUCHY**2)
        A = np.einsum("n,ntl,ntk->lk", weight, slope, slope)
        found = found + np.linalg.solve(A, np.einsum("n,ntl,nt->l", weight, slope, now))
    return found, _cost(left) - _cost(left - slope @ found)


def _cost(left: np.ndarray) -> float:
    return float(np.log1p((left**2).sum(1) / CAUCHY**2).sum())


def mapped(touches: Touches, body: bk.Embodiment, begin: np.ndarray | None = None) -> np.ndarray:
    """The body image of the pad by what the body believes, (12, 21, 2) [m], going on from an older one."""
    number = (touches.taxel[:, 0] * GRID[1] + touches.taxel[:, 1]).astype(int)
    place = touches.place(body)
    exp = bk.recording(q=touches.q, touched=number, joints=list(body.joints), order="stream", sampling=0.3)
    settings: dict[str, Any] = {"alpha": "constant"} if begin is not None else {"gamma_final": 1.0}
    learned = bk.BodyImage.learn(
        exp, place[None], skin=GRID, gamma=4.0 if begin is not None else 40.0, initial_map=begin, snapshots=(),
        posture_grid=(1, 1), posture_som=PostureSOM(np.zeros((1, 1, 2)), np.ones(2)), **settings,
    )  # fmt: skip
    return learned.tactile_map


def noticed(found: np.ndarray, usual: np.ndarray) -> float:
    """Share of values beyond 95 % of what is usual."""
    return float((found > np.quantile(usual, 0.95)).mean())


def measured(folder: Path) -> dict[str, Any]:
    """Everything that is published."""
    old = arm()
    before = Touches.read(folder, "no_tool")
    # Runs of 50 successive touches: half of them teach, a quarter says what is usual, a quarter is a change of nothing.
    run = np.arange(len(before)) // 50 % 4
    taught, usual, nothing = (before.only(np.isin(run, part)) for part in ([0, 2], [1], [3]))
    pad = fitted_pad(taught, old)
    after = {name: Touches.read(folder, file) for name, file in TOOLS.items()}
    grown = {"link 1 grew by 20 mm": arm((0.22, 0.2)), "link 2 grew by 20 mm": arm((0.2, 0.22))}
    floor = float(np.median(np.linalg.norm(off(before.only(run % 2 == 1), old, pad), axis=1)))
    found: dict[str, Any] = {"floor": floor, "tools": {}, "sizes": list(SIZES)}
    for name, touches in after.items():
        whole, _ = growth(off(touches, old, pad), touches.grown(old, pad))
        rng = np.random.default_rng(0)
        runs = [np.flatnonzero(np.arange(len(touches)) // 50 == one) for one in range(len(touches) // 50)]
        drawn = []
        for _ in range(DRAWS):
            rows = touches.only(np.concatenate([runs[one] for one in rng.integers(len(runs), size=len(runs))]))
            drawn.append(growth(off(rows, old, pad), rows.grown(old, pad))[0])
        found["tools"][name] = {
            "old_arm": float(np.median(np.linalg.norm(off(touches, old, pad), axis=1))),
            "new_arm": float(np.median(np.linalg.norm(off(touches, grown[name], pad), axis=1))),
            "growth_mm": (1e3 * whole).tolist(),
            "interval_mm": (1e3 * np.quantile(drawn, [0.025, 0.975], axis=0)).T.tolist(),
        }
    found["power"] = power(old, pad, usual, {"nothing (false alarms)": nothing, **after})
    found["map_power"] = map_power(old, taught, usual, {"nothing (false alarms)": nothing, **after})
    return found


def power(old: bk.Embodiment, pad: np.ndarray, usual: Touches, judged: Mapping[str, Touches]) -> dict[str, list[float]]:
    """How often n touches tell that lengths have changed, at five per cent false alarms."""
    found: dict[str, list[float]] = {name: [] for name in judged}
    for size in SIZES:
        gains = {name: _gains(old, pad, touches, size) for name, touches in {"": usual, **judged}.items()}
        for name in judged:
            found[name].append(noticed(gains[name], gains[""]))
    return found


def _gains(old: bk.Embodiment, pad: np.ndarray, touches: Touches, size: int) -> np.ndarray:
    left, slope = off(touches, old, pad), touches.grown(old, pad)
    rng = np.random.default_rng(size)
    draws = (rng.integers(len(touches), size=size) for _ in range(DRAWS))
    return np.array([growth(left[rows], slope[rows])[1] for rows in draws])


def map_power(
    old: bk.Embodiment, taught: Touches, usual: Touches, judged: Mapping[str, Touches]
) -> dict[str, list[float]]:
    """The same from the map alone: how far n touches move the map that was there, all taxels together."""
    begin = mapped(taught, old)
    found: dict[str, list[float]] = {name: [] for name in judged}
    for size in SIZES:
        moved = {}
        for name, touches in {"": usual, **judged}.items():
            rng = np.random.default_rng(size)
            maps = [mapped(touches.only(rng.integers(len(touches), size=size)), old, begin) for _ in range(MAPS)]
            moved[name] = np.array([np.linalg.norm((one - begin).mean((0, 1))) for one in maps])
        for name in judged:
            found[name].append(noticed(moved[name], moved[""]))
    return found


def markdown(found: Mapping[str, Any]) -> str:
    """The tables that are published."""
    lines = [
        f"Median distance from foreseen to touched taxel: {found['floor']:.2f} taxels before anything grew, on touches "
        "that the pad was not fitted to. Growth by touched rows and columns alone; in brackets 95 % over runs of 50 "
        "successive touches.",
        "",
        "| | old arm [taxels] | new arm [taxels] | link 1 [mm] | link 2 [mm] |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for name, row in found["tools"].items():
        links = [
            f"{mean:+.1f} [{low:+.1f}, {high:+.1f}]"
            for mean, (low, high) in zip(row["growth_mm"], row["interval_mm"], strict=True)
        ]
        lines.append(f"| {name} | {row['old_arm']:.2f} | {row['new_arm']:.2f} | {' | '.join(links)} |")
    heads = "| | " + " | ".join(f"{size} touches" for size in found["sizes"]) + " |"
    for words, key in (
        (f"Share of {DRAWS} draws of so many touches in which a fit of both lengths tells a change, the threshold set "
         "for five per cent false alarms on other touches from before:", "power"),
        (f"The same from the map alone ({MAPS} draws): so many touches move the mean of all taxels farther than 95 in "
         "a hundred draws of touches from before do.", "map_power"),
    ):  # fmt: skip
        lines += ["", words, "", heads, "| --- |" + " ---: |" * len(found["sizes"])]
        lines += [
            f"| {name} | " + " | ".join(f"{one:.2f}" for one in shares) + " |" for name, shares in found[key].items()
        ]
    return "\n".join(lines) + "\n"


@figures.style()
def draw(found: Mapping[str, Any], folder: Path) -> None:
    """How many touches tell that a link grew."""
    figure, grid = figures.panels(1, 2, height=2.2, sharey=True)
    for axes, key, title in zip(grid[0], ("power", "map_power"), ("a fit of lengths", "the map alone"), strict=True):
        for (name, shares), line in zip(found[key].items(), (":", "o-", "s--"), strict=True):
            axes.plot(found["sizes"], shares, line, ms=3, label=name)
        axes.set(xscale="log", xlabel="touches", title=title, ylim=(0, 1.02))
        axes.set_xticks(found["sizes"], [str(size) for size in found["sizes"]])
        axes.minorticks_off()
    grid[0][0].set(ylabel="share noticed")
    grid[0][0].legend(fontsize="small")
    figures.save(figure, folder, "noticed")


def main(arguments: Sequence[str] | None = None) -> None:
    """Computes everything; writes results.json, table.md and the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=None, help="holds tactile_arm/ (default: BODYIMAGE_KIN_DATA)")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the results")
    asked = parser.parse_args(arguments)
    folder = asked.data or Path(os.environ.get("BODYIMAGE_KIN_DATA", ""))
    if not (folder / "tactile_arm" / "no_tool.csv").is_file():
        print(f"skipped: no tactile_arm/no_tool.csv in '{folder}'; give --data FOLDER (README.md says whence)")
        return
    torch.set_num_threads(1)
    found = measured(folder)
    asked.out.mkdir(parents=True, exist_ok=True)
    (asked.out / "results.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (asked.out / "table.md").write_text(markdown(found), encoding="utf-8")
    draw(found, asked.out)
    print(markdown(found))


if __name__ == "__main__":
    main()
