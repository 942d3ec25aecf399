"""How the processes of one training talk: gradients, weights, and which episodes ended.

By plain TCP through the leader, in the thread that learns. gloo's threads of their own wait for a
core that another process of the training has, so that an exchange took 3 ms in place of 0.8.
"""

import hmac
import pickle
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from torch.nn.utils import parameters_to_vector, vector_to_parameters
from torch.utils.hooks import RemovableHandle

from trainer.learners.episode_count import EpisodeEnd
from trainer.training.checkpoint import content_of, put_back

KEY_BYTES = 32
_PATIENCE_S = 3_600.0  # the leader may be judging its policy
_HELLO = struct.Struct(f"!{KEY_BYTES}sI")  # the key of the training, and the rank of who says it
_HELLO_S = 5.0  # that it may take
_NEWS = 1_000  # decisions of a process between two times that all tell each other


class PeerLostError(RuntimeError):
    """Another process of the training has gone."""


class Link:
    """To one other process; PeerLostError where that has gone."""

    def __init__(self, connected: socket.socket) -> None:
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.settimeout(_PATIENCE_S)
        self._socket, self._file = connected, connected.makefile("rwb")

    def tell(self, thing: object) -> None:
        """Send anything that can be pickled."""
        with _unless_lost():
            pickle.dump(thing, self._file, pickle.HIGHEST_PROTOCOL)
            self._file.flush()

    def hear(self) -> Any:
        """What the other one told."""
        with _unless_lost():
            return pickle.load(self._file)  # of one who knew the key

    def give(self, figures: np.ndarray) -> None:
        """Send an array whose size and type the other one knows."""
        with _unless_lost():
            self._file.write(figures.data.cast("B"))
            self._file.flush()

    def take(self, figures: np.ndarray) -> None:
        """Fill an array with what the other one gave."""
        with _unless_lost():
            if self._file.readinto(figures.data.cast("B")) != figures.nbytes:
                raise EOFError("the other process closed its connection")

    def close(self) -> None:
        """Let the other one know."""
        self._file.close()
        self._socket.close()


def call(host: str, port: int, key: bytes, rank: int) -> Link:
    """The leader; PeerLostError if nobody answers."""
    with _unless_lost():
        connected = socket.create_connection((host, port), _HELLO_S)
        connected.sendall(_HELLO.pack(key, rank))
    return Link(connected)


def answer(server: socket.socket, key: bytes) -> tuple[int, Link] | None:
    """Who calls, by rank; None if nobody does within the server's patience, or a stranger."""
    try:
        connected, _ = server.accept()
        connected.settimeout(_HELLO_S)
        said, rank = _HELLO.unpack(connected.recv(_HELLO.size, socket.MSG_WAITALL))
    except (OSError, struct.error):
        return None
    if hmac.compare_digest(said, key):
        return rank, Link(connected)
    connected.close()
    return None


class Peers:
    """The other processes of a training: of the leader all, of a follower the leader alone."""

    def __init__(self, rank: int, links: list[Link], model: BaseAlgorithm) -> None:
        """Followers get the leader's weights; from now on they change alike."""
        self._leads, self._links, self._model = rank == 0, links, model
        if self._leads:
            self._tell(content_of(model))
        else:
            put_back(model, links[0].hear())
        self._ended: list[EpisodeEnd] = []
        self._told = model.num_timesteps // _NEWS
        optimizer = model.policy.optimizer
        self._hook: RemovableHandle = optimizer.register_step_pre_hook(self._average)

    def news(self, ended: list[EpisodeEnd]) -> list[tuple[list[EpisodeEnd], float]]:
        """After each rollout: what each follower tells the leader, by rank.

        That is the episodes that ended there, and the seconds of its processor. Nothing most
        times: to tell takes as long as a short rollout.
        """
        self._ended += ended
        now = self._model.num_timesteps // _NEWS  # alike in all
        if now == self._told:
            return []
        self._told = now
        if self._leads:
            return [link.hear() for link in self._links]
        self._tell((self._ended, time.process_time()))
        self._ended = []
        return []

    def close(self) -> None:
        """Leave the others."""
        self._hook.remove()
        for link in self._links:
            link.close()

    def _tell(self, thing: object) -> None:
        for link in self._links:
            link.tell(thing)

    def _average(self, optimizer: torch.optim.Optimizer, *_: Any) -> None:
        """Before a step of the optimiser: the mean of all gradients takes their place."""
        parameters = (p for group in optimizer.param_groups for p in group["params"])
        gradients = [p.grad for p in parameters if p.grad is not None]
        together = parameters_to_vector(gradients)
        mean = together.cpu().numpy()
        if self._leads:
            others = np.empty_like(mean)
            for link in self._links:  # in the order of their ranks: sums are rounded
                link.take(others)
                mean += others
            mean /= len(self._links) + 1
            for link in self._links:
                link.give(mean)
        else:
            self._links[0].give(mean)
            self._links[0].take(mean)
        vector_to_parameters(torch.from_numpy(mean).to(together.device), gradients)


@contextmanager
def _unless_lost() -> Iterator[None]:
    try:
        yield
    except (OSError, EOFError, pickle.UnpicklingError) as error:
        raise PeerLostError(f"{type(error).__name__}: {error}") from error
