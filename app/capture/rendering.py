"""Files of pictures that processes render side by side."""

import multiprocessing
import os
from collections.abc import Callable, Sequence
from typing import TypeVar

from app.process import child

Job = TypeVar("Job")
Made = TypeVar("Made")


def rendered(
    render: Callable[[Job], Made], jobs: Sequence[Job], processes: int, what: str
) -> list[Made]:
    """What each job gives, in the order in which they end; `what` names them in a progress bar."""
    from tqdm import tqdm

    # one rasteriser thread a process: the pool keeps the cores busy
    os.environ["LP_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"
    with multiprocessing.get_context("spawn").Pool(processes, child.begin_worker) as pool:
        work = pool.imap_unordered(render, jobs)
        made = list(tqdm(work, total=len(jobs), desc=what, unit="file", mininterval=2))
        pool.close()
        pool.join()  # else they are ended, which is told
    return made
