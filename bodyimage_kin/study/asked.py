"""What a study is given, object, name or table, as the tables that it keeps: checked, every default written out."""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import xarray as xr

from bodyimage_kin._checks import flag, refuse, text, whole
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.file import embodiments as known_embodiments
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.body_image import BodyImage
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, InvalidRecording, UnknownName
from bodyimage_kin.recordings import Drag, Noise, motions, read_recording
from bodyimage_kin.study import specs
from bodyimage_kin.study.grid import Row, Simulation, row_of
from bodyimage_kin.study.scoring import PROBES, built_probe, probe_name, resolve, written_score
from bodyimage_kin.study.specs import ESTIMATOR, MOTION, PROBE, Table
from bodyimage_kin.study.store import body_files, fingerprint

__all__ = [
    "Reader",
    "first_maps_of",
    "labels_of",
    "map_settings_of",
    "named",
    "named_bodies",
    "probe_key",
    "refuse_deep",
    "refuse_infinite",
    "row_name",
    "seeds_of",
]

_TOUCH_DURATION = 80.0
"""Time of touching [s]; by then the motion's metric has settled to a few per cent. Maps take ten times as long."""
_SHARED = ("speed", "sampling", "rest_spread", "rest_pull")
"""Settings that touch and tour take over from the motion learned from, where a study says nothing of them."""
_MOST_SEEDS = 10**6
_DEEPEST = 20
"""Tables within tables: no spec of ours comes near it."""
_A_BODY = "a name, the path of a TOML file, or {embodiment, backend, mesh_folder}"
_GIVEN_BY_US = ("exp", "hand", "trial", "skin", "seed", "image_range", "posture_som", "initial_map")
"""Parameters of :meth:`BodyImage.learn` that no row sets."""


