"""The tables of `python -m trainer experiment real-photographs`, in Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence

from trainer.experiments.photographs.agreement import SiteAgreement
from trainer.experiments.photographs.attention import SiteAttention
from trainer.experiments.photographs.lane_pose import SitePose
from trainer.experiments.photographs.steering import Steered


def attention_table(rows: Sequence[SiteAttention]) -> str:
    """Part (a)."""
    head = ("policy", "site", "photographs", "white", "yellow", "white, asked", "yellow, asked")
    cells = [
        (
            row.policy,
            row.site,
            str(row.photographs),
            *(
                number(share, 1)
                for share in (row.white, row.yellow, row.influence_white, row.influence_yellow)
            ),
        )
        for row in rows
    ]
    return markdown(head, cells)


def agreement_table(rows: Sequence[SiteAgreement]) -> str:
    """Part (b), with a sum."""
    found = ("site", "photographs", "judged", "agrees", "", "missed", "invented", "wrong side")
    head = (*found, "offset", "heading")
    cells = []
    for row in rows:
        failures = (row.missed, row.invented, row.wrong_side)
        cells.append(
            (
                row.site,
                str(row.photographs),
                str(row.judged),
                str(row.agrees),
                f"{row.agrees / max(row.judged, 1):.0%}",
                *(str(len(files)) for files in failures),
                f"{number(100 * row.offset_mae_m, 1)} cm",
                f"{number(math.degrees(row.heading_mae_rad), 0)}°",
            )
        )
    judged, agrees = (sum(getattr(row, name) for row in rows) for name in ("judged", "agrees"))
    photographs = str(sum(row.photographs for row in rows))
    total = ("**all**", photographs, str(judged), str(agrees), f"**{agrees / judged:.1%}**")
    return markdown(head, [*cells, (*total, *[""] * 5)])


def pose_table(rows: Sequence[SitePose]) -> str:
    """Part (c)."""
    errors = ("policy", "site", "photographs", "offset", "heading", "order of offsets")
    head = (*errors, "order of headings", "side of offset", "side of heading")
    cells = [
        (
            row.policy,
            row.site,
            str(row.photographs),
            f"{number(100 * row.offset_mae_m, 1)} cm",
            f"{number(math.degrees(row.heading_mae_rad), 0)}°",
            number(row.offset_order, 2),
            number(row.heading_order, 2),
            number(100 * row.offset_side, 0),
            number(100 * row.heading_side, 0),
        )
        for row in rows
    ]
    return markdown(head, cells)


def steering_table(rows: Sequence[Steered]) -> str:
    """Part (d)."""
    head = ("driver", "seed", "camera", "agreement", "95 % interval", "mean of recalls", "left")
    cells = []
    for row in rows:
        result = row.result
        cells.append(
            (
                result.driver,
                str(result.seed),
                f"× {row.times_higher:g}" if math.isfinite(row.times_higher) else "",
                f"{result.accuracy:.1%}",
                f"{result.low:.0%} to {result.high:.0%}",
                f"{result.balanced:.1%}",
                *(f"{share:.0%}" for share in result.guessed),
                number(row.order, 2),
            )
        )
    return markdown((*head, "straight", "right", "order"), cells)


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    rule = ["---"] * len(head)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows)) + "\n"


def number(value: float, digits: int) -> str:
    """A figure, or a dash where there is none."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"
