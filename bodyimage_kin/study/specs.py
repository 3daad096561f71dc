"""What a study varies, as plain tables: one written form for every spec, the same in TOML, in results and on the wire.

A table holds strings, numbers, booleans, lists and tables only. Every setting that has a default is written out, so
that a result says all of how it came about.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from bodyimage_kin import estimators
from bodyimage_kin._named import named_class
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.metrics import probes
from bodyimage_kin.recordings import Drag, Noise, motions

Table: TypeAlias = dict[str, Any]
"""Text -> what TOML can say."""

MOTIONS: Mapping[str, type[motions.Motion]] = {
    "circle": motions.Circle,
    "face_tour": motions.FaceTour,
    "random_touch": motions.RandomTouch,
}
"""What can be recorded, by name."""
_BESIDE: Table = {"trials": 1, "dynamics": True, "encoder_noise": 0.0, "image_noise": 0.0, "drag": None}
"""Settings that a motion's table has beside the motion's own."""
_DRAG: Table = dataclasses.asdict(Drag()) | {"torque_variance": 0.0, "torque_hold": Noise().torque_hold}
_SHARED = ("dynamics", "drag", "encoder_noise", "image_noise", "sampling", "rest_spread", "rest_pull", "speed")
"""Settings that tour and touch take over from the motion that is learned from."""
_TOUCH_DURATION = 80.0
"""Time of touching [s]; by then the motion's metric has settled to a few per cent. Maps take ten times as long."""
_NONE = "none"
"""How a table says None where that is not what a motion does by default, as in ``reset_interval = "none"``."""
PROBES: Mapping[str, Table] = {
    "on_circle": {"training": {}},
    "in_front": {"face": {"distance": 0.03}},
    "on_face": {"face": {"distance": 0.0}},
    "joint_space": {"joint_space": {"count": 441, "seed": 0}},
}
"""Posture sets that leave what was seen step by step."""
_PROBE_SETTINGS: Mapping[str, Table] = {
    "training": {},
    "face": {"distance": 0.0},
    "joint_space": {"count": 441, "seed": 0},
}


def plain_name(kind: str, name: object) -> str:
    """The name itself, once it is known to be fit for a file and for a result.

    Raises:
        InvalidConfig: Other characters than letters, digits, ``_``, ``-`` and ``.``.
    """
    if not isinstance(name, str) or not re.fullmatch(r"\w[\w.-]*", name, re.ASCII):
        raise InvalidConfig(f"{kind} name {name!r}: use letters, digits, '_', '-' and '.'")
    return name


def embodiment_table(spec: Any) -> Table:
    """``{"embodiment": NAME or PATH}``, with ``backend`` where one is chosen."""
    table = {"embodiment": spec} if isinstance(spec, str) else dict(_table("embodiment", spec))
    _refuse_unknown("embodiment", table, ("embodiment", "backend"))
    if not all(isinstance(value, str) for value in table.values()) or "embodiment" not in table:
        raise InvalidConfig(f"embodiment {spec!r}: give a name, the path of a TOML file, or {{embodiment, backend}}")
    return table


def recording_table(spec: Any) -> Table:
    """``{MOTION: settings, "touch": settings, "tour": settings}``, every setting written out.

    The first is what is learned from. ``touch`` (``RandomTouch``, here 80 s by default) is where the motion's metric is
    taken from and maps are learned, ``tour`` (``FaceTour``) where displacements are compared; both take over dynamics,
    noise and sampling of the motion learned from unless they say otherwise. Maps to be published need
    ``touch.duration = 800.0``. TOML has no None: ``touch.reset_interval = "none"`` says that the hand never returns.
    """
    given = {spec: {}} if isinstance(spec, str) else _table("recording", spec)
    _refuse_unknown("recording", given, (*MOTIONS, "touch", "tour"))
    learned = [name for name in given if name in MOTIONS]
    if len(learned) != 1:
        raise InvalidConfig(f"a recording is learned from one motion, not {learned}; name one of {', '.join(MOTIONS)}")
    settings = _motion_settings(learned[0], given[learned[0]], {})
    shared = {name: settings[name] for name in _SHARED if name in settings}
    touch = {**shared, "duration": _TOUCH_DURATION}
    table = {
        learned[0]: settings,
        "touch": _motion_settings("random_touch", given.get("touch", {}), touch),
        "tour": _motion_settings("face_tour", given.get("tour", {}), shared),
    }
    if table["touch"]["sampling"] != settings["sampling"]:
        raise InvalidConfig("touch: sampling must be that of the motion learned from, or their displacements differ")
    return table


