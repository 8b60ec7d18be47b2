"""The page of a soak: what was done on which machine, and the longest time to zero of each class of faults."""

import os
import platform
from collections.abc import Iterable, Sequence
from pathlib import Path

from tests.identification.twins import wrong_with_twins
from tests.soak.parts import Found

HEAD = """# Soak test results

`make soak` runs all library scenes on all shipped profiles with random faults from seeds. It sends damaged frames to
the master and to the simulated drive, gives damaged files to every reader, and runs one loop for an hour of virtual
time. Every run is checked against the [invariants](../how-to/simulate_faults.md#invariants).
`SOAK_RUNS` scales all parts. The command writes this page.
"""


def page(found: Sequence[Found], runs: int, commit: str, seconds: float) -> str:
    """Return the page as Markdown."""
    broken = [*(sentence for each in found for sentence in each["broken"]), *wrong_with_twins(found)]
    cpu = sum(each["cpu_s"] for each in found)
    virtual = sum(each.get("virtual_s", 0.0) for each in found)
    lines = [
        HEAD,
        f"{runs} seeded runs, commit {commit or 'unknown'}: **{len(broken)} invariants broken**.",
        f"{cpu / 60.0:.0f} min of processor time, {seconds / 60.0:.0f} min since the last start, "
        f"{virtual / 3600.0:.1f} h of virtual time.",
        "",
        f"Machine: {machine()}.",
        "",
        *_parts(found),
        "",
        *_times(found),
    ]
    return "\n".join(lines) + "\n"


def machine() -> str:
    """The machine in words."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        processor = next((line.partition(":")[2].strip() for line in text.splitlines() if "model name" in line), "")
    except OSError:
        processor = ""
    system = f"{platform.system()} {platform.release()}, Python {platform.python_version()}"
    return f"{processor or platform.machine()}, {os.cpu_count()} processors, {system}"


def _parts(found: Sequence[Found]) -> Iterable[str]:
    yield "| part | how many | broken | processor time [s] |"
    yield "|---|---|---|---|"
    for part in dict.fromkeys(each["part"] for each in found):
        own = [each for each in found if each["part"] == part]
        unit = " s" if part == "an hour" else ""
        count, broken = sum(each["count"] for each in own), sum(len(each["broken"]) for each in own)
        yield f"| {part} | {count}{unit} | {broken} | {sum(each['cpu_s'] for each in own):.0f} |"


def _times(found: Sequence[Found]) -> Iterable[str]:
    times, counts = dict[str, float](), dict[str, int]()
    for each in found:
        for key, took in each.get("times", {}).items():
            times[key] = max(times.get(key, 0.0), took)
            counts[key] = counts.get(key, 0) + each["counts"][key]
    rates = sorted({int(key.rpartition("|")[2]) for key in times}, reverse=True)
    yield "## Longest time to zero torque"
    yield ""
    yield "Each cell is the longest time until the motor had zero torque, and the number of runs. Only runs with one"
    yield "fault that must end them are counted. 0 ms: there was no torque at the event."
    yield ""
    yield f"| fault | cause | {' | '.join(f'{rate} Hz' for rate in rates)} |"
    yield "|" + "---|" * (2 + len(rates))
    for kind, cause in dict.fromkeys(tuple(key.split("|")[:2]) for key in sorted(times)):
        cells = []
        for rate in rates:
            key = f"{kind}|{cause}|{rate}"
            cells.append(f"{1e3 * times[key]:.1f} ms ({counts[key]})" if key in times else "–")
        yield f"| `{kind}` | {cause} | {' | '.join(cells)} |"
