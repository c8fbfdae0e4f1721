"""A diagnosis shared among processes: what comes out does not depend on how many there are."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from harness.scaled_plants import CART, Scale, plant_in, recorded, recording_in

from hoopd import lab
from hoopd.diagnose.record_file import to_json_bytes
from hoopd.diagnose.search.processes import computed, side_by_side


def squares(i: int) -> tuple[int, np.ndarray]:
    return os.getpid(), np.full(1000, i * i)


def test_results_stand_in_the_order_of_the_tasks_whoever_does_them() -> None:
    for jobs in (1, 2, 5):
        with side_by_side(jobs):
            found = computed([partial(squares, i) for i in range(40)])
        assert [int(one[0]) for _, one in found] == [i * i for i in range(40)]
        assert len({pid for pid, _ in found}) <= jobs
    assert {pid for pid, _ in computed([partial(squares, i) for i in range(3)])} == {os.getpid()}


def test_another_process_does_some_of_it() -> None:
    parent, (here, to_here), (there, to_there) = os.getpid(), os.pipe(), os.pipe()

    def task() -> int:
        # who is there first waits for the other one: one takes a task each
        told, heard = (to_there, here) if os.getpid() == parent else (to_here, there)
        os.write(told, b".")
        os.read(heard, 1)
        return os.getpid()

    with side_by_side(2):
        assert len({*computed([task, task])}) == 2


def test_a_task_with_tasks_of_its_own_does_them_itself() -> None:
    def outer() -> bool:
        return {pid for pid, _ in computed([partial(squares, i) for i in range(4)])} == {os.getpid()}

    with side_by_side(3):
        assert computed([outer] * 6) == [True] * 6


def refuse() -> None:
    raise ValueError("no such plant")


def vanish(parent: int) -> None:
    if os.getpid() != parent:
        os._exit(3)


@pytest.mark.parametrize(
    ("task", "error"), [(refuse, "no such plant"), (partial(vanish, os.getpid()), "ended before it was done")]
)
def test_what_goes_wrong_in_a_process_is_raised_here(task: Callable[[], None], error: str) -> None:
    parent = os.getpid()
    begun, tell = os.pipe()

    def elsewhere() -> None:
        # who takes which task is chance: this process looks on until the other one has begun one
        if os.getpid() != parent:
            os.write(tell, b".")
            task()
        else:
            os.read(begun, 1)

    with side_by_side(2), pytest.raises((ValueError, RuntimeError), match=error):
        computed([elsewhere, elsewhere])


@pytest.mark.proof
def test_two_processes_find_the_same_to_the_last_bit() -> None:
    truth = CART._replace(friction=0.1 * CART.size)
    recording, plant = recording_in(truth, Scale(), recorded(truth, 15.0)), plant_in(truth, Scale())
    alone, together = (lab.diagnose(recording, plant=plant, free_run=False, jobs=jobs).diagnosis for jobs in (1, 2))
    assert alone.effects
    assert to_json_bytes(alone) == to_json_bytes(together)
