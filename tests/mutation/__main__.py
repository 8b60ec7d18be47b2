"""A mutation run: `python -m tests.mutation --count 100 --seed 1`.

Each mutant stands alone in a copy of the project, against the tests that reach its line: first those of the quick
lane, and of these first those of its own room; when none of them fails, those of the thorough lane. A test that fails
without the change as well says nothing and is left out. Results are kept as they come, so a run that was ended goes on.
With `--constants` named constants are changed by a factor, also in `running` and `buses`.
"""

import argparse
import difflib
import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from importlib.util import cache_from_source
from pathlib import Path
from queue import Queue
from time import perf_counter

from tests.mutation.mutants import Mutant, chosen, chosen_constants
from tests.mutation.reach import PROJECT, Reach, traced
from tests.mutation.trial import Failure, first_failure

ROOMS = ("cycle", "planning", "drive")
ROOMS_OF_CONSTANTS = ("cycle", "planning", "running", "buses")
LANES = ("quick", "thorough")
PROCESSES = 2
QUICK_SHARE = 0.95
"""Of the mutants that any test catches, so many must be caught by the quick lane."""
CAUGHT_SHARE = 0.9
"""Of the constants that are changed by a factor, so many must be noticed by any test."""


def environment(tree: Path) -> dict[str, str]:
    """In which the tree, and not the project that is installed, is imported."""
    return os.environ | {"PYTHONPATH": str(tree)}


