"""Where the followers of a training live: on this machine, or on a Ray cluster."""

from __future__ import annotations

import os
from multiprocessing import forkserver
from typing import Any

from torch import multiprocessing

from trainer.one_thread import one_thread_each
from trainer.training.crew import Orders
from trainer.training.follow import follow

_LEAVE_S = 5.0  # that a process gets to leave in order


class LocalFollowers:
    """Processes of this machine; see `trainer.training.crew.Launcher`."""

    host = "127.0.0.1"

    def __init__(self) -> None:
        self.cores = len(os.sched_getaffinity(0))
        self._processes: list[Any] = []

    def start(self, orders: list[Orders]) -> None:
        """One process for each."""
        # A server that has imported everything forks them: quick, and no threads are copied.
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["trainer.training.follow"])
        with one_thread_each():
            forkserver.ensure_running()
        for each in orders:
            process = context.Process(target=follow, args=(each,), daemon=True)
            process.start()
            self._processes.append(process)

    def lost(self) -> str:
        """What became of one that has ended; empty while all live."""
        codes = (process.exitcode for process in self._processes)
        return next((f"exit status {code}, see above" for code in codes if code is not None), "")

    def close(self) -> None:
        """End them all."""
        for process in self._processes:
            process.terminate()
        for process in self._processes:
            process.join(_LEAVE_S)
            process.kill()
            process.join()
        self._processes = []


class RayFollowers:
    """Tasks of a Ray cluster, a core each; see `trainer.training.crew.Launcher`.

    Args:
        ray: the module, connected to the cluster.
    """

    def __init__(self, ray: Any) -> None:
        self._ray, self.host = ray, ray.util.get_node_ip_address()
        self.cores = 1 + int(ray.cluster_resources().get("CPU", 0))  # with the leader's own
        # one process each and no second try: the leader replaces who is lost
        self._follow = ray.remote(num_cpus=1, max_retries=0, max_calls=1)(follow)
        self._references: list[Any] = []

    def start(self, orders: list[Orders]) -> None:
        """One task for each."""
        self._references = [self._follow.remote(each) for each in orders]

    def lost(self) -> str:
        """What became of one that has ended; empty while all live."""
        ended, _ = self._ray.wait(self._references, timeout=0)
        try:
            self._ray.get(ended)
        except self._ray.exceptions.RayError as error:
            return str(error)
        return "it ended" if ended else ""

    def close(self) -> None:
        """End them all."""
        for reference in self._references:
            self._ray.cancel(reference, force=True)
        self._references = []