@dataclass(frozen=True, eq=False)
class Reader:
    """Turns what a study is given into tables.

    Attributes:
        folder: Where relative paths begin, and where modules may lie.
        seeds: Of the study.
        use: Motion of the touches of recordings that say nothing of it; None: :class:`Simulation` says.
        given: Takes up recordings and embodiments that were handed over, by hash.
    """

    folder: Path
    seeds: tuple[int, ...]
    use: Any = None
    given: dict[str, Any] = field(default_factory=dict)

    def names(self, what: str, given: Any, otherwise: Sequence[str]) -> tuple[str, ...]:
        """Scores or facts as they are written, each once."""
        if given is None:
            return tuple(otherwise)
        if isinstance(given, str | Mapping) or not isinstance(given, Sequence):
            refuse(what, given, "a list of names")
        if what == "scores" and not given:
            refuse(what, given, "at least one name")
        return tuple(dict.fromkeys(written_score(one, self.folder) for one in given))

    def body(self, spec: Any) -> Table:
        """``{"embodiment": NAME or PATH}``, with ``backend``, ``mesh_folder`` where they are chosen; empty: unknown."""
        if spec is None:
            return {}
        if isinstance(spec, Embodiment):
            backend = {"backend": spec.kinematics.name}
            own = _ours(spec.name)
            if own is not None and own.sha256 == spec.sha256:
                return {"embodiment": spec.name} | (backend if own.kinematics.name != spec.kinematics.name else {})
            body_files(spec)
            self.given[spec.sha256] = spec
            return {"given": spec.sha256, **backend}
        table = {"embodiment": spec} if isinstance(spec, str | Path) else spec
        if not isinstance(table, Mapping):
            refuse("embodiment", spec, f"an embodiment, {_A_BODY}")
        specs.refuse_unknown("setting of embodiment", table, ("embodiment", "backend", "given", "mesh_folder"))
        found = {key: str(value) if isinstance(value, Path) else value for key, value in table.items()}
        if not all(isinstance(value, str) for value in found.values()) or (
            found and len(found.keys() - {"backend", "mesh_folder"}) != 1
        ):
            refuse("embodiment", spec, _A_BODY)
        if "mesh_folder" in found and "embodiment" not in found:
            raise InvalidConfig("embodiment: mesh_folder is of a body that is loaded by name or path; say which")
        return found

    def recording(self, name: str, spec: Any) -> Table:
        """Settings of a :class:`Simulation`, every one written out, recordings as their hashes."""
        what = f"recording '{name}'"
        if isinstance(spec, Mapping) and "training" in spec:
            specs.refuse_unknown(f"setting of {what}", spec, [one.name for one in dataclasses.fields(Simulation)])
            parts = dict(spec)
        elif isinstance(spec, Simulation):
            parts = dict(vars(spec))
        else:
            parts = {"training": spec}
        training = self._role(f"{what}: training", parts["training"], several=True)
        simulated = isinstance(training, list) or "recording" not in training
        first = (training[0] if isinstance(training, list) else training) if simulated else None
        found: Table = {"training": training}
        for role, given in (("use", parts.get("use")), ("tour", parts.get("tour"))):
            given = self.use if given is None and role == "use" else given
            if given is None and first is not None:
                shared = {key: value for key, value in next(iter(first.values())).items() if key in _SHARED}
                given = (
                    motions.RandomTouch(duration=_TOUCH_DURATION, **shared)
                    if role == "use"
                    else motions.FaceTour(**shared)
                )
            if given is not None:
                nothing = isinstance(given, str) and given == "none"
                found[role] = given if nothing else self._role(f"{what}: {role}", given)
        dynamics = parts.get("dynamics", True)
        dynamics = (
            dynamics
            if dynamics is False
            else specs.from_settings(Drag, {} if dynamics is True else dynamics, what=f"{what}: dynamics")
        )
        noise = specs.from_settings(Noise, parts.get("noise") or {}, what=f"{what}: noise")
        if noise.torque and dynamics is False:
            raise InvalidConfig(
                f"{what}: noise: torque={noise.torque:g} disturbs an arm that is dragged; use dynamics=true"
            )
        written = False if dynamics is False else specs.settings_of(dynamics)
        found |= {"dynamics": written, "noise": specs.settings_of(noise)}
        touch_seen = flag(f"{what}: touch_seen", parts.get("touch_seen", True))
        checked = Simulation(None, dynamics=dynamics, noise=noise, stream=parts.get("stream", ""))
        use = found.get("use")
        if first is not None and isinstance(use, Mapping) and "recording" not in use:
            ours, theirs = (next(iter(one.values())).get("sampling") for one in (first, use))
            if ours != theirs:
                raise InvalidConfig(
                    f"{what}: use: sampling must be that of the training, {ours}; or displacements differ"
                )
        # Written where it says something alone: a study that says nothing of it is what it was.
        blind = {} if touch_seen else {"touch_seen": False}
        return found | ({"stream": checked.stream} if checked.stream else {}) | blind

    def _role(self, what: str, given: Any, several: bool = False) -> Any:
        """A motion's table, a list of them, or ``{"recording": hash, or one a seed}``."""
        if isinstance(given, Mapping) and list(given) == ["recording"]:
            given = given["recording"]
            if isinstance(given, str | list) and all(
                _is_hash(one) for one in ([given] if isinstance(given, str) else given)
            ):
                return {"recording": given}
        many = list(given) if isinstance(given, list | tuple) else [given]
        if not many:
            refuse(what, given, "a motion or a recording")
        if all(isinstance(one, xr.Dataset) or _is_path(one) for one in many):
            hashes = [self._keep(one) for one in many]
            if len(hashes) not in (1, len(self.seeds)):
                raise InvalidConfig(f"{what}: {len(hashes)} recordings for {len(self.seeds)} seeds; give one a seed")
            return {"recording": hashes if len(hashes) > 1 else hashes[0]}
        if len(many) > 1 and not several:
            refuse(what, given, "one motion, or recordings")
        tables = [MOTION.table(one, self.folder) for one in many]
        return tables if len(tables) > 1 else tables[0]

    def _keep(self, given: xr.Dataset | str | Path) -> str:
        try:
            recording = given if isinstance(given, xr.Dataset) else read_recording(self.folder / given)
        except InvalidRecording as problem:
            raise InvalidConfig(str(problem)) from None
        sha256 = fingerprint(recording)
        self.given[sha256] = recording
        return sha256

    def row(self, spec: Any) -> Table:
        """An estimator's table; of a row that says more, ``{"estimator": table, ...}`` with what differs."""
        if isinstance(spec, Mapping) and "estimator" in spec:
            specs.refuse_unknown("setting of a row", spec, [one.name for one in dataclasses.fields(Row)])
            row = row_of(spec, self.folder)
        else:
            row = spec if isinstance(spec, Row) else Row(spec)
        estimator = None if row.estimator is None else ESTIMATOR.table(row.estimator, self.folder)
        usual = specs.settings_of(Row())
        others = {key: value for key, value in specs.settings_of(row).items() if key != "estimator"}
        others = {key: value for key, value in others.items() if value != usual.get(key)}
        if "first_maps" in others:
            others["first_maps"] = first_maps_of(row.first_maps)
        if "maps" in others:
            others["maps"] = map_settings_of(row.maps)
        for setting, fact in row.told.items():
            resolve(fact, self.folder)
            self._check_told(row.estimator, setting)
        return estimator if estimator is not None and not others else {"estimator": estimator or "none", **others}

    def _check_told(self, estimator: Any, setting: str) -> None:
        name, _ = ESTIMATOR.parts(ESTIMATOR.table(estimator, self.folder))
        known = inspect.signature(ESTIMATOR.find(name, self.folder)).parameters
        if setting not in known:
            raise InvalidConfig(str(UnknownName(f"setting of estimator {name} to be told", setting, known)))

    def probe(self, spec: Any) -> Table:
        """A probe's table."""
        return PROBE.table(built_probe(spec, self.folder), self.folder)