def motion_arguments(kind: str, settings: Table) -> dict[str, Any]:
    """A motion and its settings as keywords of :func:`bodyimage_kin.simulate`."""
    own: Table = {name: None if value == _NONE else value for name, value in settings.items() if name not in _BESIDE}
    drag = dict(settings.get("drag", {}))
    variance, hold = drag.pop("torque_variance", 0.0), drag.pop("torque_hold", Noise().torque_hold)
    return {
        "motion": MOTIONS[kind](**own),
        "trials": settings["trials"],
        "dynamics": Drag(**drag) if settings["dynamics"] else False,
        "noise": Noise(math.sqrt(variance), settings["encoder_noise"], settings["image_noise"], hold),
    }


def build_probe(table: Table) -> probes.Probe:
    """The probe that a table describes.

    Raises:
        InvalidConfig: A setting out of its range.
    """
    ((kind, settings),) = table.items()
    classes: dict[str, Callable[..., probes.Probe]] = {
        "training": probes.Training,
        "face": probes.Face,
        "joint_space": probes.JointSpace,
    }
    try:
        return classes[kind](**settings)
    except InvalidConfig as problem:
        raise InvalidConfig(f"probe {kind}: {problem}") from None


def probe_table(spec: Any) -> Table:
    """``{KIND: settings}``: ``training`` (its postures), ``face`` (taxels at a distance) or ``joint_space``."""
    if isinstance(spec, str):
        spec = PROBES.get(spec, {spec: {}})
    kind, given = _single("probe", spec)
    if kind not in _PROBE_SETTINGS:
        raise UnknownName("probe", kind, (*_PROBE_SETTINGS, *PROBES))
    settings = _table(f"probe {kind}", given)
    _refuse_unknown(f"probe '{kind}'", settings, _PROBE_SETTINGS[kind])
    settings = {**_PROBE_SETTINGS[kind], **settings}
    build_probe({kind: settings})
    return {kind: settings}


# Estimators ----------------------------------------------------------------------------------------------------------


def estimator_table(spec: Any) -> Table:
    """``{CLASS: settings}``, the class one of ours by name or ``package.module:Class``, every setting written out.

    Args:
        spec: An estimator, the name of a class, or such a table. A setting ``body`` is left out: it is the study's to
            fill in, with the embodiment of each cell.

    Raises:
        InvalidConfig: A class that cannot be named in a file, or settings that it does not take.
        UnknownName: No such class or module.
    """
    if dataclasses.is_dataclass(spec) and not isinstance(spec, type):
        return {_class_name(type(spec)): _fields(spec)}
    if isinstance(spec, type):
        spec = _class_name(spec)
    name, settings = _single("estimator", {spec: {}} if isinstance(spec, str) else spec)
    cls = _class(name)
    settings = _table(f"estimator {name}", settings)
    if not dataclasses.is_dataclass(cls):
        return {name: {key: plain(f"estimator {name}: {key}", value) for key, value in settings.items()}}
    fields = {field.name: field for field in dataclasses.fields(cls) if field.init}
    _refuse_unknown(f"estimator '{name}'", settings, [key for key in fields if key != "body"])
    if wants_body({name: settings}):
        # It cannot be built before there is a body, so its settings are checked when its cells are.
        defaults = {key: field.default for key, field in fields.items() if field.default is not dataclasses.MISSING}
        return {name: _without_none({key: plain(key, value) for key, value in (defaults | settings).items()})}
    return {name: _fields(build_estimator({name: settings}))}


def build_estimator(table: Table, body: Any = None) -> Any:
    """The estimator that a table describes.

    Args:
        table: Of :func:`estimator_table`.
        body: The embodiment, for a class that wants one.

    Raises:
        InvalidConfig: The class refuses its settings, or what it makes cannot fit.
        UnknownName: No such class or module.
    """
    name, settings = _single("estimator", table)
    cls = _class(name)
    arguments = {key: _built(value, body) for key, value in settings.items()}
    try:
        if "body" in _parameters(cls):
            arguments["body"] = body
        estimator = cls(**arguments)
    except (TypeError, ValueError) as problem:
        raise InvalidConfig(f"estimator {name}: {problem}") from None
    if not callable(getattr(estimator, "fit", None)):
        raise InvalidConfig(f"estimator {name} has no fit(experience, seed)")
    return estimator


def _class(name: str) -> type[Any]:
    if ":" not in name:
        if name not in estimators.names():
            raise UnknownName("estimator", name, (*estimators.names(), "package.module:Class"))
        return getattr(estimators, name)
    return named_class("estimator", name, ("fit",))


