"""Studies: grids of independent cells, worked off in processes that can be killed, and what can be said of them."""

from bodyimage_kin.study.context import Context, Fact, Score, WrongResult
from bodyimage_kin.study.facts import FACTS
from bodyimage_kin.study.grid import Row, Simulation
from bodyimage_kin.study.held_out import held_out_scores, noise_of
from bodyimage_kin.study.results import read_study, recording_of
from bodyimage_kin.study.scores import SCORES
from bodyimage_kin.study.scoring import PROBES, score
from bodyimage_kin.study.study import Study
from bodyimage_kin.study.summary import chain, compare, failures, markdown_table, summarise

__all__ = [
    "FACTS",
    "PROBES",
    "SCORES",
    "Context",
    "Fact",
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
    "read_study",
    "recording_of",
    "score",
    "summarise",
]
