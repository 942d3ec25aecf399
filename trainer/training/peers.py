"""How the processes of one training talk: gradients, weights, and which episodes ended.

By plain TCP through the leader, in the thread that learns. gloo's threads of their own wait for a
core that another process of the training has, so that an exchange took 3 ms in place of 0.8.
"""

import hmac
import pickle
import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from io import BufferedRWPair as Link
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from trainer.learners.episode_count import EpisodeEnd
from trainer.training.checkpoint import content_of, put_back

KEY_BYTES = 32
_PATIENCE_S = 3_600.0  # the leader may be judging its policy
_HELLO_S = 5.0  # that a follower may take to say the key of the training and its rank
_NEWS = 1_000  # decisions of a process between two times that all tell the leader


class PeerLostError(RuntimeError):
    """Another process of the training has gone."""


@contextmanager
def _unless_lost() -> Iterator[None]:
    try:
        yield
    except (OSError, EOFError, pickle.UnpicklingError) as error:
        raise PeerLostError(f"{type(error).__name__}: {error}") from error


@_unless_lost()
def call(host: str, port: int, key: bytes, rank: int) -> Link:
    """A link to the leader; PeerLostError if nobody answers."""
    connected = socket.create_connection((host, port), _HELLO_S)
    connected.sendall(bytes((*key, rank)))
    return _link(connected)


def answer(server: socket.socket, key: bytes) -> tuple[int, Link] | None:
    """Who calls, by rank; None if nobody does within the server's patience, or a stranger."""
    try:
        connected, _ = server.accept()
        connected.settimeout(_HELLO_S)
        *said, rank = connected.recv(KEY_BYTES + 1, socket.MSG_WAITALL)
    except (OSError, ValueError):  # nobody, or somebody who says nothing
        return None
    if hmac.compare_digest(bytes(said), key):
        return rank, _link(connected)
    connected.close()
    return None


class Peers:
    """The other processes of a training: of the leader all, of a follower the leader alone.

    PeerLostError, of all that it does: one has gone.
    """

    @_unless_lost()
    def __init__(self, rank: int, links: Sequence[Link], model: BaseAlgorithm) -> None:
        """Followers get the leader's weights; from now on they change alike."""
        self._leads, self._links, self._model = rank == 0, links, model
        for link in links:
            if self._leads:
                pickle.dump(content_of(model), link)
                link.flush()
            else:
                put_back(model, pickle.load(link))  # of one who knew the key
        self._ended: list[EpisodeEnd] = []
        self._told = model.num_timesteps // _NEWS
        self._hook: Any = model.policy.optimizer.register_step_pre_hook(self._average)

    @_unless_lost()
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
            return [pickle.load(link) for link in self._links]
        pickle.dump((self._ended, time.process_time()), self._links[0])
        self._links[0].flush()
        self._ended = []
        return []

    def close(self) -> None:
        """Leave the others."""
        self._hook.remove()
        for link in self._links:
            with suppress(OSError):  # what is left for who has gone
                link.close()

    @_unless_lost()
    def _average(self, optimizer: torch.optim.Optimizer, *_: Any) -> None:
        """Before a step of the optimiser: the mean of all gradients takes their place."""
        parameters = (p for group in optimizer.param_groups for p in group["params"])
        gradients = [p.grad for p in parameters if p.grad is not None]
        together = parameters_to_vector(gradients)
        mean = together.cpu().numpy()
        if self._leads:
            for link in self._links:  # in the order of their ranks: sums are rounded
                mean += take(link, mean)
            mean /= len(self._links) + 1
        for link in self._links:
            give(link, mean)
        if not self._leads:
            mean = take(self._links[0], mean)
        vector_to_parameters(torch.from_numpy(mean).to(together.device), gradients)


def give(link: Link, figures: np.ndarray) -> None:
    """Send an array whose size and type the other one knows."""
    link.write(figures.data.cast("B"))
    link.flush()


def take(link: Link, like: np.ndarray) -> np.ndarray:
    """An array like this one that the other one gave; EOFError: not all of it."""
    figures = np.empty_like(like)
    if link.readinto(figures.data.cast("B")) != figures.nbytes:
        raise EOFError("the other process closed its connection")
    return figures


def _link(connected: socket.socket) -> Link:
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connected.settimeout(_PATIENCE_S)
    with connected:  # which stays open as long as its file
        return connected.makefile("rwb")
