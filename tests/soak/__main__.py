"""The soak: `python -m tests.soak`, or `make soak`.

SOAK_RUNS in the environment is the number of seeded runs (10,000); the other parts scale with it. What is done is kept
in build/soak, a line a chunk, so a soak that was ended goes on; another commit begins anew. A whole soak writes its
table into docs/reference/soak.md.
"""

import json
import multiprocessing
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from time import perf_counter

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from tests.identification.twins import wrong_with_twins
from tests.soak.page import page
from tests.soak.parts import WHOLE, Chunk, Found, chunks, worked

PROJECT = Path(__file__).resolve().parents[2]
FOLDER = PROJECT / "build" / "soak"
PAGE = PROJECT / "docs" / "reference" / "soak.md"
PROCESSES = 2
CHUNKS_A_BATCH = 80
"""The processes are replaced after so many, so that what one leaves behind in them does not reach the others. A pool
that replaces its processes by itself (`max_tasks_per_child`) stands still in the end (python/cpython#115634)."""


def commit() -> str:
    """Commit that is checked out; empty where it is unknown."""
    command = ["git", "describe", "--always", "--dirty", "--exclude", "*"]
    return subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False).stdout.strip()


def known(file: Path) -> list[Found]:
    """Findings of an earlier soak of the same size and commit; a line that was cut off is left out."""
    found: list[Found] = []
    for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else ():
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return found


def soak(runs: int, file: Path) -> list[Found]:
    """Do all chunks that are not known yet."""
    found = known(file)
    done = {Chunk(each["part"], each["first"], each["count"]) for each in found}
    todo = [chunk for chunk in chunks(runs) if chunk not in done]
    columns = (TextColumn("{task.description:28}"), BarColumn(), MofNCompleteColumn())
    bar = Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=Console(stderr=True))
    context = multiprocessing.get_context("spawn")
    with bar, file.open("a") as log:
        task = bar.add_task("soak", total=len(todo) + len(done), completed=len(done))
        for batch in (todo[first : first + CHUNKS_A_BATCH] for first in range(0, len(todo), CHUNKS_A_BATCH)):
            with ProcessPoolExecutor(PROCESSES, context) as pool:
                for future in as_completed([pool.submit(worked, chunk) for chunk in batch]):
                    each = future.result()
                    found.append(each)
                    log.write(json.dumps(each) + "\n")
                    log.flush()
                    bar.update(task, advance=1, description=each["part"])
                    for sentence in each["broken"]:
                        bar.console.print(f"BROKEN {sentence}", markup=False, highlight=False)
    return found


def main() -> int:
    runs = int(os.environ.get("SOAK_RUNS", WHOLE))
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = FOLDER / f"{commit()}-{runs}.jsonl"
    begun = perf_counter()
    found = soak(runs, file)
    text = page(found, runs, commit(), perf_counter() - begun)
    (FOLDER / "soak.md").write_text(text, encoding="utf-8")
    if runs >= WHOLE:
        PAGE.write_text(text, encoding="utf-8")
    broken = [sentence for each in found for sentence in each["broken"]] + list(wrong_with_twins(found))
    print("\n".join([*broken, f"{len(broken)} broken; {FOLDER / 'soak.md'}"]))
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
