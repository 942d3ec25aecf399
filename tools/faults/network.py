"""Wi-Fi: delayed, lossy, cut and restored. A proxy of the bench stands for it."""

from __future__ import annotations

from tools.faults.case import HOLD, Case, change
from tools.faults.stage import Stage

AGE_S = 1.0


def _good(stage: Stage) -> None:
    for network in stage.bench.networks.values():
        network.cut, network.delay_s, network.loss = False, 0.0, 0.0


def _bad(network: str, name: str, what: str, says: str = "", **values: float) -> Case:
    """With ``says`` the robot holds, else it drives on."""

    def inject(stage: Stage) -> None:
        stage.bench.time.lossy(True)
        change(lambda stage: stage.bench.networks[network], **values)(stage)

    name = f"{network} {name}"
    if not says:
        return Case(name, what, inject, states=(), heal=_good)
    silent = network == "monitor"
    return Case(name, what, inject, AGE_S, says, HOLD, heal=_good, silent=silent)


NETWORK = (
    _bad("poses", "cut", "no packet passes", "overhead pose", cut=True),
    _bad("poses", "2 s late", "each packet", "overhead pose", delay_s=2.0),
    _bad("poses", "0.15 s late", "each packet", delay_s=0.15),
    _bad("poses", "lossy", "a fifth is sent again", loss=0.2),
    _bad("monitor", "cut", "no packet passes", "operator", cut=True),
    _bad("monitor", "2 s late", "each packet", "operator", delay_s=2.0),
    _bad("monitor", "0.15 s late", "each packet", delay_s=0.15),
    _bad("monitor", "lossy", "a fifth again", loss=0.2, again_s=0.2),
)
CASES = {"network": NETWORK}
