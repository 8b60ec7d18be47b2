"""Examples of docs/how-to/run_beside_a_simulated_drive.md work as they stand there: two processes on a bus."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_fieldbus.cli.simulate import HEADING
from haptic_fieldbus.drive.rig_units import rig_text
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.sim.host_request import HostRequest, resolve, rig_of
from tests.cli.command import Command
from tests.peers.hosts import PROJECT, STARTS_WITHIN, free_port, line_of, require_multicast

pytestmark = pytest.mark.xdist_group("peers")

TEXT = (PROJECT / "docs" / "how-to" / "run_beside_a_simulated_drive.md").read_text(encoding="utf-8")
SIMULATE, PLAN, RUN, MODBUS = re.findall(r"^```console\nhaptic-fieldbus (.*?)\n```", TEXT, re.MULTILINE | re.DOTALL)
READY, SHOWN = re.findall(r"^```text\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
(RIG,) = re.findall(r"^```toml\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
TOO_SLOW = re.compile(
    r"^(tripped|failed)  .*((s after|Tripped before) enabling: .*; (torque is off|zero torque)|uses the processor|"
    r"missed the master's heartbeat\), before enabling. No torque was applied|: no answer$)",
    re.M,
)
"""How a run ends on a computer that has no time for it: the drive is proved or enabled, no period is punctual, or the
simulated drive beside it does not answer in time."""


def started(command: str, folder: Path, port: int) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "haptic_fieldbus", *command.split()],
        cwd=folder,
        env={**os.environ, "CAN_CONFIG": f'{{"port": {port}}}', "PYTHONPATH": str(PROJECT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_the_rig_of_the_page_is_the_one_that_is_written_and_a_plan_takes_it_as_it_is(
    command: Command, tmp_path: Path
) -> None:
    bus, slots = resolve(HostRequest(["maxon_epos4"], "udp_multicast:239.74.163.2@1000000", hand="push"))
    assert rig_text(rig_of(bus, slots), HEADING) == RIG
    path = tmp_path / "rig.toml"
    path.write_text(RIG, encoding="utf-8")
    assert load_rig(path).axis["handle"].seen.direction is None, "a hand moves the handle, so it can be shown"
    finished = command(*PLAN.replace("rig.toml", str(path)).split())
    assert (finished.status, finished.err) == (0, "")
    assert "to be tested at zero torque before force is applied" in finished.out


def test_the_same_drives_on_modbus_are_hosted_by_what_the_page_says() -> None:
    for line in MODBUS.replace("haptic-fieldbus ", "").splitlines():
        words = line.split()
        bus, (slot,) = resolve(HostRequest([], words[words.index("--bus") + 1], hand=words[words.index("--hand") + 1]))
        assert slot.axis.profile == "generic_cia402_modbus"
        assert rig_of(bus, [slot]).bus


@pytest.mark.thorough("two processes in real time")
def test_the_commands_of_the_page(tmp_path: Path) -> None:
    port = free_port()
    require_multicast(port)
    hosting = started(SIMULATE, tmp_path, port)
    try:
        assert line_of(hosting) == READY
        assert (tmp_path / "rig.toml").read_text(encoding="utf-8") == RIG
        run = started(RUN, tmp_path, port)
        out, err = run.communicate(timeout=2 * STARTS_WITHIN)
        # A computer that is too slow for both is told so, as the page says; all else must be as shown.
        assert run.returncode == 0 or TOO_SLOW.search(err), err
        if "watchdog" not in out:
            pytest.skip(f"this computer is too slow to prove a guard: {err.splitlines()[-1]}")
        rows = {line.split()[0]: line for line in out.splitlines() if line and line[0] != " "}
        shown = {line.split()[0]: line for line in SHOWN.splitlines()}
        assert [name for name in shown if name in rows] == [*shown][: None if run.returncode == 0 else -1]
        assert rows["limit"] == shown["limit"]
        measured = re.escape(shown["watchdog"]).replace("\\.", ".")
        assert re.fullmatch(re.sub(r"[\d.]+", r"[\\d.]+", measured), rows["watchdog"])
        proved = load_rig(tmp_path / "rig.toml").axis["handle"].proved
        assert proved is not None
        assert proved.guard == "proved"
        again = started(SIMULATE, tmp_path, port)
        _, refused = again.communicate(timeout=STARTS_WITHIN)
        assert again.returncode == 2
        assert "rig.toml exists and is not overwritten" in refused
        hosting.send_signal(signal.SIGINT)
        rest, told = hosting.communicate(timeout=STARTS_WITHIN)
        assert (hosting.returncode, rest, told) == (0, "", "")
    finally:
        hosting.kill()
        hosting.communicate()
