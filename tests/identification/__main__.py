"""Measure many drawn benches and count what their intervals cover: `python -m tests.identification [COUNT [FIRST]]`."""

import sys
from collections import Counter

from tests.identification.benches import drawn_bench, identified_bench
from tests.identification.test_fit import TRUTHS, truth


def survey(count: int, first: int = 0) -> None:
    """Print the benches that an interval misses or that are not measured, and the share of intervals that cover."""
    covered, failed = Counter[str](), list[int]()
    for seed in range(first, first + count):
        bench = drawn_bench(seed)
        try:
            fit, *_ = identified_bench(bench)
        except (AssertionError, ValueError) as error:
            failed.append(seed)
            print(f"{seed}: not measured: {error}")
            continue
        missed = [
            name for name, value in truth(bench).items() if not fit.values[name].low <= value <= fit.values[name].high
        ]
        covered.update(set(TRUTHS).difference(missed))
        if missed:
            print(f"{seed}: outside of the interval: {', '.join(missed)}", flush=True)
    measured = count - len(failed)
    print(f"{measured} of {count} measured; covered: {', '.join(f'{name} {covered[name]}' for name in TRUTHS)}")


if __name__ == "__main__":
    survey(*map(int, sys.argv[1:] or ["60"]))
