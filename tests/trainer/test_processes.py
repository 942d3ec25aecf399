"""``pool``: as ``map``, in processes of their own."""

import os
import signal

import numba
import pytest

from robot.errors import DuckpilotError
from trainer.processes import pool


def half(number: int) -> tuple[int, float, int]:
    return os.getpid(), number / 2, numba.get_num_threads()


def killed(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def refused(number: int) -> None:
    raise ValueError(number)


def test_a_pool_answers_in_order_from_processes_of_one_thread_each() -> None:
    with pool() as spread:
        where, halves, threads = zip(*spread(half, range(20)), strict=True)
    assert halves == tuple(number / 2 for number in range(20))
    assert os.getpid() not in where
    assert set(threads) == {1}


def test_a_pool_says_so_when_one_of_its_processes_is_killed() -> None:
    with pytest.raises(DuckpilotError, match="got one killed"), pool() as spread:
        list(spread(killed, [0]))


def test_what_a_process_of_a_pool_refuses_is_told() -> None:
    with pytest.raises(ValueError, match="7"), pool() as spread:
        list(spread(refused, [7]))
