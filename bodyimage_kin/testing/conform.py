"""Conformance: every law asked of every library, on random robots or on yours, with a report.

``bodyimage-kin conform`` calls :func:`conform`. A library is a backend of this package by name, ``"module:Class"`` or
anything that builds a :class:`Library` of a URDF text. What fails is cut down to the smallest robot and written as a
URDF that holds link and posture in its last line: give that file as target, and just this is asked again first.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.metadata
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import HypothesisException

from bodyimage_kin.errors import InvalidConfig, InvalidURDF, MissingDependency
from bodyimage_kin.robot import Robot
from bodyimage_kin.testing._conform_report import Report, Verdict
from bodyimage_kin.testing._law import LAWS, Law, LawBroken
from bodyimage_kin.testing._library import Build, NotOffered, OurKinematics
from bodyimage_kin.testing._reduce import reduced
from bodyimage_kin.testing._spec import Case, RobotSpec
from bodyimage_kin.testing.strategies import cases

Target = str | Path | None


def conform(
    target: Target = None,
    backends: Sequence[str | Build] | Mapping[str, Build] | None = None,
    examples: int = 100,
    out: str | Path | None = None,
    *,
    laws: Iterable[str] | None = None,
    tell: Callable[[Verdict], None] | None = None,
) -> Report:
    """Asks every law of every library.

    Args:
        target: None: random robots. A URDF file, a folder of them, or the name of an installed package that has URDFs
            among its files.
        backends: Libraries: names of backends, ``"module:Class"`` or what builds a :class:`Library`; a mapping gives
            them names for the report. None: every backend of this package that is installed.
        examples: Cases for each library and law: random robots, or links and postures of each file.
        out: Folder for ``report.html``, ``report.json`` and ``failing/*.urdf``; None writes nothing.
        laws: Names of laws; None: all of them.
        tell: Called with each verdict as it falls.

    Returns:
        The report: ``str(report)`` is the table, ``report.exit_status`` is 0 when no law is broken.

    Raises:
        InvalidConfig: A target, library or law that does not exist, or less than one example.
        MissingDependency: A backend that is not installed.
    """
    if examples < 1:
        raise InvalidConfig(f"examples is {examples}; give at least 1")
    asked = list(LAWS) if laws is None else list(laws)
    if unknown := [name for name in asked if name not in LAWS]:
        raise InvalidConfig(f"no law {unknown[0]!r}; valid: {', '.join(LAWS)}")
    libraries = _libraries(backends)
    robots, refused = _robots(target)
    verdicts = []
    for name, build in libraries.items():
        for law in asked:
            verdict = _verdict(name, build, LAWS[law], robots, examples, Path(out) if out is not None else None)
            verdicts.append(verdict)
            if tell is not None:
                tell(verdict)
    report = Report(
        str(target) if target is not None else "random robots", examples, tuple(verdicts), refused, len(robots or ())
    )
    if out is not None:
        report.write(Path(out))
    return report


def _libraries(backends: Sequence[str | Build] | Mapping[str, Build] | None) -> dict[str, Build]:
    from bodyimage_kin.backends import backends as known

    if isinstance(backends, Mapping):
        return dict(backends)
    if backends is None:
        backends = [name for name, state in known().items() if state == "installed"]
    libraries: dict[str, Build] = {}
    for backend in backends:
        if not isinstance(backend, str):
            libraries[getattr(backend, "__name__", repr(backend))] = backend
        elif ":" in backend:
            libraries[backend] = _load(backend)
        elif backend not in known():
            raise InvalidConfig(f"no backend {backend!r}; valid: {', '.join(known())}, 'module:Class'")
        elif known()[backend] != "installed":
            raise MissingDependency(f"backend '{backend}' is not installed; {known()[backend]}")
        else:
            libraries[backend] = partial(OurKinematics, backend=backend)
    return libraries


def _load(place: str) -> Build:
    module, _, attribute = place.partition(":")
    try:
        found: Build = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as problem:
        raise InvalidConfig(f"cannot load library {place!r}: {problem}; give 'module:Class'") from problem
    return found


def _robots(target: Target) -> tuple[dict[str, RobotSpec] | None, dict[str, str]]:
    """The robots of a target by name (None: random ones), and why the others were refused."""
    if target is None:
        return None, {}
    robots: dict[str, RobotSpec] = {}
    refused: dict[str, str] = {}
    for name, path in _files(target):
        try:
            robots[name] = RobotSpec.from_robot(Robot.from_urdf(path))
        except InvalidURDF as problem:
            refused[name] = str(problem)
    return robots, refused


def _files(target: str | Path) -> Iterator[tuple[str, Path]]:
    """The URDF files of a target and short names for them."""
    place = Path(target)
    if place.is_file():
        yield place.name, place
        return
    if place.is_dir():
        found = {str(path.relative_to(place)): path for path in sorted(place.rglob("*.urdf"))}
    else:
        try:
            files = importlib.metadata.distribution(str(target)).files or []
        except (importlib.metadata.PackageNotFoundError, ValueError):
            raise InvalidConfig(
                f"{str(target)!r} is no file, no folder and no installed package; give one of these"
            ) from None
        found = {str(file): Path(str(file.locate())) for file in sorted(files) if file.suffix == ".urdf"}
    if not found:
        raise InvalidConfig(f"{str(target)!r} has no *.urdf among its files; give a place that has")
    for name, path in found.items():
        # Published packages repeat one long prefix before every file.
        yield name.rpartition("/robots/")[2] if "/robots/" in name and not place.exists() else name, path


@dataclass
class _Found:
    """What was seen of one law."""

    worst: float = 0.0
    case: Case | None = None
    problem: Exception | None = None
    robot: str = ""
    failures: int = 0


def _verdict(
    name: str, build: Build, law: Law, robots: Mapping[str, RobotSpec] | None, examples: int, out: Path | None
) -> Verdict:
    try:
        found = _on_random(build, law, examples) if robots is None else _on_files(build, law, robots, examples)
    except NotOffered as problem:
        return Verdict(name, law.name, "not offered", None, law.bound, str(problem))
    if found.problem is None or found.case is None:
        return Verdict(name, law.name, "passed", found.worst, law.bound)
    case = reduced(found.case, lambda other: _same_failure(build, law, other, found.problem))
    failure = _failure(build, law, case) or found.problem
    # An exception is no error of any size.
    error = failure.error if isinstance(failure, LawBroken) else None
    detail = failure.detail if isinstance(failure, LawBroken) else f"raises {_first_line(failure)}"
    if robots is not None:
        detail += f" ({found.failures} of {len(robots)} robots; smallest from {found.robot})"
    worst = None if error is None else max(error, found.worst)
    return Verdict(name, law.name, "failed", worst, law.bound, detail, case, _written(name, law, case, out))


def _on_random(build: Build, law: Law, examples: int) -> _Found:
    found = _Found()

    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        derandomize=True,
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate, Phase.shrink],
    )
    @given(cases())
    def ask(case: Any) -> None:
        try:
            found.worst = max(found.worst, law(build, case))
        except NotOffered:
            raise
        except Exception as problem:
            found.case, found.problem = case, problem
            raise

    try:
        ask()
    except NotOffered:
        raise
    except HypothesisException:
        if found.problem is None:
            raise
    except Exception as problem:
        if problem is not found.problem and found.problem is None:
            raise
    return found


def _on_files(build: Build, law: Law, robots: Mapping[str, RobotSpec], examples: int) -> _Found:
    found = _Found()
    for name, robot in robots.items():
        # A published robot takes long to read: once for all its cases.
        once = partial(_built, build)
        for case in _cases_of(robot, examples):
            try:
                found.worst = max(found.worst, law(once, case))
            except NotOffered:
                raise
            except Exception as problem:
                found.failures += 1
                if found.case is None or len(robot.joints) < len(found.case.robot.joints):
                    found.case, found.problem, found.robot = case, problem, name
                break
    return found


@lru_cache(maxsize=4)
def _built(build: Build, argument: Any) -> Any:
    return build(argument)


def _cases_of(robot: RobotSpec, count: int) -> Iterator[Case]:
    """Links and postures of a robot: the noted case first, then the deepest link at zero, then random ones."""
    if (noted := Case.read(robot)) is not None:
        yield noted
        count -= 1
    # By its text, so that neither the order of files nor their number matters.
    seed = int.from_bytes(hashlib.sha256(robot.to_urdf().encode()).digest()[:8], "little")
    random = np.random.default_rng(seed)
    deepest_first = sorted(robot.links, key=lambda link: -len(robot.path(link)))
    lower = np.array([max(joint.limits[0], -np.pi) for joint in robot.free_joints])
    upper = np.array([min(joint.limits[1], np.pi) for joint in robot.free_joints])
    for index in range(count):
        if index == 0:
            yield Case(robot, (0.0,) * robot.n, deepest_first[0])
            continue
        q = lower + (upper - lower) * random.random(robot.n)
        # The deep half: where most of the tree is on the path.
        link = deepest_first[int(random.integers(0, max(1, len(deepest_first) // 2)))]
        yield Case(robot, tuple(q.tolist()), link)


def _failure(build: Build, law: Law, case: Case) -> Exception | None:
    try:
        law(build, case)
    except Exception as problem:
        return problem
    return None


def _same_failure(build: Build, law: Law, case: Case, first: Exception | None) -> bool:
    problem = _failure(build, law, case)
    if type(problem) is not type(first):
        return False
    if isinstance(problem, LawBroken) and isinstance(first, LawBroken):
        # Not a small error in place of a large one, nor another shape in place of a wrong number.
        return problem.error >= min(first.error, 1e-3) or np.isinf(problem.error) == np.isinf(first.error) == 1
    return True


def _written(name: str, law: Law, case: Case, out: Path | None) -> Path | None:
    """Writes the failing case as a URDF that can be given as target."""
    if out is None:
        return None
    from bodyimage_kin._files import write_text

    path = Path("failing") / (re.sub(r"[^\w.-]+", "_", f"{name}-{law.name}") + ".urdf")
    (out / path).parent.mkdir(parents=True, exist_ok=True)
    write_text(out / path, case.to_urdf())
    return path


def _first_line(problem: Exception) -> str:
    lines = str(problem).strip().splitlines()
    text = f"{type(problem).__name__}: {lines[0]}" if lines else type(problem).__name__
    return text if len(text) <= 160 else f"{text[:157]}..."