def wants_body(value: Any) -> bool:
    """Whether a table of an estimator, or of one within it, is to be given the embodiment."""
    if dataclasses.is_dataclass(value):
        return hasattr(value, "body") or any(wants_body(item) for item in vars(value).values())
    if isinstance(value, list | tuple):
        return any(map(wants_body, value))
    if not isinstance(value, Mapping):
        return False
    named = [key for key in value if isinstance(key, str) and (":" in key or key in estimators.names())]
    return any("body" in _parameters(_class(key)) for key in named) or any(map(wants_body, value.values()))


def _parameters(cls: Callable[..., Any]) -> Mapping[str, Any]:
    return inspect.signature(cls).parameters


def _class_name(cls: type) -> str:
    if cls.__name__ in estimators.names() and getattr(estimators, cls.__name__) is cls:
        return cls.__name__
    if cls.__module__ == "__main__" or "<locals>" in cls.__qualname__:
        raise InvalidConfig(
            f"estimator {cls.__name__} cannot be found by workers; define it at the top of a module they can import"
        )
    return f"{cls.__module__}:{cls.__qualname__}"


def _fields(spec: Any) -> Table:
    values = {}
    for field in dataclasses.fields(spec):
        value = getattr(spec, field.name)
        if value is None and field.default is not None:
            raise InvalidConfig(f"{type(spec).__name__}.{field.name}=None cannot be written into a study's file")
        if field.init and field.name != "body":
            values[field.name] = plain(f"{type(spec).__name__}.{field.name}", value)
    return _without_none(values)


def _built(value: Any, body: Any) -> Any:
    """A setting as its class wants it: nested estimators built, lists as tuples (specs are frozen)."""
    if isinstance(value, dict):
        if len(value) == 1 and (":" in (key := next(iter(value))) or key in estimators.names()):
            return build_estimator(value, body)
        return {key: _built(item, body) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return tuple(_built(item, body) for item in value)
    return value


# Tables --------------------------------------------------------------------------------------------------------------


def plain(what: str, value: Any) -> Any:
    """The value as TOML can say it: tuples as lists, estimators and tables of settings as tables.

    Raises:
        InvalidConfig: Something that has no place in a file; names it.
    """
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, list | tuple):
        return [plain(what, item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): plain(what, item) for key, item in value.items()}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {_class_name(type(value)): _fields(value)} if hasattr(value, "fit") else _fields(value)
    raise InvalidConfig(f"{what} is {type(value).__name__}, which cannot be written into a study's file")


def _motion_settings(kind: str, given: Any, instead: Table) -> Table:
    """All settings of a motion: as given, else as ``instead``, else its function's defaults."""
    fields = {field.name: field for field in dataclasses.fields(MOTIONS[kind])}
    defaults = {name: field.default for name, field in fields.items()} | _BESIDE
    known = list(defaults)
    settings = _table(kind, given)
    _refuse_unknown(f"motion '{kind}'", settings, known)
    settings = {name: plain(f"{kind}: {name}", value) for name, value in settings.items()}
    for name, value in settings.items():
        if value in (None, _NONE) and defaults[name] is not None:
            if name not in fields or "None" not in str(fields[name].type):
                raise InvalidConfig(f"{kind}: {name}={value!r}: give a value")
            settings[name] = _NONE
    found = {name: plain(name, default) for name, default in defaults.items()}
    found |= {name: value for name, value in instead.items() if name in known} | settings
    if found["dynamics"]:
        drag = _table("drag", found.get("drag") or {})
        _refuse_unknown("drag", drag, _DRAG)
        found["drag"] = _DRAG | drag
    elif "drag" in settings:
        raise InvalidConfig(f"{kind}: drag: these settings are of the dynamics; use dynamics=True with them")
    else:
        found.pop("drag", None)
    found = _without_none(found)
    motion_arguments(kind, found)
    return found


def _without_none(table: Table) -> Table:
    """TOML has no None; what is left out is None again by default."""
    return {key: value for key, value in table.items() if value is not None}


def _table(what: str, value: Any) -> Table:
    if not isinstance(value, Mapping):
        raise InvalidConfig(f"{what} is {value!r}; give a table of settings")
    return dict(value)


def _single(what: str, spec: Any) -> tuple[str, Any]:
    if not isinstance(spec, Mapping) or len(spec) != 1:
        raise InvalidConfig(f"{what} {spec!r}: give a name, or one name with its settings, {{NAME: {{...}}}}")
    return next(iter(spec.items()))


def _refuse_unknown(what: str, table: Mapping[str, Any], known: Any) -> None:
    for name in table:
        if name not in tuple(known):
            raise InvalidConfig(str(UnknownName(f"setting of {what}", name, known)))
