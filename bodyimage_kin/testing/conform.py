"""Conformance: every law asked of every library, on random robots or on yours, with a report.

``bodyimage-kin conform`` calls :func:`conform`. A library is a backend of this package by name,
``"package.module:Class"`` or anything that builds a :class:`Library` of a URDF text. What fails is cut down to the
smallest robot and written as a URDF that holds link and posture in its last line: give that file as target, and just
this is asked again first.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from bodyimage_kin._checks import choice, number, whole
from bodyimage_kin._files import write_text
from bodyimage_kin._named import named_class
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, MissingDependency
from bodyimage_kin.robot import Robot
from bodyimage_kin.testing._conform_report import Failure, Report, Status, Verdict
from bodyimage_kin.testing._law import LAWS, Law, LawBroken
from bodyimage_kin.testing._library import Build, NotOffered, OurKinematics, argument
from bodyimage_kin.testing._reduce import reduced
from bodyimage_kin.testing._spec import Case, RobotSpec
from bodyimage_kin.testing.strategies import cases
from bodyimage_kin.testing.strategies import robots as any_robots

__all__ = ["Target", "conform", "random_cases"]

_KINDS_SHOWN = 3

Target = str | Path | None


def conform(
    target: Target = None,
    backends: Sequence[str | Build] | Mapping[str, Build] | None = None,
    examples: int = 100,
    out: str | Path | None = None,
    *,
    laws: Iterable[str] | None = None,
    tolerance: float = 0.0,
    robots: st.SearchStrategy[RobotSpec] = any_robots(),  # noqa: B008  (strategies are immutable and lazy)
    tell: Callable[[Verdict], None] | None = None,
) -> Report:
    """Asks every law of every library.

    Args:
        target: None: random robots. A URDF file, a folder of them (``*.urdf`` or ``*.URDF``, at any depth), or the
            name of an installed package that has URDFs among its files.
        backends: Libraries: names of backends, ``"package.module:Class"`` (found where it is installed, or in the
            current folder) or what builds a :class:`Library`; a mapping gives them names for the report. None: every
            backend of this package that is installed.
        examples: Cases for each library and law: random robots, or links and postures of each file.
        out: Folder for ``report.html``, ``report.json`` and ``failing/*.urdf``; None writes nothing.
        laws: Names of laws, each to be asked and passed; None: all that a library offers and a robot knows.
        tolerance: The largest relative error of a library whose values are not exact (:meth:`Law.within`): about 1e-5
            for one that computes in float32, 1e-7 for Jacobians by central differences.
        robots: Where random robots are drawn from; by default, all that URDF allows.
        tell: Called with each verdict as it falls.

    Returns:
        The report: ``str(report)`` is the table; ``report.exit_status`` is 0 only if all that was named (files,
        libraries, laws) was asked and passed.

    Raises:
        InvalidConfig: A target, library or law that does not exist, or a setting out of its range.
        MissingDependency: A backend that is not installed.
    """
    examples = whole("examples", examples, least=1)
    tolerance = number("tolerance", tolerance, least=0.0, below=1.0)
    named = () if laws is None else tuple(dict.fromkeys(choice("laws", name, LAWS) for name in laws))
    asked = [LAWS[name].within(tolerance) for name in (LAWS if laws is None else named)]
    libraries = _libraries(backends)
    read, refused = _robots(target)
    asked_on = random_cases(robots, examples) if read is None else read
    verdicts = []
    for name, build in libraries.items():
        for law in asked:
            verdict = _verdict(name, build, law, asked_on, examples, Path(out) if out is not None else None)
            verdicts.append(verdict)
            if tell is not None:
                tell(verdict)
    said = str(target) if target is not None else "random robots"
    report = Report(said, examples, tuple(verdicts), refused, len(read or ()), named, tolerance)
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
            libraries[backend] = named_class("library", backend, ("pose_and_jacobian", "pose"))
        elif backend not in known():
            raise InvalidConfig(f"no backend {backend!r}; valid: {', '.join(known())}, 'package.module:Class'")
        elif known()[backend] != "installed":
            raise MissingDependency(f"backend '{backend}' is not installed; {known()[backend]}")
        else:
            libraries[backend] = partial(OurKinematics, backend=backend)
    return libraries


def _robots(target: Target) -> tuple[dict[str, RobotSpec] | None, dict[str, str]]:
    """The robots of a target by name (None: random ones), and why the others were refused."""
    if target is None:
        return None, {}
    robots: dict[str, RobotSpec] = {}
    refused: dict[str, str] = {}
    for name, path in _files(target):
        try:
            robots[name] = RobotSpec.from_robot(Robot.from_urdf(path))
        except (BodyImageKinError, OSError) as problem:
            refused[name] = str(problem)
    return robots, refused


def _files(target: str | Path) -> Iterator[tuple[str, Path]]:
    """The URDF files of a target and short names for them."""
    place = Path(target)
    if place.is_file():
        yield place.name, place
        return
    if place.is_dir():
        found = {str(path.relative_to(place)): path for path in sorted(place.rglob("*")) if _is_urdf(path)}
    else:
        try:
            files = importlib.metadata.distribution(str(target)).files or []
        except (importlib.metadata.PackageNotFoundError, ValueError):
            raise InvalidConfig(
                f"{str(target)!r} is no file, no folder and no installed package; give one of these"
            ) from None
        found = {str(file): Path(str(file.locate())) for file in sorted(files) if _is_urdf(file)}
    if not found:
        raise InvalidConfig(f"{str(target)!r} has no *.urdf among its files; give a place that has")
    for name, path in found.items():
        # Published packages repeat one long prefix before every file.
        yield name.rpartition("/robots/")[2] if "/robots/" in name and not place.exists() else name, path


def _is_urdf(path: PurePath) -> bool:
    # Exporters of CAD programs write .URDF as well.
    return path.suffix.lower() == ".urdf"


@dataclass
class _Seen:
    """What was seen of one law while asking it of one library."""

    asked: int = 0
    worst: float | None = None
    problems: dict[str, list[tuple[Case, Exception]]] = field(default_factory=dict)

    def ask(self, build: Build, law: Law, case: Case) -> None:
        """Asks on, whatever the library does: one that fails on a robot may be right about others."""
        try:
            error = law(build, case)
        except NotOffered:
            raise
        except Exception as problem:
            self.asked += 1
            self.problems.setdefault(_kind(problem), []).append((case, problem))
            if not isinstance(problem, LawBroken):
                return
            error = problem.error
        else:
            self.asked += error is not None
        if error is not None:
            self.worst = max(self.worst or 0.0, error)


def _verdict(
    name: str, build: Build, law: Law, drawn: Sequence[Case] | Mapping[str, RobotSpec], examples: int, out: Path | None
) -> Verdict:
    seen = _Seen()
    try:
        if isinstance(drawn, Mapping):
            for robot in drawn.values():
                # A published robot takes long to read: once for all its cases.
                once = _once(build)
                for case in _cases_of(robot, examples):
                    seen.ask(once, law, case)
        else:
            for case in drawn:
                seen.ask(build, law, case)
    except NotOffered as problem:
        return Verdict(name, law.name, "not offered", None, law.bound, detail=str(problem))
    # Wrong numbers first, then what is raised most often.
    kinds = sorted(seen.problems, key=lambda kind: (kind != LawBroken.__name__, -len(seen.problems[kind])))
    failures = tuple(_failure(name, build, law, seen, kind, out) for kind in kinds[:_KINDS_SHOWN])
    status: Status = "failed" if failures else "passed" if seen.asked else "not asked"
    return Verdict(name, law.name, status, seen.worst, law.bound, seen.asked, failures=failures)


def _failure(name: str, build: Build, law: Law, seen: _Seen, kind: str, out: Path | None) -> Failure:
    """One kind of failure, on the smallest robot that shows it."""
    problems = seen.problems[kind]
    case, first = min(problems, key=lambda pair: (len(pair[0].robot.joints), len(pair[0].to_urdf())))
    case = reduced(case, lambda other: _fails_like(build, law, other, first))
    problem = _problem(build, law, case) or first
    detail = problem.detail if isinstance(problem, LawBroken) else f"raises {_first_line(problem)}"
    file = None
    if out is not None:
        stem = f"{name}-{law.name}" + ("" if isinstance(problem, LawBroken) else f"-{kind}")
        file = Path("failing") / (re.sub(r"[^\w.-]+", "_", stem) + ".urdf")
        (out / file).parent.mkdir(parents=True, exist_ok=True)
        write_text(out / file, case.to_urdf())
    return Failure(detail, len(problems), seen.asked, case, file)


def random_cases(robots: st.SearchStrategy[RobotSpec], count: int) -> list[Case]:
    """Random cases, the same ones in every run of the same code (Hypothesis also draws constants of the caller's)."""
    drawn: list[Case] = []

    @settings(
        max_examples=count,
        deadline=None,
        database=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate],
    )
    @given(cases(robots))
    def draw(case: Any) -> None:
        drawn.append(case)

    draw()
    return drawn


def _once(build: Build) -> Build:
    """The same, building only once of the same text."""

    @lru_cache(maxsize=8)
    def built(urdf: str) -> Any:
        return build(argument(build, urdf))

    return built


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


def _problem(build: Build, law: Law, case: Case) -> Exception | None:
    try:
        law(build, case)
    except Exception as problem:
        return problem
    return None


def _fails_like(build: Build, law: Law, case: Case, first: Exception) -> bool:
    """Whether a case fails in the same way, and not by a rounding where the first was far off."""
    problem = _problem(build, law, case)
    if problem is None or _kind(problem) != _kind(first):
        return False
    return not (isinstance(problem, LawBroken) and isinstance(first, LawBroken)) or (
        problem.error >= min(0.01 * first.error, 1e-3)
    )


def _kind(problem: Exception) -> str:
    return type(problem).__name__


def _first_line(problem: Exception) -> str:
    lines = str(problem).strip().splitlines()
    text = f"{type(problem).__name__}: {lines[0]}" if lines else type(problem).__name__
    return text if len(text) <= 160 else f"{text[:157]}..."
