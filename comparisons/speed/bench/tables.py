"""Results as files: speed.json with everything, speed.md for readers, speed.svg and .png to look at."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

_NOT_DRAWN = ("numba, out=", "Pinocchio, whole robot")
_ORACLE = "Pinocchio, arm alone"
COMMAND = "python comparisons/speed/run.py"


def write(result: Mapping[str, Any], folder: str | Path) -> Path:
    """Writes speed.json, speed.md, speed.svg and speed.png.

    Args:
        result: What :func:`bench.run` gave.
        folder: Where to; made if missing, earlier files of these names are replaced.

    Returns:
        The path of speed.md.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "speed.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    _plot(result, folder)
    (folder / "speed.md").write_text(markdown(result), encoding="utf-8")
    return folder / "speed.md"


def markdown(result: Mapping[str, Any]) -> str:
    """The tables: median, and in brackets the quartiles where there is room for them."""
    machine, versions = result["machine"], result["versions"]
    lines = [
        "# Speed",
        "",
        f"Made by `{COMMAND}` on {machine['processor']} ({machine['cores']} cores, {machine['system']}, "
        f"Python {machine['python']}).",
        ", ".join(f"{name} {version}" for name, version in versions.items() if version) + ".",
        *(f"Not installed, so not measured: {how}." for how in result["missing"].values()),
        "",
        "Pose and 6 x n Jacobian in float64. One thread is measured in processor time, engines in turns within one "
        "process; medians, quartiles in brackets. Times as fast: over pytorch-kinematics in the same turn. Error: "
        "largest difference from Pinocchio over 1000 postures, relative to the reach (at least 1 m). "
        "pytorch-kinematics is taken as it comes, and reads the URDF's numbers in float32. First: the first call, wall "
        "time; frax compiles as long again for each other size of batch.",
    ]
    for task, title in (("forward", "Pose and Jacobian"), ("backward", "Pose and Jacobian, and their gradient")):
        lines += ["", f"## {title}"]
        for robot in dict.fromkeys(row["robot"] for row in result[task]):
            lines += ["", *_robot_table([row for row in result[task] if row["robot"] == robot])]
    lines += [
        "",
        "## Two threads",
        "",
        "Batches of 100,000, wall time; quiet cores are needed for these. Aim: numba 1.6 times as fast.",
        "",
    ]
    rows = [
        [row["robot"], row["engine"], *(_time(row[count][1]) for count in ("one", "two")), _spread(row["speed_up"])]
        for row in result["threads"]
    ]
    lines += _grid(["robot", "engine", "one, wall time", "two, wall time", "times as fast"], rows)
    lines += ["", "## How cost grows", "", "By numba; chains of seven joints, batches of 10,000, unless said.", ""]
    rows = [
        [row["by"], str(row["size"]), _time(row["seconds_a_posture"][1]), _range(row["seconds_a_posture"])]
        for row in result["growth"]
    ]
    lines += _grid(["by", "number", "a posture", "quartiles"], rows)
    lines += ["", "## Hand images, maps and networks", "", "One thread, processor time.", ""]
    rows = [
        [row["what"], str(row.get("batch", row.get("steps"))), _time(row["seconds"][1]), _range(row["seconds"])]
        for row in (*result["images"], *result["maps"], *result["networks"])
    ]
    lines += _grid(["what", "postures or steps", "time", "quartiles"], rows)
    if (stream := result["stream"]) is not None:
        speed = stream["postures"] / stream["processor_seconds"] / 1e6
        lines += [
            "",
            f"Stream: {stream['postures'] / 1e6:g} million postures of {stream['joints']} joints in "
            f"{stream['processor_seconds']:.1f} s of processor time ({speed:.0f} million a second), "
            "in constant memory.",
        ]
    if waits := [*result["starts"], *result["reproductions"]]:
        lines += ["", "## New processes", "", "Wall time of new processes; reproductions have one a core.", ""]
        rows = [
            [
                *(row["what"], str(row["rounds"]), _time(row["seconds"][1]), _range(row["seconds"])),
                f"under {_time(row['aim'])}" if row["aim"] else "",
            ]
            for row in waits
        ]
        lines += _grid(["what", "times", "median", "quartiles", "aim"], rows)
    return "\n".join(lines) + "\n"


def _robot_table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    batches = list(dict.fromkeys(row["batch"] for row in rows))
    cells = {(row["engine"], row["batch"]): row for row in rows}
    lines = []
    for engine in dict.fromkeys(row["engine"] for row in rows):
        line = [engine]
        for batch in batches:
            row = cells.get((engine, batch))
            if row is None:
                line.append("-")
                continue
            faster = f", {_spread(row['speed_up'])}" if row["speed_up"] else ""
            line.append(_time(row["seconds"][1]) + faster)
        any_row = next(row for row in rows if row["engine"] == engine)
        lines.append([*line, _time(any_row["first"]), f"{any_row['error']:.0e}"])
    heads = [f"batch {batch:,}: time, times as fast" for batch in batches]
    return _grid([f"{rows[0]['robot']} ({rows[0]['joints']} joints)", *heads, "first", "error"], lines)


def _grid(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    bars = ["---"] * len(heads)
    return ["| " + " | ".join(cells) + " |" for cells in (heads, bars, *rows)]


def _time(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def _range(values: Sequence[float]) -> str:
    return f"{_time(values[0])} to {_time(values[2])}"


def _spread(values: Sequence[float]) -> str:
    low, middle, high = (f"{value:.3g}" for value in values)
    return f"{middle} [{low}, {high}]"


def _plot(result: Mapping[str, Any], folder: Path) -> None:
    """Postures a second over the batch, a panel an arm."""
    from bodyimage_kin import figures

    rows = result["forward"]
    robots = list(dict.fromkeys(row["robot"] for row in rows))
    # As many as can be told apart: the variants that are left out have their rows in the tables.
    engines = [name for name in dict.fromkeys(row["engine"] for row in rows) if name not in _NOT_DRAWN]
    with figures.style():
        looks = figures.looks(name for name in engines if name != _ORACLE)
        looks[_ORACLE] = figures.looks(["truth"])["truth"]
        figure, grid = figures.panels(1, len(robots), height=2.7, sharey=True)
        panels = grid[0]
        for axes, robot in zip(panels, robots, strict=True):
            for engine in engines:
                points = [row for row in rows if row["robot"] == robot and row["engine"] == engine]
                batches = [row["batch"] for row in points]
                speeds = [[row["batch"] / row["seconds"][place] for row in points] for place in (0, 1, 2)]
                axes.plot(batches, speeds[1], **looks[engine], label=engine)
                axes.fill_between(batches, speeds[2], speeds[0], color=looks[engine]["color"], alpha=0.2, linewidth=0)
            axes.set(xscale="log", yscale="log", xlabel="batch", title=robot)
        panels[0].set_ylabel("postures a second")
        panels[-1].legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
        figures.save(figure, folder, "speed")
