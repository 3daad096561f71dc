"""The command ``doctor``: what is installed, and whether it computes right here."""

from __future__ import annotations

import os
import platform
import re
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from bodyimage_kin.cli.arguments import Command, Flag, print_json

if TYPE_CHECKING:
    from bodyimage_kin.body import Embodiment

__all__ = ["Doctor"]

_PACKAGE = "bodyimage-kin"
_POSTURES = 64
_EXACT, _BY_DIFFERENCES = 1e-12, 1e-7
_STEP = 1e-5


@dataclass(frozen=True)
class Doctor(Command):
    """Say what is installed, and hold every backend against the oracle on the spot, in some ten seconds.

    Exit status 1 when a check fails; what is not installed and not needed is no failure.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = ("bodyimage-kin doctor", "bodyimage-kin doctor --json")

    json: Flag = False
    """As JSON, for a machine or a bug report."""

    def __call__(self) -> int:
        """Runs it."""
        found = _machine()
        checks = _checks()
        wrong = any(check["error"] for check in checks)
        if self.json:
            print_json({"healthy": not wrong, **found, "checks": checks})
            return int(wrong)
        print(f"bodyimage-kin {found['version']}, Python {found['python']}, {found['platform']}")
        print(f"cores {found['cores']}, threads of torch {found['threads']}, GPU {found['gpu'] or 'none'}")
        for title in ("backends", "packages", "extras"):
            print(f"\n{title}")
            for name, state in found[title].items():
                print(f"  {name:<20} {state}")
        print("\nchecks")
        for check in checks:
            said = check["error"] or f"{check['value']:.1e} (at most {check['limit']:.0e})"
            print(f"  {'FAILS' if check['error'] else 'right'}  {check['name']}: {said}, {check['seconds']:.1f} s")
        print("\nwrong: see above" if wrong else "\nall right")
        return int(wrong)


# What is there -------------------------------------------------------------------------------------------------------


def _machine() -> dict[str, Any]:
    import torch

    from bodyimage_kin import __version__
    from bodyimage_kin.backends import backends

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "version": __version__,
        "python": platform.python_version(),
        "executable": sys.executable,
        "platform": platform.platform(),
        "cores": cores,
        "threads": torch.get_num_threads(),
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
        "backends": backends(),
        **_requirements(),
    }


def _requirements() -> dict[str, dict[str, str]]:
    """Versions of what the package needs; and of each extra, whether it is complete, or how to install it."""
    packages: dict[str, str] = {}
    missing: dict[str, list[str]] = {}
    extras: dict[str, None] = {}
    for line in metadata.requires(_PACKAGE) or ():
        name = re.split(r"[\s\[<>=!~;(]", line, maxsplit=1)[0]
        extra = found[1] if (found := re.search(r"extra\s*==\s*['\"]([^'\"]+)['\"]", line)) else ""
        version = _version(name)
        if not extra:
            packages[name] = version or f"missing: pip install {name}"
        elif extra not in ("dev", "docs", "bench"):
            extras[extra] = None
            if version is None:
                missing.setdefault(extra, []).append(name)
    states = {
        extra: f"lacks {', '.join(missing[extra])}: pip install '{_PACKAGE}[{extra}]'"
        if extra in missing
        else "installed"
        for extra in extras
    }
    return {"packages": packages, "extras": states}


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


# Whether it computes right -------------------------------------------------------------------------------------------


def _checks() -> list[dict[str, Any]]:
    from bodyimage_kin.body.file import load_embodiment

    body = load_embodiment("infant", "pinocchio")
    each: dict[str, tuple[Callable[[Embodiment], float], float]] = {
        "the oracle's Jacobians against differences of its poses": (_oracle, _BY_DIFFERENCES),
        **{
            f"poses and Jacobians of {name} against the oracle": (_of_backend(name), _EXACT)
            for name in _installed_backends()
            if name != "pinocchio"
        },
        "the image Jacobian against differences of images": (_image, _BY_DIFFERENCES),
        "a recording, simulated twice, written and read": (_recording, 0.0),
        "a trigonometric model learns a circle better than a constant one": (_learning, 1.0),
    }
    return [_checked(name, of, limit, body) for name, (of, limit) in each.items()]


def _installed_backends() -> list[str]:
    from bodyimage_kin.backends import backends

    return [name for name, state in backends().items() if state == "installed"]


def _checked(name: str, of: Callable[[Embodiment], float], limit: float, body: Embodiment) -> dict[str, Any]:
    """A check's value and what is wrong with it: whatever goes wrong in one does not keep the others from running."""
    begin, value, error = time.perf_counter(), None, ""
    try:
        value = of(body)
        if not value <= limit:
            error = f"{value:.3g} is more than {limit:g}"
    except Exception as problem:
        error = f"{type(problem).__name__}: {' '.join(str(problem).split())[:300]}"
    return {
        "name": name,
        "value": value,
        "limit": limit,
        "error": error,
        "seconds": round(time.perf_counter() - begin, 2),
    }


