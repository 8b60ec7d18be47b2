"""Wireshark's CANopen dissector reads what is recorded, and sees in it what we say is there."""

import re
import shutil
import struct
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import can
import pytest

from haptic_fieldbus import run, session
from haptic_fieldbus.buses.canopen.frames import open_frame_writer
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.sim.canopen.bus import SimulatedBus

FIELDS = (
    "can.id", "canopen.cob_id", "canopen.sdo.main_idx", "canopen.sdo.sub_idx", "canopen.sdo.abort_code",
    "canopen.nmt_ctrl.cd", "canopen.nmt_guard.state", "canopen.em.err_code", "canopen.lss.cs", "canopen.pdo.data.bytes",
    "_ws.malformed", "_ws.expert.message",
)  # fmt: skip
SUFFIXES = (".log", ".blf")
MS = 1_000_000
NODE = 5


@pytest.fixture(scope="module")
def tshark() -> str:
    found = shutil.which("tshark")
    if found is None:
        pytest.skip("tshark is not installed: apt-get install tshark")
    return found


@dataclass(frozen=True)
class Seen:
    """One frame as tshark sees it: fields by name, those that are not there left out."""

    fields: dict[str, str]

    def number(self, name: str) -> int | None:
        text = self.fields.get(name)
        return None if text is None else int(text, 0)


def dissected(tshark: str, path: Path) -> list[Seen]:
    """Every frame of a file, taken for CANopen."""
    command = [tshark, "-r", str(path), "-d", "can.subdissector,canopen", "-T", "fields", "-E", "separator=/t"]
    for field in FIELDS:
        command += ["-e", field]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = (line.split("\t") for line in done.stdout.splitlines())
    return [Seen({name: text for name, text in zip(FIELDS, row, strict=True) if text}) for row in rows]


def read_candump(path: Path) -> list[tuple[int, bytes]]:
    """Identifiers and octets, as they stand in the text."""
    found = re.findall(r"^\(\d+\.\d+\) \w+ ([0-9A-F]{3})#([0-9A-F]*)$", path.read_text(), re.MULTILINE)
    return [(int(can_id, 16), bytes.fromhex(data)) for can_id, data in found]


def assert_well_formed(frames: list[Seen]) -> None:
    for number, seen in enumerate(frames, start=1):
        assert "_ws.malformed" not in seen.fields, f"frame {number}: {seen.fields}"
        assert "_ws.expert.message" not in seen.fields, f"frame {number}: {seen.fields}"
        assert "canopen.cob_id" in seen.fields, f"frame {number}: {seen.fields}"


