"""What is learned, as files: frozen dataclasses of tensors, numbers, texts, other such, and tuples of them.

The fields' annotations are the format: jaxtyping's shapes say which tensors belong together, so nothing about a class
is written down twice. Tensors are kept as safetensors, all else as a JSON file that also names the kinds. Loading looks
a kind up among the classes that are there and imports nothing; what a file claims is checked before anything is built.
"""

from __future__ import annotations

import dataclasses
import json
import os
import types
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin._files import atomic_path, write_text
from bodyimage_kin._shown import Shown
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, UnknownName

_FORMAT = {"format": "bodyimage_kin learned Jacobian", "version": 2}
_TENSORS, _DESCRIPTION = "learned.safetensors", "learned.json"
_LONGEST = 1 << 22
"""Bytes of a description, at most."""
_DTYPES = (torch.float64, torch.int64, torch.bool)
_HINTS: dict[type, Mapping[str, Any]] = {}


class Kept(Shown):
    """A frozen dataclass that can be kept in a folder, found again by its ``kind``.

    Subclasses say in ``__post_init__`` what their fields must fulfil beyond their shapes.
    """

    kind: ClassVar[str] = ""
    """Its name in files, unique; empty: it cannot be kept."""
    _kinds: ClassVar[dict[str, type[Kept]]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "kind" in vars(cls):
            Kept._kinds[cls.kind] = cls

    def arrays(self) -> dict[str, Tensor]:
        """Every tensor within, by the path of its field, such as ``members.0.matrix``."""
        return dict(_tensors(self, ""))

    def _size(self, dim: str) -> int:
        """The size of a dimension that the annotation of a field names, here or within."""
        for name, hint in hints(type(self)).items():
            value, named = getattr(self, name), dims(hint) or ()
            if dim in named:
                return int(value.shape[named.index(dim)])
            if isinstance(value, Kept) and any(dim in (dims(inner) or ()) for inner in hints(type(value)).values()):
                return value._size(dim)
        raise TypeError(f"no field of {type(self).__name__} has a dimension '{dim}'; define the property {dim}")


def save(kept: Kept, folder: str | os.PathLike[str]) -> None:
    """Writes ``learned.safetensors`` and ``learned.json`` into a folder, which is made when missing.

    Raises:
        InvalidConfig: It holds something that is no learned number, or values that are not finite.
    """
    description = {**_FORMAT, **_describe(kept, type(kept).__name__)}
    tensors = {path: tensor.detach().contiguous() for path, tensor in kept.arrays().items()}
    for path, tensor in tensors.items():
        _check_values(f"{type(kept).__name__} cannot be saved: {path}", tensor)
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    with atomic_path(place / _TENSORS) as temporary:
        save_file(tensors, str(temporary))
    write_text(place / _DESCRIPTION, json.dumps(description, indent=2) + "\n")


def load(folder: str | os.PathLike[str], wanted: type[Kept]) -> Any:
    """What :func:`save` wrote, an instance of the class that is wanted.

    Raises:
        InvalidConfig: Files that are missing, were not written by it, or lack something.
        UnknownName: A kind that this version does not know.
    """
    place = Path(folder)
    try:
        if (place / _DESCRIPTION).stat().st_size > _LONGEST:
            raise ValueError(f"{_DESCRIPTION} is longer than {_LONGEST} bytes")
        description = json.loads((place / _DESCRIPTION).read_text(encoding="utf-8"))
        tensors = load_file(str(place / _TENSORS))
        form = {field: description.get(field) for field in _FORMAT}
        if form == _FORMAT:
            return _read_kept(wanted, description, tensors, "")
    except UnknownName:
        raise
    except (OSError, ValueError, AttributeError, RecursionError, SafetensorError, BodyImageKinError) as problem:
        said = "its description is too deep" if isinstance(problem, RecursionError) else problem
        raise InvalidConfig(f"'{folder}' holds no learned Jacobian: {said}") from None
    raise InvalidConfig(f"'{folder}' holds no learned Jacobian that this version reads: it is of {form}")


def hints(cls: type) -> Mapping[str, Any]:
    """Field -> its annotation, evaluated; once a class."""
    if cls not in _HINTS:
        found = typing.get_type_hints(cls)
        _HINTS[cls] = {field.name: found[field.name] for field in dataclasses.fields(cls)}
    return _HINTS[cls]


def dims(hint: Any) -> tuple[str, ...] | None:
    """The names of a tensor's dimensions; None for what is no shaped tensor."""
    said = getattr(hint, "dim_str", None)
    return None if said is None else tuple(said.split())


# Inner ---------------------------------------------------------------------------------------------------------------


def _tensors(value: Any, path: str) -> Iterator[tuple[str, Tensor]]:
    if isinstance(value, Tensor):
        yield path, value
    elif isinstance(value, Kept):
        for name in hints(type(value)):
            yield from _tensors(getattr(value, name), _join(path, name))
    elif isinstance(value, tuple):
        for index, item in enumerate(value):
            yield from _tensors(item, _join(path, index))


def _describe(value: Any, path: str) -> Any:
    """The value as JSON can say it; of a tensor, its shape."""
    if isinstance(value, Tensor):
        return list(value.shape)
    if isinstance(value, Kept) and value.kind:
        fields = {name: _describe(getattr(value, name), f"{path}.{name}") for name in hints(type(value))}
        return {"kind": value.kind, **fields}
    if isinstance(value, tuple):
        return [_describe(item, f"{path}.{index}") for index, item in enumerate(value)]
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise InvalidConfig(f"{path} cannot be saved: {type(value).__name__} is no learned number, but known beforehand")


def _read(hint: Any, description: Any, tensors: Mapping[str, Tensor], path: str) -> Any:
    """The value of a field, as its annotation wants it."""
    if hint is Tensor or dims(hint) is not None:
        return _read_tensor(hint, description, tensors, path)
    if isinstance(hint, type) and issubclass(hint, Kept):
        return _read_kept(hint, description, tensors, path)
    if typing.get_origin(hint) is tuple:
        if not isinstance(description, list) or not description:
            _checks.refuse(path, description, "a list that is not empty")
        item, *_ = typing.get_args(hint)
        return tuple(_read(item, one, tensors, _join(path, index)) for index, one in enumerate(description))
    if isinstance(hint, types.UnionType):
        choices = typing.get_args(hint)
        if description is None and type(None) in choices:
            return None
        kinds: dict[Any, Any] = {one.kind: one for one in choices if isinstance(one, type) and issubclass(one, Kept)}
        kind = description.get("kind") if isinstance(description, dict) else None
        return _read(kinds.get(kind, choices[0]) if isinstance(kind, str) else choices[0], description, tensors, path)
    if hint is str:
        if not isinstance(description, str):
            _checks.refuse(path, description, "a text")
        return description
    if hint is bool:
        return _checks.flag(path, description)
    return _checks.whole(path, description) if hint is int else _checks.number(path, description)


def _read_kept(wanted: type[Kept], description: Any, tensors: Mapping[str, Tensor], path: str) -> Any:
    """An object of one of the kinds that are there."""
    if not isinstance(description, dict) or not isinstance(description.get("kind"), str):
        _checks.refuse(path or "description", description, "a table with its kind")
    valid = {kind: cls for kind, cls in Kept._kinds.items() if issubclass(cls, wanted)}
    if description["kind"] not in valid:
        raise UnknownName("kind of learned Jacobian", description["kind"], valid)
    cls = valid[description["kind"]]
    values: dict[str, Any] = {}
    sizes: dict[str, int] = {}
    for name, hint in hints(cls).items():
        if name not in description:
            raise InvalidConfig(f"{_join(path, name)} is missing")
        values[name] = _read(hint, description[name], tensors, _join(path, name))
        for dim, size in zip(dims(hint) or (), getattr(values[name], "shape", ()), strict=True):
            if not dim.isdigit() and sizes.setdefault(dim, size) != size:
                raise InvalidConfig(f"{_join(path, name)} has {size} of '{dim}', others have {sizes[dim]}")
    return cls(**values)


def _read_tensor(hint: Any, description: Any, tensors: Mapping[str, Tensor], path: str) -> Tensor:
    if path not in tensors:
        raise InvalidConfig(f"the array '{path}' is missing")
    tensor = tensors[path]
    if description != list(tensor.shape):
        _checks.refuse(path, description, f"the array's shape, {list(tensor.shape)}")
    wanted = dims(hint)
    fits = wanted is None or (
        len(wanted) == tensor.ndim
        and all(not dim.isdigit() or int(dim) == size for dim, size in zip(wanted, tensor.shape, strict=True))
    )
    if not fits:
        raise InvalidConfig(f"{path} has shape {tuple(tensor.shape)}; it must be ({', '.join(wanted or ())})")
    kinds = getattr(hint, "dtypes", ("float64",))
    valid = [dtype for dtype in _DTYPES if str(dtype).removeprefix("torch.") in kinds]
    if tensor.dtype not in valid:
        raise InvalidConfig(f"{path} holds {tensor.dtype}; it must hold {' or '.join(map(str, valid))}")
    _check_values(path, tensor)
    return tensor


def _check_values(what: str, tensor: Tensor) -> None:
    """Raises InvalidConfig for an array that is empty or not finite."""
    if tensor.numel() == 0:
        raise InvalidConfig(f"{what} is empty, of shape {tuple(tensor.shape)}")
    if not bool(tensor.isfinite().all()):
        raise InvalidConfig(f"{what} has values that are not finite")


def _join(path: str, name: str | int) -> str:
    return f"{path}.{name}" if path else str(name)
