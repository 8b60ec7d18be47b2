"""Many drawn benches measured through their buses, and what came of it: a part of the soak."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.identification.whole_benches import (
    accurate,
    drawn_whole_bench,
    judged,
    limit_share,
    measured_whole,
    wrong_with,
)


def work(first: int, count: int) -> dict[str, Any]:
    """Measure benches; return the bounds that were left, which intervals cover, which values are near, and refusals.

    The limits are shares of the true ones.
    """
    broken, covered, near, refused = list[str](), Counter[str](), Counter[str](), list[str]()
    limits: list[float] = []
    for seed in range(first, first + count):
        with TemporaryDirectory() as folder:
            measured = measured_whole(drawn_whole_bench(seed), Path(folder))
        broken += wrong_with(measured)
        covered.update(f"{name} {inside}" for name, inside in judged(measured).items())
        near.update(f"{name} {inside}" for name, inside in accurate(measured).items())
        limits += [share] if (share := limit_share(measured)) is not None else []
        if measured.failure:
            refused.append(f"{seed}: {measured.failure}")
    return {"broken": broken, "covered": dict(covered), "near": dict(near), "refused": refused, "limits": limits}


def table(found: Sequence[dict[str, Any]]) -> list[str]:
    """Return the sums of many benches as lines."""
    lines = [f"{sum(len(each['refused']) for each in found)} of {len(found)} benches refused"]
    for key, words in (("covered", "intervals that cover"), ("near", "values that are near enough")):
        total = sum((Counter(each[key]) for each in found), Counter[str]())
        names = dict.fromkeys(each.partition(" ")[0] for each in total)
        parts = [
            f"{name} {total[f'{name} True']} of {total[f'{name} True'] + total[f'{name} False']}" for name in names
        ]
        lines.append(f"{words}: {', '.join(parts)}")
    if limits := sorted(share for each in found for share in each.get("limits", ())):
        below = sum(share < 1.0 for share in limits)
        lines.append(
            f"limits below the true one: {below} of {len(limits)}; median share {limits[len(limits) // 2]:.2f}"
        )
    return lines
