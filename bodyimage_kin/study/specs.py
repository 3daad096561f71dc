"""How specs are written down: frozen dataclasses as tables, the same in TOML, in results and on the wire.

A table holds strings, numbers, booleans, lists and tables only. A spec is ``{CLASS: settings}``, the class one of ours
by name or ``"package.module:Class"``; where a field can only be of one dataclass its settings stand alone. Every
setting that has a default is written out, so that a result says all of how it came about.

Only a module that a spec names is imported, from where Python looks, from beside the study's file, or from the current
folder. What is named must be of the kind that is wanted before anything is built from it.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import re
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from bodyimage_kin import estimators
from bodyimage_kin._checks import refuse
from bodyimage_kin._named import named_class, named_object
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, UnknownName
from bodyimage_kin.metrics import probes
from bodyimage_kin.recordings import motions

__all__ = [
    "ESTIMATOR",
    "MOTION",
    "PROBE",
    "Kind",
    "Table",
    "arguments",
    "class_name",
    "from_settings",
    "other_bodies",
    "plain_name",
    "refuse_unknown",
    "settings_of",
    "snake",
    "written",
]

Table: TypeAlias = dict[str, Any]
"""Text -> what TOML can say."""
_NONE = "none"
"""How a table says None where that is not the default, as in ``reset_interval = "none"``."""
_LONGEST = 200


@dataclass(frozen=True)
class Kind:
    """One kind of spec: what may be named where it is wanted, and what a named class must be.

    Attributes:
        name: Of the kind, in errors.
        classes: Ours, by name.
        method: What every class of the kind has, ours or not.
        wanted: What such a thing is, in words.
        base: What it must be a subclass of; None: the method is enough.
    """

    name: str
    classes: Mapping[str, type]
    method: str
    wanted: str
    base: type = object

    def fits(self, found: Any) -> bool:
        """Whether this is a class of the kind."""
        return isinstance(found, type) and issubclass(found, self.base) and callable(getattr(found, self.method, None))

    def build(self, spec: Any, folder: Path = Path(), body: Any = None, told: Mapping[str, Any] | None = None) -> Any:
        """The object that is meant.

        Args:
            spec: The object itself, its class, a name, or ``{NAME: settings}``.
            folder: Where a module, or a file of an embodiment, may lie beside where Python looks.
            body: The embodiment, for a class that has a setting ``body`` of which nothing is said.
            told: Settings that stand in no table.

        Raises:
            InvalidConfig: Another kind of thing, or settings that its class refuses.
            UnknownName: No such class or setting.
        """
        if not isinstance(spec, str | type | Mapping):
            return self._checked(spec)
        name, settings = self.parts(spec)
        cls = self.find(name, folder)
        what = f"{self.name} {_short(name)}"
        named, settings = _named_body(what, cls, settings, folder)
        values = arguments(what, cls, settings, folder, body) | dict(told or {})
        if "body" in _parameters(cls):
            values["body"] = body if named is None else load_embodiment(named)
        return self._checked(_made(what, cls, values))

    def table(self, spec: Any, folder: Path = Path()) -> Table:
        """``{NAME: settings}``, every setting written out; of a class that wants the embodiment, all but that.

        Raises:
            InvalidConfig: As :meth:`build`, or a class or a setting that cannot be written down.
            UnknownName: As :meth:`build`.
        """
        if not isinstance(spec, str | type | Mapping):
            return written(f"{self.name} {type(spec).__name__}", self._checked(spec))
        name, settings = self.parts(spec)
        cls = self.find(name, folder)
        what = f"{self.name} {_short(name)}"
        if not dataclasses.is_dataclass(cls):
            arguments(what, cls, settings, folder, None)
            return {name: {key: written(f"{what}: {key}", value) for key, value in settings.items()}}
        if not self.wants_body(spec, folder):
            return {name: settings_of(self.build(spec, folder))}
        # It cannot be built before there is a body, so the values of its settings are checked when there is one.
        built = arguments(what, cls, _named_body(what, cls, settings, folder)[1], folder, None)
        # What is within and wants a body came back as a table, every setting written out.
        settings |= {name: value for name, value in built.items() if isinstance(value, dict)}
        given = {f.name: f.default for f in dataclasses.fields(cls) if f.default is not dataclasses.MISSING} | settings
        return {name: {key: written(f"{what}: {key}", value) for key, value in given.items() if value is not None}}

    def parts(self, spec: Any) -> tuple[str, Table]:
        """Name and settings of a spec that is written down, or of a class."""
        if isinstance(spec, type):
            return class_name(spec), {}
        if isinstance(spec, str):
            return spec, {}
        if not isinstance(spec, Mapping) or len(spec) != 1:
            refuse(
                self.name, spec, f"a name, or one name with its settings, such as {{{next(iter(self.classes))}: {{}}}}"
            )
        name, settings = next(iter(spec.items()))
        if not isinstance(settings, Mapping):
            refuse(f"{self.name} {_short(str(name))}", settings, "a table of settings")
        return str(name), dict(settings)

    def find(self, name: str, folder: Path = Path()) -> type:
        """The class of that name, known to be of this kind; nothing is built.

        Raises:
            UnknownName: None of ours, and no ``package.module:Class``.
            InvalidConfig: What cannot be imported, or is something else.
        """
        if ":" not in name:
            if name not in self.classes:
                raise UnknownName(self.name, _short(name), (*self.classes, "package.module:Class"))
            return self.classes[name]
        if len(name) > _LONGEST:
            raise InvalidConfig(f"{self.name} {_short(name)!r}: a name has at most {_LONGEST} characters")
        found = named_class(self.name, name, (self.method,), folder)
        if not issubclass(found, self.base):
            raise InvalidConfig(f"{self.name} {name!r} is none: give {self.wanted}")
        return found

    def wants_body(self, spec: Any, folder: Path = Path()) -> bool:
        """Whether an estimator, or one within it, is to be given the embodiment."""
        if isinstance(spec, str | type):
            return "body" in _parameters(self.find(spec if isinstance(spec, str) else class_name(spec), folder))
        return self._within_wants_body(spec, folder)

    def _within_wants_body(self, spec: Any, folder: Path) -> bool:
        """Likewise, of any setting: text in it is no name."""
        if dataclasses.is_dataclass(spec) and not isinstance(spec, type):
            return hasattr(spec, "body") or any(self._within_wants_body(item, folder) for item in vars(spec).values())
        if isinstance(spec, list | tuple):
            return any(self._within_wants_body(item, folder) for item in spec)
        if not isinstance(spec, Mapping):
            return False
        classes = [self.find(name, folder) for name in spec if isinstance(name, str) and self._names(name)]
        return any("body" in _parameters(cls) for cls in classes) or any(
            self._within_wants_body(item, folder) for item in spec.values()
        )

    def _names(self, name: str) -> bool:
        return name in self.classes or re.fullmatch(r"[\w.]+:[\w.]+", name) is not None

    def _checked(self, found: Any) -> Any:
        # An object of anybody's that has the method is as good as one of the class.
        if (
            isinstance(found, type)
            or not callable(getattr(found, self.method, None))
            or not isinstance(found, self.base)
        ):
            raise InvalidConfig(f"{self.name} {type(found).__name__} is none: give {self.wanted}")
        return found


def _named(module: Any, base: type) -> dict[str, type]:
    """The classes of a module that are of this base and not abstract."""
    found = {name: getattr(module, name) for name in module.__all__}
    return {
        name: one
        for name, one in found.items()
        if isinstance(one, type) and issubclass(one, base) and not inspect.isabstract(one)
    }


ESTIMATOR = Kind(
    "estimator",
    {name: getattr(estimators, name) for name in estimators.names()},
    "fit",
    "something with a method fit(experience, seed)",
)
MOTION = Kind("motion", _named(motions, motions.Motion), "path", "a subclass of bk.motions.Motion", motions.Motion)
PROBE = Kind("probe", _named(probes, probes.Probe), "postures", "something with a method postures(body, seen)")
_KINDS = (ESTIMATOR, MOTION, PROBE)


def plain_name(kind: str, name: object) -> str:
    """The name itself, once it is known to be fit for a file and for a result.

    Raises:
        InvalidConfig: Other characters than letters, digits, ``_``, ``-`` and ``.``; or more than 100 of them.
    """
    if not isinstance(name, str) or not re.fullmatch(r"\w[\w.-]{0,99}", name, re.ASCII):
        raise InvalidConfig(f"{kind} name {_short(name)!r}: use letters, digits, '_', '-' and '.', at most 100")
    return name


def snake(name: str) -> str:
    """A class's name as results say it: ``PaperMLP`` is ``paper_mlp``."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