@pytest.fixture(scope="module", params=["maxon_epos4", "generic_cia402"])
def recorded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Configuration and run of the demo, twice: the same seed gives the same frames."""
    folder = tmp_path_factory.mktemp("tshark")
    paths = {suffix: folder / f"run{suffix}" for suffix in SUFFIXES}
    for path in paths.values():
        run("wall", drive=request.param, node=NODE, duration=0.2, record=path)
    return paths


@pytest.mark.thorough("a run of each drive in each format", quick=("maxon_epos4-.log",))
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_frame_of_a_run_is_dissected_as_canopen_and_as_what_it_is(
    tshark: str, recorded: dict[str, Path], suffix: str
) -> None:
    frames = read_candump(recorded[".log"])
    assert len(frames) == len(recorded[".log"].read_text().splitlines()) > 500
    assert {kind_of(can_id) for can_id, _ in frames} == set(EXPECTED)
    seen = dissected(tshark, recorded[suffix])
    assert_well_formed(seen)
    assert [each.number("canopen.cob_id") for each in seen] == [can_id for can_id, _ in frames]
    for each, (can_id, data) in zip(seen, frames, strict=True):
        EXPECTED[kind_of(can_id)](each, data)


def kind_of(can_id: int) -> str:
    """CiA 301, table 39: the pre-defined connection set."""
    exact = {0: "NMT", 0x80: "SYNC"}
    return exact.get(can_id) or _BASES.get(can_id & 0x780, f"unknown {can_id:03X}")


_BASES = {
    0x180: "TPDO", 0x280: "TPDO", 0x200: "RPDO", 0x300: "RPDO", 0x580: "SDO response", 0x600: "SDO request",
    0x700: "heartbeat",
}  # fmt: skip


def _expect_sdo(initiates: tuple[int, ...]) -> Callable[[Seen, bytes], None]:
    """Initiates, by command specifier, carry index and sub-index; segments do not. CiA 301, 7.2.4.3."""

    def expect(seen: Seen, data: bytes) -> None:
        if data[0] >> 5 in initiates:
            index, subindex = struct.unpack_from("<HB", data, 1)
            assert (seen.number("canopen.sdo.main_idx"), seen.number("canopen.sdo.sub_idx")) == (index, subindex)

    return expect


def _expect_pdo(seen: Seen, data: bytes) -> None:
    assert seen.fields["canopen.pdo.data.bytes"] == data.hex()


EXPECTED: dict[str, Callable[[Seen, bytes], None]] = {
    "NMT": lambda seen, data: _same(seen.number("canopen.nmt_ctrl.cd"), data[0]),
    "SYNC": lambda seen, data: _same(data, b""),
    "TPDO": _expect_pdo,
    "RPDO": _expect_pdo,
    "SDO request": _expect_sdo((1, 2)),
    "SDO response": _expect_sdo((2, 3)),
    "heartbeat": lambda seen, data: _same(seen.number("canopen.nmt_guard.state"), data[0] & 0x7F),
}


def _same(one: object, other: object) -> None:
    assert one == other


class TestServicesThatARunDoesNotUse:
    """Segments, blocks, aborts, emergencies, LSS: by hand, in virtual time."""

    @pytest.fixture
    def bus(self) -> Iterator[SimulatedBus]:
        with SimulatedBus(f"maxon_epos4@{NODE}", clock=VirtualClock()) as bus:
            yield bus

    @pytest.mark.thorough("2 cases of one rule", quick=1)
    @pytest.mark.parametrize("suffix", SUFFIXES)
    def test_they_are_dissected_as_well(self, tshark: str, tmp_path: Path, bus: SimulatedBus, suffix: str) -> None:
        path = tmp_path / f"services{suffix}"
        log = open_frame_writer(path)
        assert log is not None

        def exchange(can_id: int, data: str, wait: float = 0.01) -> None:
            octets = bytes.fromhex(data)
            log(bus.clock.now_ns(), can_id, octets)
            bus.send(can.Message(arbitration_id=can_id, data=octets, is_extended_id=False))
            while (message := bus.recv(wait)) is not None:
                log(bus.clock.now_ns(), message.arbitration_id, message.data)

        sdo = 0x600 + NODE
        exchange(sdo, "40 08 10 00 00 00 00 00")  # the name, in segments
        exchange(sdo, "60 00 00 00 00 00 00 00")
        exchange(sdo, "70 00 00 00 00 00 00 00")
        exchange(sdo, "A4 08 10 00 7F 00 00 00")  # the name, in a block
        exchange(sdo, "A3 00 00 00 00 00 00 00")
        exchange(sdo, "A2 02 7F 00 00 00 00 00")
        exchange(sdo, "A1 00 00 00 00 00 00 00")
        exchange(sdo, "40 FF 2F 00 00 00 00 00")  # refused: no such object
        exchange(sdo, "23 16 10 01 0A 00 7F 00")  # our heartbeat is due every 10 ms
        exchange(0x000, "01 05")
        exchange(0x77F, "05", wait=0.05)  # and stays away: emergency 8130h
        exchange(0x7E5, "04 01 00 00 00 00 00 00")
        exchange(0x7E5, "5E 00 00 00 00 00 00 00")
        exchange(0x7E5, "5D 00 00 00 00 00 00 00")
        exchange(0x000, "81 05", wait=0.1)
        log.close()

        seen = dissected(tshark, path)
        assert_well_formed(seen)
        assert 0x0602_0000 in {each.number("canopen.sdo.abort_code") for each in seen}
        assert 0x8130 in {each.number("canopen.em.err_code") for each in seen}
        assert {0x04, 0x5E, 0x5D} <= {each.number("canopen.lss.cs") for each in seen}
        assert {0x01, 0x81} <= {each.number("canopen.nmt_ctrl.cd") for each in seen}
        boot_up = [each for each in seen if each.number("canopen.cob_id") == 0x700 + NODE]
        assert [each.number("canopen.nmt_guard.state") for each in boot_up][-1] == 0


def test_the_frames_of_a_session_are_read_as_canopen(tshark: str, tmp_path: Path) -> None:
    """Also of one that its caller left in the middle of a period."""
    path = tmp_path / "session.log"
    with session("wall", node=NODE, duration=0.2, record=path) as live:
        for state in live:
            if state.time > 0.1:
                break
    frames = dissected(tshark, path)
    assert_well_formed(frames)
    assert len(frames) == len(read_candump(path)) > 300
