"""Networks that are fitted to something, whatever happens meanwhile."""

from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from trainer import resumable


def test_what_is_fitted_in_two_goes_is_as_if_it_had_been_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its rate goes on falling where it was, too, and dropout is over in the end."""
    monkeypatch.setattr(resumable, "SAVE_EVERY_S", -1.0)  # every step is saved

    def fitted(name: str, stop_at: int = 99) -> torch.Tensor:
        torch.manual_seed(0)
        network = torch.nn.Sequential(torch.nn.Linear(3, 1), torch.nn.Dropout(0.5))
        optimiser, rates = torch.optim.SGD(network.parameters(), 0.1), list[float]()
        path, console = tmp_path / f"{name}.pt", Console(quiet=True)
        done = 4 if path.exists() else 0

        def loss(rng: np.random.Generator) -> torch.Tensor:
            assert network.training
            rates.append(optimiser.param_groups[0]["lr"])
            if done + len(rates) > stop_at:
                raise KeyboardInterrupt
            return (network(torch.from_numpy(rng.random((4, 3), np.float32))) - 5.0).square().mean()

        resumable.fit(network, optimiser, loss, path, 10, 3, "test", console)
        wanted = [0.05 * (1.0 + np.cos(0.1 * np.pi * k)) for k in range(done, 10)]
        assert rates == pytest.approx(wanted)
        assert not network.training
        return network[0].weight.detach()

    with pytest.raises(KeyboardInterrupt):
        fitted("halves", stop_at=4)
    assert torch.equal(fitted("halves"), fitted("whole"))
