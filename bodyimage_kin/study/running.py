"""One run of a study: hands out what is missing, recordings before the rows that learn from them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import dataclass
from typing import Any

from bodyimage_kin.errors import OutputRefused
from bodyimage_kin.study import cells, executors
from bodyimage_kin.study.executors import Call, ExecutorLost, NoWorker
from bodyimage_kin.study.grid import Block
from bodyimage_kin.study.specs import Table
from bodyimage_kin.study.store import Store, said

__all__ = ["work_off"]

_IN_FLIGHT = 256
"""Tasks that wait at once: enough for a cluster."""
_TRIES = 5
"""How often a task is handed out whose worker is lost, or whose recordings are damaged."""

_LOOK = 5.0
"""Time after which it is asked whether anybody is still at work [s]."""
_KEPT = "what is finished is kept, run the study again"


@dataclass(eq=False)
class _Task:
    """Something to hand out: the recordings of a block, and the rows that wait for them; or one row's cell."""

    block: Block
    row: str = ""
    waiting: Sequence[str] = ()
    tries: int = 0


def work_off(
    blocks: Sequence[Block],
    rows: Mapping[str, Table],
    store: Store,
    executor: Executor,
    *,
    limit: float | None,
    retry: bool,
    twice: bool,
    report: Callable[[int, int], None],
) -> None:
    """Computes what is missing of a study.

    Args:
        blocks: Of the study.
        rows: Likewise, name -> table.
        store: Where everything is written, by whoever works.
        executor: Who works.
        limit: Time that a cell may take [s]; None: any.
        retry: Whether cells that failed are tried again.
        twice: Whether each cell is computed twice, and fails where that differs.
        report: Called with the number of tasks that are done, and their total.

    Raises:
        OutputRefused: The store cannot be written to.
        ExecutorLost: Nobody is left to work.
        NoWorker: No process can be started.
    """
    tasks: deque[_Task] = deque()
    for block in blocks:
        missing = [
            name for name, row in rows.items() if block.is_on(row) and _is_missing(store, block, name, row, retry)
        ]
        if missing:
            tasks.append(_Task(block, waiting=missing))
    done, total = 0, sum(1 + len(task.waiting) for task in tasks)
    report(done, total)
    pending: dict[Future[Any], _Task] = {}
    most = 1 if isinstance(executor, executors.InProcess) else _IN_FLIGHT
    try:
        while tasks or pending:
            while tasks and len(pending) < most:
                task = tasks.popleft()
                if not task.row and task.tries == 0 and store.read(store.part(task.block), task.block.identity()):
                    tasks.extendleft(_Task(task.block, name) for name in reversed(task.waiting))
                    done += 1
                    report(done, total)
                    continue
                try:
                    pending[executors.submit(executor, _call(task, rows, store, limit, twice))] = task
                except Exception as problem:
                    raise ExecutorLost(f"nobody is left to work ({said(problem)}); {_KEPT}") from None
            finished = wait(pending, _LOOK, FIRST_COMPLETED).done if pending else ()
            if not finished and isinstance(executor, executors.Ours) and executor.gone:
                raise ExecutorLost(f"the scheduler is lost; {_KEPT}")
            for future in finished:
                task = pending.pop(future)
                more, count = _taken(store, task, rows, future)
                tasks.extendleft(reversed(more))
                done += count
                report(done, total)
    finally:
        for future in pending:
            future.cancel()


def _is_missing(store: Store, block: Block, name: str, row: Table, retry: bool) -> bool:
    part = store.read(store.part(block, name), block.identity(name, row))
    return part is None or (retry and any(part.notes["failures"]))


def _call(task: _Task, rows: Mapping[str, Table], store: Store, limit: float | None, twice: bool) -> Call:
    """A task as whoever works takes it."""
    if not task.row:
        return Call(cells.record, (task.block,), log=str(store.log(task.block)))
    arguments = (task.block, task.row, rows[task.row], twice)
    # A body is loaded before the time runs.
    prepare = cells.load_body if limit is not None else None
    return Call(cells.learn, arguments, prepare, limit, str(store.log(task.block, task.row)))


def _taken(store: Store, task: _Task, rows: Mapping[str, Table], future: Future[Any]) -> tuple[list[_Task], int]:
    """What is to be done next because of what came of a task, and how many tasks are done by it."""
    problem = CancelledError() if future.cancelled() else future.exception()
    if isinstance(problem, NoWorker | OutputRefused):
        raise problem
    if problem is not None and executors.was_lost(problem):
        if task.tries >= _TRIES:
            raise ExecutorLost(f"whoever works is lost again and again ({said(problem)}); {_KEPT}")
        return [_Task(task.block, task.row, task.waiting, task.tries + 1)], 0
    failure = future.result() if problem is None else said(problem)
    if task.row:
        if failure == cells.AGAIN and task.tries < _TRIES:
            return [_Task(task.block, waiting=[task.row], tries=task.tries + 1)], 0
        if failure:
            store.write(store.part(task.block, task.row), cells.failed(task.block, task.row, rows[task.row], failure))
        return [], 1
    if not failure:
        return [_Task(task.block, name, tries=task.tries) for name in task.waiting], int(task.tries == 0)
    for name in task.waiting:
        store.write(
            store.part(task.block, name), cells.failed(task.block, name, rows[name], f"no recordings: {failure}")
        )
    return [], len(task.waiting) + int(task.tries == 0)
