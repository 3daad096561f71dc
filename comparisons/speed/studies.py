"""What a study costs beside its compute: ``OMP_NUM_THREADS=1 python comparisons/speed/studies.py``.

Works off studies of 10 to 10,000 cells that learn nothing and score nothing, from a recording that is there already, so
that all their time is the engine's; each in a process of its own. Writes ``studies.md`` and ``studies.json`` beside
this file.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

import bodyimage_kin as bk
from bodyimage_kin.estimators import ConstantJacobian, Estimator

HERE = Path(__file__).parent
SIZES = (10, 100, 1000, 5000, 10000)
SHAPES = {"ten rows": 10, "one row": 1}
ZERO = bk.study.Score("zero", ("probe",), "nothing", lambda context: [0.0] * len(context.probes))


@dataclass(frozen=True)
class Nothing(Estimator):
    """Learns nothing, at once."""

    number: int = 0

    def fit(self, exp: Any, seed: int = 0) -> Any:
        """A Jacobian of zeros."""
        return ConstantJacobian(torch.zeros(2, exp.sizes["joint"], dtype=torch.float64))


def study(cells: int, rows: int) -> bk.Study:
    """So many cells: rows on blocks of one seed each."""
    body = bk.load_embodiment("infant")
    seen = bk.simulate(body, bk.motions.Circle(turns=0.1), dynamics=False)
    return bk.Study(
        "infant",
        {"there": bk.study.Simulation(seen)},
        {f"row{number}": {"studies:Nothing": {"number": number}} for number in range(rows)},
        probes=["training"],
        seeds=cells // rows,
        block=1,
        scores=["studies:ZERO"],
        facts=[],
    )


def measure(cells: int, rows: int) -> dict[str, float]:
    """One study, worked off by one worker in a process that has done nothing before."""
    one, begun = study(cells, rows), []

    def tell(done: int, total: int) -> None:
        if done and not begun:
            begun.append((done, time.perf_counter(), time.process_time()))

    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder, "store")
        one.run(store, workers=1, progress=tell)
        end, driver = time.perf_counter(), time.process_time()
        workers = resource.getrusage(resource.RUSAGE_CHILDREN)
        begin = time.perf_counter()
        bk.read_study(store)
        read = time.perf_counter() - begin
        begin = time.perf_counter()
        command = [sys.executable, "-m", "bodyimage_kin.cli", "study", "--status", str(store)]
        subprocess.run(command, check=True, capture_output=True)
        asked = time.perf_counter() - begin
        asking = resource.getrusage(resource.RUSAGE_CHILDREN)
        files = [path for path in store.rglob("*") if path.is_file()]
        _, first, driver_first = begun[0]
        return {
            "cells": cells,
            "rows": rows,
            "seconds": end - first,
            "driver": driver - driver_first,
            "workers": workers.ru_utime + workers.ru_stime,
            "read": read,
            "status": asked,
            "status_processor": asking.ru_utime + asking.ru_stime - workers.ru_utime - workers.ru_stime,
            "files": len(files),
            "bytes": sum(path.stat().st_size for path in files),
            "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        }


def table(found: list[dict[str, float]]) -> str:
    """All that was measured, as Markdown."""
    head = ["cells", "run [s]", "a cell, wall [ms]", "driver [ms]", "worker [ms]", "`--status` [s]", "`read_study` [s]"]
    head += ["files", "store [MB]", "driver's memory [MB]"]
    lines = []
    for shape, rows in SHAPES.items():
        ones = [one for one in found if one["rows"] == rows]
        if not ones:
            continue
        # A worker's start is that of the smallest study.
        start = ones[0]["workers"]
        body = []
        for one in ones:
            cells = one["cells"]
            worker = "" if one is ones[0] else f"{(one['workers'] - start) / (cells - ones[0]['cells']) * 1e3:.2f}"
            body.append(
                [
                    f"{cells:,.0f}",
                    f"{one['seconds']:.2f}",
                    f"{one['seconds'] / cells * 1e3:.2f}",
                    f"{one['driver'] / cells * 1e3:.2f}",
                    worker,
                    f"{one['status']:.2f} ({one['status_processor']:.2f})",
                    f"{one['read']:.2f}",
                    f"{one['files']:,.0f}",
                    f"{one['bytes'] / 1e6:.1f}",
                    f"{one['memory']:.0f}",
                ]
            )
        lines += [
            f"## {shape.capitalize()} on each block of one seed",
            "",
            bk.study.markdown_table(head, body, words=0),
        ]
        lines.append("")
    return "\n".join(lines)


def page(machine: dict[str, Any], found: list[dict[str, float]]) -> str:
    """The page."""
    return (
        "# What a study costs beside its compute\n\n"
        f"Written by `python comparisons/speed/studies.py`; one worker, {machine['cores']} cores, Python "
        f"{machine['python']}, load {machine['busy']:.1f} meanwhile. "
        "Run, wall, `--status` and `read_study` are wall time, "
        "which a busy machine stretches;\ndriver, worker and what stands in brackets are processor time.\n\n"
        + table(found)
    )


def main() -> None:
    """Measures every size, each in a process of its own, and writes what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, nargs="*", default=SIZES)
    parser.add_argument("--out", type=Path, default=HERE)
    parser.add_argument("--one", type=int, nargs=2, metavar=("CELLS", "ROWS"), help="only this, as JSON on the output")
    asked = parser.parse_args()
    if asked.one:
        print(json.dumps(measure(*asked.one)))
        return
    found = []
    for rows in SHAPES.values():
        for cells in asked.cells:
            command = [sys.executable, __file__, "--one", str(cells), str(rows)]
            said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            found.append(json.loads(said.splitlines()[-1]))
            print(found[-1], flush=True)
    machine = {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count()}
    machine |= {"python": platform.python_version(), "busy": os.getloadavg()[1]}
    (asked.out / "studies.json").write_text(json.dumps({"machine": machine, "studies": found}, indent=1) + "\n")
    (asked.out / "studies.md").write_text(page(machine, found))


if __name__ == "__main__":
    main()
