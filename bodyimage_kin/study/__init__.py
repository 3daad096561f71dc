"""Studies: grids of independent cells, worked off in processes that can be killed, and what can be said of them.

Public names are loaded when first used: whoever only asks how far a study is waits for nothing else.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bodyimage_kin.study.answers import WrongResult
    from bodyimage_kin.study.context import Context, Fact, LeftOut, Score
    from bodyimage_kin.study.facts import FACTS
    from bodyimage_kin.study.grid import Row, Simulation
    from bodyimage_kin.study.held_out import held_out_scores, noise_of
    from bodyimage_kin.study.results import read_study, recording_of
    from bodyimage_kin.study.scores import SCORES
    from bodyimage_kin.study.scoring import PROBES, score
    from bodyimage_kin.study.study import Study
    from bodyimage_kin.study.summary import chain, compare, failures, markdown_table, plain_numbers, summarise

_MODULES = {
    "answers": ("WrongResult",),
    "context": ("Context", "Fact", "LeftOut", "Score"),
    "facts": ("FACTS",),
    "grid": ("Row", "Simulation"),
    "held_out": ("held_out_scores", "noise_of"),
    "results": ("read_study", "recording_of"),
    "scores": ("SCORES",),
    "scoring": ("PROBES", "score"),
    "study": ("Study",),
    "summary": ("chain", "compare", "failures", "markdown_table", "plain_numbers", "summarise"),
}

__all__ = [
    "FACTS",
    "PROBES",
    "SCORES",
    "Context",
    "Fact",
    "LeftOut",
    "Row",
    "Score",
    "Simulation",
    "Study",
    "WrongResult",
    "chain",
    "compare",
    "failures",
    "held_out_scores",
    "markdown_table",
    "noise_of",
    "plain_numbers",
    "read_study",
    "recording_of",
    "score",
    "summarise",
]


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names:
            value = getattr(importlib.import_module(f"bodyimage_kin.study.{module}"), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module 'bodyimage_kin.study' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