def _oracle(body: Embodiment) -> float:
    import torch

    from bodyimage_kin.backends import kinematics

    oracle, link = kinematics(body.robot, "pinocchio"), body.hand.link
    q = body.robot.sample(_POSTURES, seed=0)
    steps = _STEP * torch.eye(body.robot.n, dtype=q.dtype)
    ahead, behind = (oracle.pose(q[:, None] + sign * steps, link)[..., :3, 3] for sign in (1, -1))
    differences = ((ahead - behind) / (2 * _STEP)).mT
    return float((oracle.jacobian(q, link)[:, :3] - differences).abs().max())


def _of_backend(name: str) -> Callable[[Embodiment], float]:
    def difference(body: Embodiment) -> float:
        from bodyimage_kin.backends import kinematics

        q = body.robot.sample(_POSTURES, seed=0)
        pairs = zip(
            kinematics(body.robot, name).pose_and_jacobian(q, body.hand.link),
            kinematics(body.robot, "pinocchio").pose_and_jacobian(q, body.hand.link),
            strict=True,
        )
        return max(float((ours - theirs).abs().max()) for ours, theirs in pairs)

    return difference


def _image(body: Embodiment) -> float:
    import torch

    q = body.touch_postures(range(0, body.skin.count if body.skin else 0, 20), distance=0.03)
    steps = _STEP * torch.eye(body.p, dtype=q.dtype)
    ahead, behind = (body.hand_image(q[:, None] + sign * steps) for sign in (1, -1))
    return float((body.hand_image_jacobian(q) - ((ahead - behind) / (2 * _STEP)).mT).abs().max())


def _circle() -> Any:
    from bodyimage_kin.body.file import load_embodiment
    from bodyimage_kin.recordings import motions, simulate

    return simulate(load_embodiment("infant"), motions.Circle(turns=0.5), dynamics=False)


def _recording(body: Embodiment) -> float:
    from bodyimage_kin.recordings import read_recording, write_recording

    one = _circle()
    with tempfile.TemporaryDirectory() as folder:
        write_recording(_circle(), Path(folder) / "circle.nc")
        same = read_recording(Path(folder) / "circle.nc").identical(one)
    return 0.0 if same else float("nan")


def _learning(body: Embodiment) -> float:
    """Error of the model of posture over that of the constant Jacobian, where both were learned."""
    from bodyimage_kin import estimators, metrics
    from bodyimage_kin.recordings import experience

    seen = experience(_circle())
    q = metrics.probes.probe_postures(metrics.probes.Training(), body, seen)
    truth = body.hand_image_jacobian(q)
    learners: Mapping[str, Any] = {"model": estimators.TrigRidge(), "constant": estimators.LeastSquares()}
    errors = {
        name: float(
            metrics.pooled_relative_error(truth, learner.fit(seen).jacobian(q), metric=metrics.motion_metric(seen))
        )
        for name, learner in learners.items()
    }
    return errors["model"] / errors["constant"]
