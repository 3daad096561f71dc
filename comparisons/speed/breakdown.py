"""Where `bodyimage-kin reproduce` spends its time: ``OMP_NUM_THREADS=1 python comparisons/speed/breakdown.py``.

Runs every motion for one seed and prints processor seconds by part; then the figures, and the command from end to end.
"""

from __future__ import annotations

import dataclasses
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import torch

from bodyimage_kin.body_image import BodyImage, integration, posture_som
from bodyimage_kin.estimators import PaperMLP
from bodyimage_kin.published import fuke2007
from bodyimage_kin.recordings import dynamics, files, kinematic, motions
from bodyimage_kin.study import scoring

PARTS = {
    "passive arm in MuJoCo": (dynamics, "drag"),
    "kinematic motion": (kinematic, "follow"),
    "paths over the face": (motions.RandomTouch, "path"),
    "posture map (MiniSom)": (posture_som.PostureSOM, "fit"),
    "maps": (BodyImage, "learn"),
    "the paper's network": (PaperMLP, "fit"),
    "integration": (integration, "integrate"),
    "scores, all that is not above": (scoring, "computed"),
    "recordings to disk": (files, "write_recording"),
}


class Clock:
    """Processor seconds of each part, those of a part within it taken off."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.inner: list[float] = []

    def watch(self, part: str, owner: Any, name: str) -> None:
        """Replaces a function wherever a module of ours holds it."""
        given = owner.__dict__[name]
        function = given.__func__ if isinstance(given, classmethod) else given
        timed = self._timed(part, function)
        setattr(owner, name, classmethod(timed) if isinstance(given, classmethod) else timed)
        for module in [module for key, module in sys.modules.items() if key.startswith("bodyimage_kin")]:
            if getattr(module, name, None) is function:
                setattr(module, name, timed)

    def _timed(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def timed(*arguments: Any, **settings: Any) -> Any:
            self.inner.append(0.0)
            began = time.process_time()
            try:
                return function(*arguments, **settings)
            finally:
                taken = time.process_time() - began
                self.seconds[part] += taken - self.inner.pop()
                if self.inner:
                    self.inner[-1] += taken

        return timed


def main() -> None:
    """Measures and prints, after one seed that nothing is measured of."""
    torch.set_num_threads(1)
    runs: list[dict[str, float]] = []
    clock = Clock()
    for part, (owner, name) in PARTS.items():
        clock.watch(part, owner, name)
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(1, 5):
            clock.seconds.clear()
            began = time.process_time()
            # One seed after the other, each a study of its own, in this process.
            dataclasses.replace(fuke2007.grid(), seeds=[seed]).run(Path(folder, str(seed)), "in-process")
            total = time.process_time() - began
            runs.append({**clock.seconds, "all else": total - sum(clock.seconds.values()), "sum": total})
        for part in [*PARTS, "all else", "sum"]:
            print(f"{part:45} {statistics.median(run.get(part, 0.0) for run in runs[1:]):6.2f} s")
        command = [str(Path(sys.executable).with_name("bodyimage-kin")), "reproduce", "--out", f"{folder}/all"]
        began = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        print(f"{'the command, from end to end (wall)':45} {time.perf_counter() - began:6.1f} s")
        pages = Path(folder, "all")
        figures = sorted(path.stat().st_mtime for path in pages.rglob("*.png"))
        cells = sorted(path.stat().st_mtime for path in pages.rglob("study/**/*") if path.is_file())
        print(f"{'of these, from the last cell to the page':45} {figures[-1] - cells[-1]:6.1f} s")


if __name__ == "__main__":
    main()
