"""Functions compiled by numba: how they are compiled, what the user is told, and many of them at work at once."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import torch
from numba import config, njit
from numba.core import event

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Given = TypeVar("_Given")
_Result = TypeVar("_Result")


def compiles() -> bool:
    """Whether numba may compile here (``NUMBA_DISABLE_JIT`` is not set)."""
    return not getattr(config, "DISABLE_JIT", False)


def compiled(function: _Function) -> _Function:
    """The function, to be compiled at its first call; from numba's disk cache where there is one.

    The disk cache notices changes of the function's own file only, so a compiled function reads nothing from another.
    """
    # Contraction to fused multiply-add rounds less often; nothing is reassociated.
    options: dict[str, Any] = {"nogil": True, "fastmath": {"contract"}, "error_model": "numpy"}
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:  # numba finds no folder that it may write to
        return njit(**options)(function)


def in_threads(work: Callable[[_Given], _Result], items: Sequence[_Given]) -> Iterator[_Result]:
    """Results in order, of compiled work that holds no lock, in as many threads as torch is allowed."""
    threads = min(torch.get_num_threads(), len(items))
    if threads < 2:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(work, items)


class _SayCompiling(event.Listener):
    """Tells the user once what takes so long; functions that are found in the cache are not compiled."""

    said = False

    def on_start(self, event: event.Event) -> None:
        # A function that was not defined in a file may have no module.
        ours = (event.data["dispatcher"].py_func.__module__ or "").startswith("bodyimage_kin.")
        if ours and not _SayCompiling.said:
            _SayCompiling.said = True
            print("bodyimage_kin: compiling for this processor, once; some ten seconds", file=sys.stderr)

    def on_end(self, event: event.Event) -> None:
        pass


event.register("numba:compile", _SayCompiling())  # type: ignore[no-untyped-call]