def class_name(cls: type) -> str:
    """How a class is written: ours by name, any other as ``package.module:Class``.

    Raises:
        InvalidConfig: One that workers cannot find.
    """
    for kind in _KINDS:
        if kind.classes.get(cls.__name__) is cls:
            return cls.__name__
    if cls.__module__ == "__main__" or "<locals>" in cls.__qualname__:
        raise InvalidConfig(
            f"{cls.__name__} cannot be found by workers; define it at the top of a module they can import"
        )
    return f"{cls.__module__}:{cls.__qualname__}"


def written(what: str, value: Any) -> Any:
    """A value as TOML can say it: tuples as lists, specs as ``{CLASS: settings}``, None left out by its owner.

    Args:
        what: Its name in errors.
        value: Anything that a spec holds.

    Raises:
        InvalidConfig: Something that has no place in a file; names it.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, list | tuple):
        return [written(what, item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): written(what, item) for key, item in value.items() if item is not None}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {class_name(type(value)): settings_of(value)}
    if isinstance(value, Path):
        return str(value)
    raise InvalidConfig(f"{what} is {type(value).__name__}, which cannot be written into a study's file")


def settings_of(spec: Any) -> Table:
    """Fields of a dataclass as a table; None where it is the default, and the embodiment, are left out.

    A study refuses an object that was built with another embodiment than it studies.

    Raises:
        InvalidConfig: As :func:`written`.
    """
    found: Table = {}
    cls: Any = type(spec)
    hints = _hints(cls)
    for field in dataclasses.fields(spec):
        value = getattr(spec, field.name)
        if not field.init or field.name == "body" or (value is None and field.default is None):
            continue
        what = f"{type(spec).__name__}.{field.name}"
        options = _options(hints.get(field.name))
        if value is None:
            if str in options:
                raise InvalidConfig(f"{what}=None cannot be written into a study's file")
            found[field.name] = _NONE
        elif _only_dataclass(options) is type(value):
            found[field.name] = settings_of(value)
        else:
            found[field.name] = written(what, value)
    return found


def from_settings(cls: type, settings: Any, folder: Path = Path(), what: str = "") -> Any:
    """A dataclass from the table of its fields.

    Raises:
        InvalidConfig: No table, an unknown field, or values that the class refuses.
        UnknownName: A class within it that there is not.
    """
    what = what or snake(cls.__name__)
    if isinstance(settings, cls):
        return settings
    if not isinstance(settings, Mapping):
        refuse(what, settings, f"a table of settings of {cls.__name__}")
    return _made(what, cls, arguments(what, cls, settings, folder, None))


def arguments(what: str, cls: type, settings: Mapping[str, Any], folder: Path = Path(), body: Any = None) -> Table:
    """Settings as a class wants them: what is within them built, lists as tuples.

    Raises:
        InvalidConfig: One that it does not have.
    """
    known = _parameters(cls)
    if not any(one.kind is inspect.Parameter.VAR_KEYWORD for one in known.values()):
        refuse_unknown(f"setting of {what}", settings, [name for name in known if name != "body"])
    hints = _hints(cls)
    return {name: _built(f"{what}: {name}", value, hints.get(name), folder, body) for name, value in settings.items()}


def refuse_unknown(what: str, table: Mapping[str, Any], known: Any) -> None:
    """Raises InvalidConfig unless each key is known; a guess stands beside the first that is not."""
    for name in table:
        if name not in tuple(known):
            raise InvalidConfig(str(UnknownName(what, _short(name), known)))


def other_bodies(spec: Any) -> Iterator[Embodiment]:
    """The embodiments that an object was built with, and those of objects within it."""
    if isinstance(spec, list | tuple):
        for item in spec:
            yield from other_bodies(item)
    elif dataclasses.is_dataclass(spec) and not isinstance(spec, type | Embodiment):
        body = getattr(spec, "body", None)
        if isinstance(body, Embodiment):
            yield body
        yield from other_bodies([value for name, value in vars(spec).items() if name != "body"])


# Inner ---------------------------------------------------------------------------------------------------------------


def _named_body(
    what: str, cls: type, settings: Mapping[str, Any], folder: Path
) -> tuple[str | Path | None, dict[str, Any]]:
    """Name or place of the embodiment that a table names as its ``body``, None where it says nothing, and the rest."""
    rest = dict(settings)
    if "body" not in rest or "body" not in _parameters(cls):
        return None, rest
    name = rest.pop("body")
    if not isinstance(name, str):
        refuse(f"{what}: body", name, "the name of an embodiment, or the path of its TOML file")
    return (folder / name if name.endswith(".toml") else name), rest


def _short(value: Any) -> str:
    """Text of one line, cut to a length that an error can show."""
    said = " ".join(str(value).split())
    return said if len(said) <= 120 else said[:117] + "..."


def _made(what: str, cls: type, values: Table) -> Any:
    try:
        return cls(**values)
    except BodyImageKinError as problem:
        said = str(problem)
        raise InvalidConfig(said if said.startswith(what) else f"{what}: {said}") from None
    except Exception as problem:
        raise InvalidConfig(f"{what}: {_short(problem) or type(problem).__name__}") from None


def _built(what: str, value: Any, hint: Any, folder: Path, body: Any) -> Any:
    options = _options(hint)
    if value is None or (value == _NONE and str not in options and type(None) in options):
        if options and type(None) not in options and Any not in options:
            refuse(what, value, "a value")
        return None
    if isinstance(value, str) and options and set(options) <= {int, float, type(None)}:
        refuse(what, value, "a number")
    if isinstance(value, list | tuple):
        return tuple(_built(what, item, None, folder, body) for item in value)
    if not isinstance(value, Mapping):
        return value
    name = str(next(iter(value), "")) if len(value) == 1 else ""
    if ":" in name or any(name in kind.classes for kind in _KINDS):
        # Of a class that is not ours the kind shows only once it is found.
        for kind in _KINDS:
            if name in kind.classes or (":" in name and kind.fits(named_object("spec", name, folder))):
                # What wants a body cannot be built before there is one; its settings are looked at all the same.
                lacking = body is None and kind.wants_body(value, folder)
                return kind.table(value, folder) if lacking else kind.build(value, folder, body)
        raise InvalidConfig(f"{what}: {_short(name)} is no {', no '.join(kind.name for kind in _KINDS)}")
    if (cls := _only_dataclass(options)) is not None:
        return from_settings(cls, value, folder, what)
    return {str(key): _built(what, item, None, folder, body) for key, item in value.items()}


@functools.cache
def _hints(cls: Any) -> Mapping[str, Any]:
    """Types of a class's fields; none where they cannot be told."""
    try:
        return typing.get_type_hints(cls)
    except Exception:
        return {}


def _options(hint: Any) -> tuple[Any, ...]:
    """What a type hint allows, unions taken apart."""
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return tuple(option for part in typing.get_args(hint) for option in _options(part))
    return () if hint is None else (hint,)


def _only_dataclass(options: tuple[Any, ...]) -> type | None:
    """The one dataclass among them that is a spec without a kind, such as settings of the noise."""
    found = [one for one in options if isinstance(one, type) and dataclasses.is_dataclass(one)]
    found = [one for one in found if not any(hasattr(one, kind.method) for kind in _KINDS)]
    return found[0] if len(found) == 1 else None


@functools.cache
def _parameters(cls: Any) -> Mapping[str, inspect.Parameter]:
    try:
        return inspect.signature(cls).parameters
    except (TypeError, ValueError):
        return {}
