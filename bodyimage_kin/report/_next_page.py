"""Where to look next, as a page: postures to go to, and the error that is expected after each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bodyimage_kin import figures
from bodyimage_kin.body import Embodiment
from bodyimage_kin.calibration import NextPostures
from bodyimage_kin.report._answer import Section, Table, names, percent, write_answer
from bodyimage_kin.report._page import Picture, fixed


def write(chosen: NextPostures, body: Embodiment, probes: Sequence[str], path: Path, said: Sequence[str] = ()) -> Path:
    """See :func:`bodyimage_kin.report.write_next_postures`."""
    errors = chosen.predicted_error
    where = names([figures.label(name) for name in probes])
    count = len(chosen.q)
    sections = [
        Section(
            "What was done",
            [
                "The body may be off in its axes and offsets by as much as its prior allows, less what was seen "
                "already tells. Candidates are postures within the joint limits in which the camera sees the hand. "
                f"They are chosen one by one, by how much the image of each lowers the expected error {where}, then "
                "exchanged as long as that lowers what is left after all of them; the one that tells most is first.",
                "The expected error is that of the body fitted to these images, for bodies that are off as the prior "
                "says; it is no promise for one that is off otherwise, and far too hopeful or too gloomy while only a "
                "handful of postures was seen. Go to all of them, calibrate, and ask again. For fewer, ask anew: "
                "the best few together are not the first of these.",
            ],
        )
    ]
    if said:
        sections.append(Section("Said on the way", items=list(said)))
    return write_answer(
        path,
        f"Where should the robot look next? {body.name}",
        [
            f"Look at the hand in {'this posture' if count == 1 else f'these {count} postures'}: what the body does "
            f"not know of its own hand-eye map {where} should fall from {percent(errors[0])} to {percent(errors[-1])}.",
        ],
        _picture(chosen, where),
        _table(chosen, body),
        notes=["Turning joints in degrees, sliding ones in millimetres; postures.csv has them in radians and metres."],
        sections=sections,
    )


def _picture(chosen: NextPostures, where: str) -> Picture:
    def draw() -> Figure:
        figure, grid = figures.panels(1, 1, height=2.4, width=figures.SINGLE_COLUMN)
        axes = grid[0, 0]
        axes.plot(np.arange(len(chosen.predicted_error)), 100 * chosen.predicted_error, color="#c2407e", marker="o")
        figures.decades(axes, "y", 100 * chosen.predicted_error)
        axes.set(xlabel="postures looked at", ylabel="expected error [%]")
        axes.xaxis.get_major_locator().set_params(integer=True)
        return figure

    return Picture(
        "predicted_error", "first", draw, "What is expected after each posture",
        f"Relative error of the hand-eye Jacobian {where}, before anything more is looked at and after each posture.",
    )  # fmt: skip


def _table(chosen: NextPostures, body: Embodiment) -> Table:
    kinds = {joint.name: joint.kind for joint in body.felt_robot.tree.joints}
    slides = [kinds[name] == "prismatic" for name in chosen.joints]
    rows = [["now", percent(float(chosen.predicted_error[0])), *[""] * len(chosen.joints)]]
    for index, q in enumerate(chosen.q):
        cells = [
            fixed(1e3 * value if slide else math.degrees(value), 1) for value, slide in zip(q, slides, strict=True)
        ]
        rows.append([str(index + 1), percent(float(chosen.predicted_error[index + 1])), *cells])
    return Table(("posture", "error after it", *chosen.joints), rows)
