"""What a user waits for: a new process with its imports and compiling, the command's help, the whole reproduction."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.timing import quartiles
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.errors import BodyImageKinError

_FIRST = """
import json, sys, time
begin = time.perf_counter()
import torch
import bodyimage_kin as bk
import bodyimage_kin.backends.numba_backend
bk.kinematics, bk.Robot
imported = time.perf_counter()
robot = bk.Robot.from_urdf(sys.argv[1])
bk.kinematics(robot, "numba").pose_and_jacobian(robot.sample(1), sys.argv[2])
print(json.dumps([imported - begin, time.perf_counter() - imported]))
"""


def starts(rounds: int) -> list[dict[str, Any]]:
    """Seconds of new processes, wall time: help, imports, and the first pose and Jacobian once imports are done.

    Args:
        rounds: Of each; compiling is seen three times at most.
    """
    body = load_embodiment("infant")
    link = body.hand.link
    helps: list[float] = []
    imports: list[float] = []
    cold: list[float] = []
    warm: list[float] = []
    said = True
    with tempfile.TemporaryDirectory() as name:
        urdf = Path(name, "arm.urdf")
        urdf.write_text(body.robot.subtree([link], joints=body.joints).to_urdf(), encoding="utf-8")
        for turn in range(rounds):
            begin = time.perf_counter()
            _python(["-m", "bodyimage_kin.cli", "--help"])
            helps.append(time.perf_counter() - begin)
            # A folder is cold once; whatever is compiled for this checkout is neither used nor replaced.
            cache = {"NUMBA_CACHE_DIR": str(Path(name, f"cache{min(turn, 2)}"))}
            first = ["-c", _FIRST, str(urdf), link]
            if turn < 3:
                done = _python(first, cache)
                cold.append(json.loads(done.stdout)[1])
                said &= "compiling" in done.stderr
            seconds = json.loads(_python(first, cache).stdout)
            imports.append(seconds[0])
            warm.append(seconds[1])
    told = "said to the user" if said else "NOT said to the user"
    return [
        _row("bodyimage-kin --help", helps),
        _row("imports: torch and this package", imports),
        _row(f"first pose and Jacobian ever, compiled ({told})", cold, aim=15.0),
        _row("first pose and Jacobian of a later process, after imports", warm, aim=0.5),
    ]


def reproductions(kinds: Sequence[str]) -> list[dict[str, Any]]:
    """Wall seconds of ``bodyimage-kin reproduce``, one process a core, each kind once.

    Args:
        kinds: Of "quick" and "full".
    """
    rows = []
    for kind in kinds:
        with tempfile.TemporaryDirectory() as folder:
            command = ["-m", "bodyimage_kin.cli", "reproduce", "--out", folder]
            begin = time.perf_counter()
            _python([*command, "--quick"] if kind == "quick" else command)
            rows.append(_row(f"bodyimage-kin reproduce, {kind}", [time.perf_counter() - begin]))
    return rows


def _row(what: str, seconds: Sequence[float], aim: float | None = None) -> dict[str, Any]:
    return {"what": what, "rounds": len(seconds), "seconds": quartiles(seconds), "aim": aim}


def _python(arguments: Sequence[str], environment: Mapping[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or ["no message"]
        raise BodyImageKinError(f"a process that is measured failed: {last[0]}")
    return done
