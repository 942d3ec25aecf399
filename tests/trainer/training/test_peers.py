"""Processes that learn together take the mean of their gradients, and listen to nobody else."""

import socket
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.trainer.toy import build_model, make_toy, toy_config
from trainer.training.peers import Link, PeerLostError, Peers, answer, call, give, take

KEY = bytes(range(32))


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(2.0)
        yield listening


def two_ends() -> tuple[Link, Link]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(2.0)
        host, port = listening.getsockname()
        follower = call(host, port, KEY, 1)
        answered = answer(listening, KEY)
        assert answered is not None
        return answered[1], follower


def test_who_knows_the_key_is_answered(server: socket.socket) -> None:
    host, port = server.getsockname()
    link = call(host, port, KEY, rank=3)
    answered = answer(server, KEY)
    assert answered is not None
    rank, other = answered
    assert rank == 3
    give(link, np.ones(3))
    np.testing.assert_array_equal(take(other, np.zeros(3)), np.ones(3))


@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\n\r\n", bytes(33)])
def test_strangers_are_sent_away_before_anything_is_read(
    said: bytes, server: socket.socket
) -> None:
    with socket.create_connection(server.getsockname()) as stranger:
        stranger.sendall(said)
        stranger.shutdown(socket.SHUT_WR)
        assert answer(server, KEY) is None
        stranger.settimeout(2.0)
        assert stranger.recv(1) == b""


def test_nobody_calls(server: socket.socket) -> None:
    server.settimeout(0.01)
    assert answer(server, KEY) is None


def test_nobody_answers() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        host, port = closed.getsockname()
    with pytest.raises(PeerLostError, match="ConnectionRefusedError"):
        call(host, port, KEY, 1)


@settings(max_examples=25)
@given(st.integers(1, 300_000), st.integers(0, 2**32 - 1))
def test_figures_arrive_as_they_are(size: int, seed: int) -> None:
    ours, theirs = two_ends()
    figures = np.random.default_rng(seed).normal(size=size).astype(np.float32)
    giving = threading.Thread(target=give, args=(ours, figures))
    giving.start()
    np.testing.assert_array_equal(take(theirs, np.empty_like(figures)), figures)
    giving.join()
    ours.close()
    theirs.close()


def test_no_half_of_a_gradient_is_believed() -> None:
    ours, theirs = two_ends()
    give(theirs, np.ones(3, np.float32))
    theirs.close()
    with pytest.raises(EOFError, match="closed"):
        take(ours, np.empty(4, np.float32))


def test_one_that_has_gone_is_missed(tmp_path: Any) -> None:
    config = toy_config("ppo", 100)
    model = build_model(config, make_toy(config, 8, 0), tmp_path)
    ours, theirs = two_ends()
    peers = Peers(0, [ours], model)
    theirs.close()
    for parameter in model.policy.parameters():
        parameter.grad = torch.ones_like(parameter)
    with pytest.raises(PeerLostError):
        model.policy.optimizer.step()
    model.num_timesteps += 2_000
    with pytest.raises(PeerLostError):
        peers.news([])


@pytest.mark.parametrize("count", [2, 3])
def test_all_step_by_the_mean_gradient_and_hold_the_same_weights(count: int, tmp_path: Any) -> None:
    config = toy_config("ppo", 100)
    models = [
        build_model(config, make_toy(config, 8, seed), tmp_path / str(seed))
        for seed in range(count)
    ]
    ends = [two_ends() for _ in range(count - 1)]
    rng = np.random.default_rng(7)
    gradients = [
        [torch.from_numpy(rng.normal(size=p.shape).astype(np.float32)) for p in parameters]
        for parameters in (list(model.policy.parameters()) for model in models)
    ]
    used: list[Any] = [None] * count

    def learn(rank: int) -> None:
        links = [leader for leader, _ in ends] if rank == 0 else [ends[rank - 1][1]]
        peers = Peers(rank, links, models[rank])
        parameters = list(models[rank].policy.parameters())
        for parameter, gradient in zip(parameters, gradients[rank], strict=True):
            parameter.grad = gradient.clone()
        models[rank].policy.optimizer.step()
        used[rank] = [parameter.grad for parameter in parameters]
        peers.close()

    threads = [threading.Thread(target=learn, args=(rank,)) for rank in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20.0)
    for k, mean in enumerate(used[0]):
        expected = torch.stack([each[k] for each in gradients]).mean(0)
        torch.testing.assert_close(mean, expected)
    for model, theirs in zip(models[1:], used[1:], strict=True):
        for ours, other in zip(used[0], theirs, strict=True):
            torch.testing.assert_close(other, ours, rtol=0, atol=0)
        pairs = zip(models[0].policy.parameters(), model.policy.parameters(), strict=True)
        for ours, other in pairs:
            torch.testing.assert_close(other, ours, rtol=0, atol=0)


def test_who_leaves_after_a_loss_does_so_quietly(tmp_path: Any) -> None:
    config = toy_config("ppo", 100)
    ours, theirs = two_ends()
    peers = Peers(0, [ours], build_model(config, make_toy(config, 8, 0), tmp_path))
    theirs.close()

    def give_on() -> None:
        for _ in range(1_000):
            give(ours, np.zeros(100))

    with pytest.raises(OSError, match=r"Broken pipe|reset"):
        give_on()
    peers.close()  # though there is something left that nobody takes
