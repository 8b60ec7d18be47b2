"""Measure many drawn benches through their buses: `python -m tests.identification [COUNT [FIRST]]`.

What is done is kept in build/identification, a line a bench, so a draw that was ended goes on; another commit begins
anew.
"""

import json
import sys
from pathlib import Path

from tests.identification.drawn import table, work
from tests.soak.__main__ import commit, known

FOLDER = Path(__file__).resolve().parents[2] / "build" / "identification"


def survey(count: int, first: int = 0) -> None:
    """Measure the benches that are not yet known, and print the sums."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = FOLDER / f"{commit()}.jsonl"
    found = {each["seed"]: each for each in known(file)}
    for seed in range(first, first + count):
        if seed not in found:
            found[seed] = work(seed, 1) | {"seed": seed}
            with file.open("a", encoding="utf-8") as log:
                log.write(json.dumps(found[seed]) + "\n")
            for sentence in (*found[seed]["broken"], *found[seed]["refused"]):
                print(sentence, flush=True)
    print("\n".join(table([found[seed] for seed in range(first, first + count)])))


if __name__ == "__main__":
    survey(*map(int, sys.argv[1:] or ["60"]))
