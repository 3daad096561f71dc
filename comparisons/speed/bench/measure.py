"""What is measured, on which robots and batches, and how much of it."""

from __future__ import annotations

import functools
import math
import multiprocessing
import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bench import others, processes
from bench.engines import Arm, Engine, arms, engines, missing
from bench.timing import quartiles, turns
from bodyimage_kin.backends import kinematics
from bodyimage_kin.errors import InvalidConfig

Report = Callable[[str], None]
_BATCH = 100_000
"""Postures by which threads are compared."""
_PACKAGES = (
    "bodyimage-kin",
    "numba",
    "torch",
    "numpy",
    "pin",
    "pytorch-kinematics",
    "mujoco",
    "frax",
    "jax",
    "minisom",
)


@dataclass(frozen=True)
class Settings:
    """What is measured.

    Attributes:
        batches: Numbers of postures at a time.
        rounds: Turns in which every engine is measured once.
        longest: An engine that would take longer [s] for a batch, judged by the batch before, is left out.
        robots: Names of the arms; empty: all that are installed.
        stream: Postures of the stream; 0: none.
        starts: Rounds of new processes, with their compiling; 0: none.
        reproductions: Which of the paper are run from end to end: "quick", "full".
    """

    batches: tuple[int, ...] = (1, 100, 10_000, 1_000_000)
    rounds: int = 15
    longest: float = 10.0
    robots: tuple[str, ...] = ()
    stream: int = 100_000_000
    starts: int = 7
    reproductions: tuple[str, ...] = ("quick", "full")

    def __post_init__(self) -> None:
        if not self.batches or min(self.batches) < 1:
            raise InvalidConfig("batches must be positive whole numbers")
        if self.rounds < 1:
            raise InvalidConfig("rounds must be positive")
        if unknown := set(self.reproductions) - {"quick", "full"}:
            raise InvalidConfig(f"no reproduction {min(unknown)!r}; give 'quick' or 'full'")


QUICK = Settings(batches=(1, 100, 10_000), rounds=7, longest=2.0, stream=10_000_000, starts=3, reproductions=("quick",))
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
        (over pytorch-kinematics in the same turn) as [lower quartile, median, upper quartile], ``first`` (seconds of
        the first call of all) and ``error`` (against Pinocchio, relative to the arm's reach); ``threads``, ``growth``,
        ``images``, ``maps``, ``networks``, ``stream``, ``starts``, ``reproductions``; what it ran on, and what was
        missing.
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
            first = _firsts(found, arm)
            errors = _errors(found, arm)
            for task in ("forward", "backward"):
                result[task] += _table(arm, found, task, first, errors, settings, report)
            report(f"{arm.name}: threads")
            result["threads"] += _threads(arm, found, settings)
        for name, measured in (
            ("growth", others.growth),
            ("images", others.images),
            ("maps", others.maps),
            ("networks", others.networks),
        ):
            report(name)
            result[name] = measured(settings.rounds)
        report("stream")
        result["stream"] = others.stream(settings.stream) if settings.stream else None
    report("new processes")
    result["starts"] = processes.starts(settings.starts) if settings.starts else []
    report("reproductions")
    result["reproductions"] = processes.reproductions(settings.reproductions)
    return result


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


def _firsts(found: Sequence[Engine], arm: Arm) -> dict[tuple[str, str], float]:
    """(engine, task) -> wall seconds of its first call, with one posture: what is built or compiled then."""
    q = arm.robot.sample(1, seed=2)
    seconds = {}
    for engine in found:
        for task in ("forward", "backward"):
            if (call := getattr(engine, task)) is not None:
                begin = time.perf_counter()
                call(q)
                seconds[engine.name, task] = time.perf_counter() - begin
    return seconds


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
    arm: Arm,
    found: list[Engine],
    task: str,
    first: Mapping[tuple[str, str], float],
    errors: Mapping[str, float],
    settings: Settings,
    report: Report,
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
        seconds = turns(work, settings.rounds, budget=4 * settings.longest)
        for name, taken in seconds.items():
            known[name] = float(np.median(taken))
            ratios = [a / b for a, b in zip(seconds[reference], taken, strict=True)] if reference in seconds else []
            rows.append(
                {
                    "robot": arm.name,
                    "joints": arm.robot.n,
                    "engine": name,
                    "batch": batch,
                    "rounds": len(taken),
                    "seconds": quartiles(taken),
                    "speed_up": quartiles(ratios) if ratios else None,
                    "first": first[name, task],
                    "error": errors[name],
                }
            )
        before = batch
    return rows


def _threads(arm: Arm, found: list[Engine], settings: Settings) -> list[dict[str, Any]]:
    """One thread against two, wall time."""
    rows = []
    for engine in (engine for engine in found if engine.threads):
        with _calls_in_threads(arm, engine) as work:
            seconds = turns(work, min(settings.rounds, 7), clock=time.perf_counter, budget=settings.longest)
        rows.append(
            {
                "robot": arm.name,
                "engine": engine.name,
                "batch": _BATCH,
                "one": quartiles(seconds["1"]),
                "two": quartiles(seconds["2"]),
                "speed_up": quartiles(a / b for a, b in zip(seconds["1"], seconds["2"], strict=True)),
            }
        )
    return rows


@contextmanager
def _calls_in_threads(arm: Arm, engine: Engine) -> Iterator[dict[str, Callable[[], Any]]]:
    """Calls by number of threads; where that is fixed in a process, each in a process of its own."""
    with ExitStack() as stack:
        if engine.fixed:
            spawn = multiprocessing.get_context("spawn")
            pools = {str(count): stack.enter_context(ProcessPoolExecutor(1, spawn)) for count in (1, 2)}

            def ask(count: str) -> None:
                pools[count].submit(_work, arm.name, engine.name, int(count)).result()

            yield {count: partial(ask, count) for count in pools}
        else:
            q = arm.robot.sample(_BATCH, seed=2)
            stack.callback(torch.set_num_threads, torch.get_num_threads())
            yield {str(count): partial(_in_threads, count, engine.forward, q) for count in (1, 2)}


def _in_threads(count: int, call: Callable[[Tensor], Any], q: Tensor) -> None:
    torch.set_num_threads(count)
    call(q)


def _work(arm: str, engine: str, threads: int) -> None:
    """What a process of :func:`_calls_in_threads` is asked, again and again."""
    _prepared(arm, engine, threads)()


@functools.lru_cache(1)
def _prepared(arm_name: str, engine_name: str, threads: int) -> Callable[[], Any]:
    torch.set_num_threads(threads)
    arm = next(arm for arm in arms() if arm.name == arm_name)
    engine = next(engine for engine in engines(arm) if engine.name == engine_name)
    return partial(engine.forward, arm.robot.sample(_BATCH, seed=2))
