"""What each stage of a tick costs, as a table, and against another release."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

# p50 and p99 [ms] by stage; a figure that is no time has p50 alone.
Costs = dict[str, dict[str, float]]


def medians(costs: Sequence[Costs]) -> Costs:
    """Return the medians over several rounds, of the stages of the first."""
    return {
        stage: {q: median(c[stage][q] for c in costs if stage in c) for q in quantiles}
        for stage, quantiles in costs[0].items()
    }


def table(ours: Costs, theirs: Costs | None = None) -> str:
    """Return costs as a table in Markdown; theirs: of another release, with the ratios."""
    more = " other p50 | other p99 | ratio p50 | ratio p99 |" if theirs else ""
    rows = [f"| stage | p50 [ms] | p99 [ms] |{more}", "|---" * (7 if theirs else 3) + "|"]
    for stage, cost in ours.items():
        row = f"| {stage} | {cost['p50']:.2f} | {_number(cost, 'p99')} |"
        if theirs:
            other = theirs.get(stage, {})
            row += f" {_number(other, 'p50')} | {_number(other, 'p99')} |"
            row += f" {_ratio(cost, other, 'p50')} | {_ratio(cost, other, 'p99')} |"
        rows.append(row)
    return "\n".join(rows)


def _number(cost: dict[str, float], quantile: str) -> str:
    return f"{cost[quantile]:.2f}" if quantile in cost else "–"


def _ratio(ours: dict[str, float], theirs: dict[str, float], quantile: str) -> str:
    known = quantile in ours and theirs.get(quantile, 0.0) > 0.0
    return f"{ours[quantile] / theirs[quantile]:.2f}" if known else "–"
