"""Wi-Fi: delayed, lossy, cut and restored. A proxy of the bench stands for it."""

from __future__ import annotations

from tools.faults.case import Act, Case
from tools.faults.stage import Stage

HOLD = ("HOLD",)
LINK_AGE_S = POSE_AGE_S = 1.0


def _bad(network: str, **changes: float) -> Act:
    def inject(stage: Stage) -> None:
        stage.bench.time.lossy(True)
        for name, value in changes.items():
            setattr(stage.bench.networks[network], name, value)

    return inject


def _good(stage: Stage) -> None:
    for network in stage.bench.networks.values():
        network.cut, network.delay_s, network.loss = False, 0.0, 0.0


def _case(network: str, name: str, what: str, changes: dict[str, float], **more: object) -> Case:
    return Case(name, what, _bad(network, **changes), heal=_good, **more)  # type: ignore[arg-type]


_POSES_OLD: dict[str, object] = {
    "threshold_s": POSE_AGE_S,
    "states": HOLD,
    "says": "overhead pose",
}
_OPERATOR_OLD: dict[str, object] = {
    "threshold_s": LINK_AGE_S,
    "states": HOLD,
    "says": "operator",
}

_BOTH: dict[str, object] = {**_OPERATOR_OLD, "silent": True}
_FINE: dict[str, object] = {"states": ()}

CASES = (
    _case("poses", "poses cut", "no packet passes", {"cut": True}, **_POSES_OLD),
    _case("poses", "poses 2 s late", "each packet", {"delay_s": 2.0}, **_POSES_OLD),
    _case("poses", "poses 0.15 s late", "each packet", {"delay_s": 0.15}, **_FINE),
    _case("poses", "poses lossy", "a fifth is sent again", {"loss": 0.2}, **_FINE),
    _case("monitor", "monitor cut", "no packet passes", {"cut": True}, **_BOTH),
    _case("monitor", "monitor 2 s late", "each packet", {"delay_s": 2.0}, **_BOTH),
    _case("monitor", "monitor 0.15 s late", "each packet", {"delay_s": 0.15}, **_FINE),
    _case("monitor", "monitor lossy", "a fifth again", {"loss": 0.2, "again_s": 0.2}, **_FINE),
)