def copied(folder: Path) -> Path:
    """A copy of all that git knows or would add."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    for name in subprocess.run(command, cwd=PROJECT, check=True, capture_output=True, text=True).stdout.split("\0"):
        if name and (PROJECT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(PROJECT / name, folder / name)
    program = "import haptic_fieldbus; print(haptic_fieldbus.__file__)"
    shown = subprocess.run([sys.executable, "-c", program], cwd="/", env=environment(folder), capture_output=True)
    if not Path(shown.stdout.decode().strip()).is_relative_to(folder):
        raise SystemExit(f"{folder} is not what Python imports: {shown.stdout!r}")
    return folder


def ordered(mutant: Mutant, reach: Reach) -> list[dict[str, float]]:
    """Tests that reach a mutant and how long they take [s], those of its room and the others; quick files first."""
    files: dict[str, dict[str, float]] = {}
    for test in reach.tests.keys() & reach.of(mutant):
        files.setdefault(test.partition("::")[0], {})[test] = reach.seconds(test)
    own: dict[str, float] = {}
    others: dict[str, float] = {}
    for file, tests in sorted(files.items(), key=lambda each: sum(each[1].values())):
        (own if file.startswith(f"tests/{mutant.room}/") else others).update(sorted(tests.items()))
    return [tests for tests in (own, others) if tests]


def tried(mutant: Mutant, tree: Path, reaches: list[Reach]) -> tuple[str, Failure | None]:
    """The lane that notices a mutant, and the test that does; no lane when none does."""
    path, pristine = tree / mutant.file, tree.with_name(f"{tree.name}.pristine")
    source = path.read_bytes()
    for reach in reaches:
        for tests in ordered(mutant, reach):
            while tests:
                shutil.rmtree(tree / ".hypothesis", ignore_errors=True)  # what other mutants have taught
                try:
                    Path(cache_from_source(str(path))).unlink(missing_ok=True)
                    path.write_bytes(mutant.apply(source))
                    failure = first_failure(tree, reach.lane, tests, environment(tree))
                finally:
                    path.write_bytes(source)
                    Path(cache_from_source(str(path))).unlink(missing_ok=True)
                if failure is None:
                    break
                test = failure.test
                alone = {} if test is None else {test: tests[test]}
                if not alone or first_failure(pristine, reach.lane, alone, environment(pristine)) is None:
                    return reach.lane, failure
                tests = {each: seconds for each, seconds in tests.items() if each != test}
    return "", None


def diff(mutant: Mutant, source: bytes) -> str:
    before, after = source.decode().splitlines(), mutant.apply(source).decode().splitlines()
    return "\n".join(line for line in difflib.unified_diff(before, after, mutant.file, "", n=1, lineterm="") if line)


def table(results: list[dict[str, object]]) -> str:
    """How many of each room and of each kind were caught by which lane, and what was not caught by the quick one."""
    lines = [f"{'':20}{'all':>6}{'quick':>7}{'thorough':>10}{'none':>6}"]
    for key in ("room", "kind"):
        for name in dict.fromkeys(str(result[key]) for result in results):
            lanes = Counter(result["lane"] for result in results if result[key] == name)
            lines.append(f"{name:20}{lanes.total():6}{lanes['quick']:7}{lanes['thorough']:10}{lanes['']:6}")
    lanes = Counter(result["lane"] for result in results)
    caught = lanes["quick"] + lanes["thorough"]
    lines.append(f"{'all':20}{lanes.total():6}{lanes['quick']:7}{lanes['thorough']:10}{lanes['']:6}")
    for result in (result for result in results if result["lane"] != "quick"):
        lines += ["", f"{result['lane'] or 'none'}: {result['test'] or ''}", str(result["diff"])]
    share = lanes["quick"] / caught if caught else 1.0
    lines.append(f"\n{lanes['quick']} of {caught} that are caught are caught by the quick lane: {100 * share:.1f} %")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--constants", action="store_true", help="change named constants by a factor")
    parser.add_argument("--lanes", nargs="+", choices=LANES, default=LANES, help="whose tests are run")
    parser.add_argument("--folder", type=Path, default=PROJECT / "build" / "mutation", help="copies, and what is known")
    arguments = parser.parse_args()
    folder: Path = arguments.folder.resolve()
    names = [f"{each}{kind}" for each in range(PROCESSES) for kind in ("", ".pristine")]
    trees = {name: folder / name if (folder / name).exists() else copied(folder / name) for name in names}
    base = trees["0.pristine"]
    rooms, choose = (ROOMS_OF_CONSTANTS, chosen_constants) if arguments.constants else (ROOMS, chosen)
    seen = tuple(sorted({*ROOMS, *ROOMS_OF_CONSTANTS}))
    reaches = [traced(base, folder / "reach", lane, seen, environment(base)) for lane in arguments.lanes]
    kept = folder / f"{'constants-' * arguments.constants}{arguments.count}-{arguments.seed}.jsonl"
    known = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    done = {result["diff"] for result in known}
    free: Queue[Path] = Queue()
    for each in range(PROCESSES):
        free.put(trees[str(each)])

    def work(mutant: Mutant) -> None:
        shown, tree, begin = diff(mutant, (base / mutant.file).read_bytes()), free.get(), perf_counter()
        if shown not in done:
            lane, failure = tried(mutant, tree, reaches)
            result = {"room": mutant.room, "file": mutant.file, "line": mutant.line, "kind": mutant.kind, "lane": lane}
            result |= {"test": failure and failure.test, "hung": failure and failure.hung, "diff": shown}
            result |= {"seconds": round(perf_counter() - begin, 1)}
            with kept.open("a") as file:
                file.write(json.dumps(result) + "\n")
            print(f"{lane or 'NONE':9} {result['seconds']:7} s  {mutant.file}:{mutant.line}  {mutant.kind}", flush=True)
        free.put(tree)

    with ThreadPoolExecutor(PROCESSES) as pool:
        list(pool.map(work, choose(base, rooms, arguments.count, arguments.seed)))
    results = [json.loads(line) for line in kept.read_text().splitlines()]
    print(table(results))
    lanes = Counter(result["lane"] for result in results)
    caught = lanes["quick"] + lanes["thorough"]
    enough = not arguments.constants or caught >= CAUGHT_SHARE * lanes.total()
    return 0 if enough and lanes["quick"] >= QUICK_SHARE * caught else 1


if __name__ == "__main__":
    sys.exit(main())
