"""Threads that get in each other's way on purpose."""

from __future__ import annotations

import sys
import sysconfig
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

_PAUSES, _PAUSE = 8, 1e-6
"""Times that a line pauses in each thread, as a library may have long loops; and for how long [s], just to let go."""
_OURS = str(Path(__file__).parents[1])
_INSTALLED = tuple(
    dict.fromkeys(sysconfig.get_paths()[kind] for kind in ("stdlib", "platstdlib", "purelib", "platlib"))
)


@contextmanager
def others_in_between() -> Iterator[None]:
    """Lets other threads run between the lines of Python of this one, so that what may go wrong there does.

    Lines of the standard library and of installed packages other than this one do not pause: they are too many.
    """
    runs: Counter[tuple[CodeType, int]] = Counter()

    def pause(frame: FrameType, event: str, argument: object) -> Any:
        if not _pauses(frame.f_code.co_filename):
            return None
        if event == "line":
            line = frame.f_code, frame.f_lineno
            runs[line] += 1
            if runs[line] <= _PAUSES:
                time.sleep(_PAUSE)
        return pause

    before = sys.gettrace()
    sys.settrace(pause)
    try:
        yield
    finally:
        sys.settrace(before)


@lru_cache(maxsize=10_000)
def _pauses(file: str) -> bool:
    """Whether lines of a file pause; what was compiled from no file at all does not."""
    return file.startswith(_OURS) or not file.startswith(("<", *_INSTALLED))
