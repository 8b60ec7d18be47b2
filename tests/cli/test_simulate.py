"""`simulate`: one line a drive when ready, until it is asked to stop."""

import json
import shutil
import signal
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from haptic_fieldbus.protocols.catalogue import load_rig, profile_folder
from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.sim.canopen import hosting
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from tests.cli.command import Command
from tests.peers.hosts import STARTS_WITHIN, free_port, line_of, require_multicast, start

pytestmark = pytest.mark.xdist_group("peers")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "--bus is required: the bus on which the drives are hosted"),
        (("--bus", "sim"), 'bus "sim": other programs cannot join it; host on socketcan:can0'),
        (("--bus", "virtual:a", "--drive", "maxon_epos5"), 'no profile "maxon_epos5"'),
        (("--bus", "virtual:a", "--node", "200"), "node 200"),
        (("--bus", "virtual:a", "--hand", "foot"), 'no hand "foot"'),
        (("--bus", "virtual:a", "--faults", "nowhere.toml"), "nowhere.toml"),
        (("--bus", "sockercan:can0"), 'no bus interface "sockercan"'),
    ],
)
def test_what_cannot_be_hosted_is_refused_before_anything_is_opened(
    command: Command, words: tuple[str, ...], said: str
) -> None:
    finished = command("simulate", *words)
    assert finished.status == 2
    assert said in finished.err
    assert finished.out == ""


def test_faults_of_the_master_s_controller_are_not_hosted(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text('[[fault]]\nkind = "bus_off"\nat = 1.0\n')
    finished = command("simulate", "--bus", "virtual:a", "--faults", str(path))
    assert finished.status == 2
    assert 'fault "bus_off" is a fault of the bus or of the host' in finished.err


def test_a_bus_that_does_not_open_is_a_failure(command: Command) -> None:
    finished = command("simulate", "--bus", "udp_multicast:127.0.0.1")
    assert finished.status == 1
    assert "failed" in finished.err


@pytest.mark.thorough("waits for another process", quick=("Ctrl-C",))
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "SIGTERM"])
def test_it_says_a_line_a_drive_and_ends_cleanly_when_asked_to(number: signal.Signals) -> None:
    port = free_port()
    require_multicast(port)
    bus = "udp_multicast:239.74.163.2@1000000"
    as_json = ("--json",) if number is signal.SIGTERM else ()
    process = start(
        "simulate", "--drive", "maxon_epos4@9", "--drive", "generic_cia402", "--bus", bus, *as_json, port=port
    )
    try:
        lines = [line_of(process), line_of(process)]
        process.send_signal(number)
        assert process.wait(STARTS_WITHIN) == 0
    finally:
        process.kill()
        out, err = process.communicate()
    assert (out, err) == ("", "")
    if as_json:
        assert [json.loads(line) for line in lines] == [
            {"drive": "maxon_epos4", "node": 9, "bus": bus},
            {"drive": "generic_cia402", "node": 1, "bus": bus},
        ]
    else:
        assert lines == [
            f"ready      maxon_epos4, node 9, on {bus}\n",
            f"ready      generic_cia402, node 1, on {bus}\n",
        ]


class TestWriteRig:
    """`--write-rig` on a bus of this process, ended at once."""

    @pytest.fixture
    def hosted(self, monkeypatch: pytest.MonkeyPatch) -> list[str]:
        """The drives that would be hosted; they are ready at once, and it ends."""
        told: list[str] = []

        def host(
            bus: BusName,
            slots: Sequence[DriveOnBus],
            seed: int,
            ready: Callable[[DriveOnBus], None],
            stopped: Callable[[], bool],
            tell: Callable[[str], None],
            opened: Callable[[BusName], None],
        ) -> int:
            opened(bus)
            for slot in slots:
                told.append(slot.axis.profile)
                ready(slot)
            return 0

        monkeypatch.setattr(hosting, "host", host)
        return told

    def test_a_rig_of_several_drives_with_an_own_profile_can_be_planned_as_it_is(
        self, command: Command, hosted: list[str], tmp_path: Path
    ) -> None:
        shutil.copy(profile_folder() / "generic_cia402.toml", tmp_path / "mine.toml")
        path = tmp_path / "rig.toml"
        drives = ("--drive", "mine@9", "--drive", "maxon_epos4", "--profiles", str(tmp_path))
        finished = command("simulate", *drives, "--bus", "socketcan:can0@500000", "--write-rig", str(path))
        assert finished.status == 0, finished.err
        assert hosted == ["mine", "maxon_epos4"]
        rig = load_rig(path)
        assert [(name, axis.node, axis.profile) for name, axis in rig.axis.items()] == [
            ("handle", 9, str(tmp_path / "mine.toml")),
            ("handle2", 1, "maxon_epos4"),
        ]
        planned = command("plan", "wall", "--rig", str(path), "--json")
        assert planned.status == 0, planned.err
        assert "500 kbit/s" in command("plan", "wall", "--rig", str(path)).out

    def test_a_file_that_is_there_is_not_overwritten_and_nothing_is_hosted(
        self, command: Command, hosted: list[str], tmp_path: Path
    ) -> None:
        path = tmp_path / "rig.toml"
        path.write_text("mine", encoding="utf-8")
        finished = command("simulate", "--bus", "socketcan:can0@500000", "--write-rig", str(path))
        assert finished.status == 2
        assert "is not overwritten" in finished.err
        assert path.read_text(encoding="utf-8") == "mine"
        assert hosted == []

    def test_a_file_that_cannot_be_written_is_told(self, command: Command, hosted: list[str], tmp_path: Path) -> None:
        finished = command("simulate", "--bus", "socketcan:can0", "--write-rig", str(tmp_path / "no" / "rig.toml"))
        assert finished.status == 2
        assert "cannot write" in finished.err
        assert hosted == []
