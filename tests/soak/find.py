"""Search for a seed that breaks an invariant, or replay one: `python -m tests.soak.find search 2000`.

It prints one JSON object: the seed, the law, and the shrunk faults as the text of a file; null when nothing broke.
`judge FIRST COUNT SECONDS` prints what is broken in some runs, `replay SEED FILE` the names of the laws that the run of
a seed breaks with the faults of a file.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

from haptic_fieldbus.sim.faults import load_faults, toml_of
from tests.soak.case import Case, case_of, run_case
from tests.soak.shrink import shrunk


def laws_broken(case: Case) -> set[str]:
    """Names of the laws that a run breaks."""
    return {name for name, _ in run_case(case).broken}


def shrunk_case(case: Case, law: str) -> str:
    """The fewest faults with which a run still breaks a law, as the text of a file."""
    return toml_of(shrunk(case.faults, lambda faults: law in laws_broken(replace(case, faults=faults))))


def search(count: int) -> dict[str, object] | None:
    """The first seed that breaks a law, with the fewest faults that still break it."""
    for seed in range(count):
        case = case_of(seed)
        verdict = run_case(case)
        if verdict.broken:
            law, sentence = verdict.broken[0]
            found = {"runs": seed + 1, "seed": seed, "law": law, "sentence": sentence}
            return found | {"faults": shrunk_case(case, law)}
    return None


def judged(first: int, count: int, duration: float) -> list[str]:
    """Laws broken in the runs of these seeds; each failing seed with its faults as the text of a file."""
    told = []
    for case in (case_of(seed, duration) for seed in range(first, first + count)):
        for law, sentence in run_case(case).broken:
            told.append(f"seed {case.seed}, {case.scene} on {case.drive}: {law}: {sentence}\n{toml_of(case.faults)}")
    return told


def replayed(seed: int, faults: Path) -> list[str]:
    """Names of the laws that the run of a seed breaks with the faults of a file."""
    return sorted(laws_broken(replace(case_of(seed), faults=load_faults(faults))))


def main(arguments: list[str]) -> int:
    if arguments[0] == "search":
        print(json.dumps(search(int(arguments[1]))))
    elif arguments[0] == "judge":
        print(json.dumps(judged(int(arguments[1]), int(arguments[2]), float(arguments[3]))))
    else:
        print(json.dumps(replayed(int(arguments[1]), Path(arguments[2]))))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
