"""Jobs for the tests of workers: small, quick, and with every way of going wrong."""

import os
import signal
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from robot.errors import ConfigError


@dataclass(frozen=True)
class Chore:
    """Writes what it was told into a file; or fails as told."""

    out: Path
    does: str = "write"

    @property
    def log(self) -> Path:
        return self.out.with_suffix(".log")

    def finished(self) -> bool:
        if self.does == "impossible":
            raise ConfigError(f"{self.out}: expected something that can be done")
        return self.out.exists()

    def run(self, console: Console) -> int:
        console.print(f"{self.out.name} begins")
        os.system(f"echo {self.out.name} speaks past Python")
        if self.does == "refuse":
            raise ConfigError("expected this, got that")
        if self.does == "crash":
            raise RuntimeError("a bug")
        if self.does == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.does == "fail":
            return 1
        self.out.write_text(f"{self.does} {os.environ['OMP_NUM_THREADS']}")
        console.print(f"{self.out.name} is done")
        return 0


@dataclass(frozen=True)
class ToyTraining:
    """Trains in the toy world; notes the process that does it."""

    out: Path
    steps: int

    @property
    def log(self) -> Path:
        return self.out / "log.txt"

    def finished(self) -> bool:
        return False

    def run(self, console: Console) -> int:
        from dataclasses import replace

        from tests.trainer.toy import toy_config, train_toy

        (self.out / "pid").write_text(str(os.getpid()))
        config = toy_config("ppo", self.steps)
        endless = replace(config.evaluation, stop_after_perfect=0, every_steps=10**9)
        metrics = train_toy(replace(config, evaluation=endless), self.out)
        console.print(f"{metrics.train_steps} steps, {metrics.stopped_by}")
        return 0
