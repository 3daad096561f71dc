"""The measuring: in turns, so that a busy moment of the machine strikes all alike; medians and quartiles."""

from __future__ import annotations

import math
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bodyimage_kin.backends import kinematics
from bodyimage_kin.bench import others
from bodyimage_kin.bench.engines import Arm, Engine, arms, engines, missing
from bodyimage_kin.errors import InvalidConfig

Report = Callable[[str], None]
_LEAST = 1e-2
"""Shorter work is repeated until a measurement takes about as long [s]: what others left in caches counts little."""
_PACKAGES = ("bodyimage-kin", "numba", "torch", "numpy", "pin", "pytorch-kinematics", "mujoco", "minisom")


@dataclass(frozen=True)
class Settings:
    """What is measured.

    Attributes:
        batches: Numbers of postures at a time.
        rounds: Turns in which every engine is measured once.
        longest: An engine that would take longer [s] for a batch, judged by the batch before, is left out.
        robots: Names of the arms; empty: all that are installed.
        stream: Postures of the stream; 0: none.
    """

    batches: tuple[int, ...] = (1, 100, 10_000, 1_000_000)
    rounds: int = 15
    longest: float = 20.0
    robots: tuple[str, ...] = ()
    stream: int = 100_000_000

    def __post_init__(self) -> None:
        if not self.batches or min(self.batches) < 1:
            raise InvalidConfig("batches must be positive whole numbers")
        if self.rounds < 1:
            raise InvalidConfig("rounds must be positive")


QUICK = Settings(batches=(1, 100, 10_000), rounds=7, longest=2.0, stream=10_000_000)
"""For a first look."""


def run(settings: Settings | None = None, report: Report = lambda _: None) -> dict[str, Any]:
    """Measures everything that is installed, for some minutes.

    One thread is measured in processor time, which other processes of the machine disturb little; several threads in
    wall time.

    Args:
        settings: None: the defaults.
        report: Is told what is measured next.

    Returns:
        Ready for JSON: ``forward`` and ``backward``, a row an engine, batch and arm, with ``seconds`` and ``speed_up``
        (over pytorch-kinematics in the same turn) as [lower quartile, median, upper quartile] and ``error`` (against
        Pinocchio, relative to the arm's reach); ``threads``, ``growth``, ``images``, ``maps``, ``stream``; what it ran
        on, and what was missing.
    """
    settings = settings or Settings()
    chosen = [arm for arm in arms() if not settings.robots or arm.name in settings.robots]
    result: dict[str, Any] = {
        "settings": asdict(settings),
        "machine": machine(),
        "versions": {name: _version(name) for name in _PACKAGES},
        "missing": missing(),
        "forward": [],
        "backward": [],
        "threads": [],
    }
    with one_thread():
        for arm in chosen:
            found = engines(arm)
            errors = _errors(found, arm)
            for task in ("forward", "backward"):
                result[task] += _table(arm, found, task, errors, settings, report)
            report(f"{arm.name}: threads")
            result["threads"] += _threads(arm, found, settings)
        for name, measured in (
            ("growth", others.growth),
            ("images", others.images),
            ("maps", others.maps),
        ):
            report(name)
            result[name] = measured(settings.rounds)
        report("stream")
        result["stream"] = others.stream(settings.stream) if settings.stream else None
    return result


def turns(
    work: Mapping[str, Callable[[], Any]], rounds: int, clock: Callable[[], float] = time.process_time
) -> dict[str, list[float]]:
    """Seconds of every piece of work, in turns."""
    repeats = {}
    for name, call in work.items():
        call()
        begin = clock()
        call()
        repeats[name] = max(1, int(_LEAST / max(clock() - begin, 1e-9)))
    seconds: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(rounds):
        for name, call in work.items():
            begin = clock()
            for _ in range(repeats[name]):
                call()
            seconds[name].append((clock() - begin) / repeats[name])
    return seconds


def quartiles(values: Iterable[float]) -> list[float]:
    """Lower quartile, median, upper quartile."""
    return [float(value) for value in np.quantile(list(values), [0.25, 0.5, 0.75])]


@contextmanager
def one_thread() -> Iterator[None]:
    """One thread for torch and for what asks torch; afterwards as many as before."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def machine() -> dict[str, Any]:
    """Processor, cores and system; no names."""
    processor = platform.processor()
    information = Path("/proc/cpuinfo")
    if information.is_file():
        models = [line for line in information.read_text().splitlines() if line.startswith("model name")]
        processor = models[0].partition(":")[2].strip() if models else processor
    return {
        "processor": processor,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
    }


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _errors(found: list[Engine], arm: Arm) -> dict[str, float]:
    """Largest difference from Pinocchio, over the arm's reach [m] or one, whichever is larger."""
    q = arm.robot.sample(1000, seed=1)
    truth = kinematics(arm.robot, "pinocchio").pose_and_jacobian(q, arm.link)
    scale = max(1.0, float(truth[0][:, :3, 3].norm(dim=-1).max()))
    errors = {}
    for engine in found:
        pairs = zip(engine.forward(q), truth, strict=True)
        errors[engine.name] = max(float((torch.as_tensor(one) - other).abs().max()) for one, other in pairs) / scale
    return errors


def _table(
    arm: Arm, found: list[Engine], task: str, errors: Mapping[str, float], settings: Settings, report: Report
) -> list[dict[str, Any]]:
    calls = {engine.name: getattr(engine, task) for engine in found if getattr(engine, task) is not None}
    most = {engine.name: engine.most if task == "backward" else math.inf for engine in found}
    reference = found[0].name
    rows, known, before = [], dict.fromkeys(calls, 0.0), 0
    for batch in settings.batches:
        report(f"{arm.name}: {task}, batch {batch}")
        q = arm.robot.sample(batch, seed=2)
        expected = {name: known[name] * batch / before if before else 0.0 for name in calls}
        work = {
            name: partial(call, q)
            for name, call in calls.items()
            if expected[name] <= settings.longest and batch <= most[name]
        }
        slow = sum(expected[name] for name in work)
        rounds = max(3, min(settings.rounds, int(3 * settings.longest / slow) if slow else settings.rounds))
        seconds = turns(work, rounds)
        for name, taken in seconds.items():
            known[name] = float(np.median(taken))
            ratios = [a / b for a, b in zip(seconds[reference], taken, strict=True)] if reference in seconds else []
            rows.append(
                {
                    "robot": arm.name,
                    "joints": arm.robot.n,
                    "engine": name,
                    "batch": batch,
                    "rounds": rounds,
                    "seconds": quartiles(taken),
                    "speed_up": quartiles(ratios) if ratios else None,
                    "error": errors[name],
                }
            )
        before = batch
    return rows


def _in_threads(count: int, call: Callable[[Tensor], Any], q: Tensor) -> None:
    torch.set_num_threads(count)
    call(q)


def _threads(arm: Arm, found: list[Engine], settings: Settings) -> list[dict[str, Any]]:
    """One thread against two, wall time."""
    rows = []
    q = arm.robot.sample(100_000, seed=2)
    for engine in (engine for engine in found if engine.threads):
        work = {str(count): partial(_in_threads, count, engine.forward, q) for count in (1, 2)}
        seconds = turns(work, min(settings.rounds, 9), clock=time.perf_counter)
        torch.set_num_threads(1)
        rows.append(
            {
                "robot": arm.name,
                "engine": engine.name,
                "batch": len(q),
                "one": quartiles(seconds["1"]),
                "two": quartiles(seconds["2"]),
                "speed_up": quartiles(a / b for a, b in zip(seconds["1"], seconds["2"], strict=True)),
            }
        )
    return rows