def seeds_of(given: Any) -> tuple[int, ...]:
    """The seeds of a study: those in a list, or as many as a number says."""
    if isinstance(given, Sequence) and not isinstance(given, str):
        found = tuple(whole("seeds", one, least=0) for one in given)
        if not found or len(set(found)) != len(found):
            refuse("seeds", given, "whole numbers of at least 0, none twice")
        return found
    return tuple(range(whole("seeds", given, least=1, most=_MOST_SEEDS)))


def first_maps_of(given: Any) -> Any:
    """The number of first maps, or seed (as text) -> number."""
    if isinstance(given, Mapping):
        return {str(seed): whole(f"first_maps.{seed}", count, least=1) for seed, count in given.items()}
    return whole("first_maps", given, least=1)


def map_settings_of(given: Any) -> Table:
    """Settings of maps, known to be such."""
    if not isinstance(given, Mapping):
        refuse("maps", given, "a table of settings")
    known = [name for name in inspect.signature(BodyImage.learn).parameters if name not in _GIVEN_BY_US]
    specs.refuse_unknown("setting of maps", given, known)
    return {name: specs.written(f"maps: {name}", value) for name, value in given.items()}


def labels_of(given: Any) -> dict[str, str]:
    """Labels by name, known to be text."""
    if not isinstance(given, Mapping | None):
        refuse("labels", given, "a table, NAME -> label")
    return {text("labels", name): text(f"labels.{name}", label) for name, label in (given or {}).items()}


def named(what: str, given: Any, name: Callable[[Any], str] | None = None) -> dict[str, Any]:
    """Name -> spec, of a list by names of their own."""
    if isinstance(given, list | tuple) and name is not None and given:
        found: dict[str, Any] = {}
        for spec in given:
            own = name(spec)
            found[own if own not in found else f"{own}_{len(found)}"] = spec
        given = found
    if not isinstance(given, Mapping) or not given:
        raise InvalidConfig(f"{what}: give at least one, NAME -> spec")
    return {specs.plain_name(what.removesuffix("s"), key): spec for key, spec in given.items()}


def named_bodies(given: Any) -> dict[str, Any]:
    """Name -> embodiment, of a single one by its own name."""
    if isinstance(given, Mapping):
        return named("embodiments", given)
    if isinstance(given, Embodiment):
        return named("embodiments", {re.sub(r"[^\w.-]", "_", given.name): given})
    if given is None:
        return {"unknown": None}
    if not isinstance(given, str | Path):
        refuse("embodiments", given, "an embodiment, its name, the path of a TOML file, or NAME -> such")
    return named("embodiments", {Path(given).stem: given})


def row_name(spec: Any) -> str:
    """What results call a row that was given without a name: its estimator's class."""
    estimator = spec.estimator if isinstance(spec, Row) else spec
    if estimator is None:
        return "direct"
    if isinstance(estimator, str | type | Mapping):
        return specs.snake(ESTIMATOR.parts(estimator)[0].rpartition(":")[2].rpartition(".")[2])
    return specs.snake(type(estimator).__name__)


def probe_key(spec: Any) -> str:
    """What results call a probe that was given without a name."""
    return spec if isinstance(spec, str) and spec in PROBES else probe_name(built_probe(spec))


def refuse_deep(what: str, value: Any, depth: int = 0) -> None:
    """Raises InvalidConfig for tables within tables beyond any sense."""
    if depth > _DEEPEST:
        raise InvalidConfig(f"{what}: more than {_DEEPEST} tables within each other; no setting lies so deep")
    for item in value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ():
        refuse_deep(what, item, depth + 1)


def refuse_infinite(what: str, value: Any) -> None:
    """Raises InvalidConfig for a number that is infinite or NaN, which neither TOML nor a result can keep apart."""
    if isinstance(value, float) and not math.isfinite(value):
        raise InvalidConfig(f"{what}={value!r}: give a finite number")
    for item in value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ():
        refuse_infinite(what, item)


def _is_path(given: Any) -> bool:
    return isinstance(given, Path) or (isinstance(given, str) and given.endswith(".nc"))


def _is_hash(given: Any) -> bool:
    return isinstance(given, str) and re.fullmatch(r"[0-9a-f]{64}", given) is not None


def _ours(name: str) -> Embodiment | None:
    """The embodiment of that name that comes with the package; None where there is none, or its robot is not here."""
    if name not in known_embodiments():
        return None
    try:
        return load_embodiment(name)
    except BodyImageKinError:
        return None
