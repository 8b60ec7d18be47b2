"""The SDO downloads of the master are those that dcfgen makes for the same mapping, on several drives.

dcfgen leaves out what the file says that the drive has already; the master writes it all the same, since the drive may
hold something else. Of the order, that of CiA 301 7.5.2.36 matters: a PDO is off before its mapping changes, which is
empty before its entries are written, and their number comes after them, and the identifier last.
"""

import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import can
import pytest
import yaml

from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.eds import Eds, eds_text
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.from_eds import profile_from_eds
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.sim.canopen.simulated_eds import sheet
from tests.builders import WALL, can_traffic, canopen, pdos_of, rig_of, unproved
from tests.eds.sheets import generic
from tests.eds.vendor_files import eds_of, needs_files

NODE, MASTER = 1, 127
INVALID = 1 << 31
PARAMETERS = range(0x1400, 0x1C00)
DCFGEN = str(Path(sys.executable).with_name("dcfgen"))
Write = tuple[int, int, int]
"""Index, sub-index, value."""


def written_by_master(path: Path, plan: Plan) -> list[Write]:
    """The downloads of its configuration, as they pass the wire."""
    writes: list[Write] = []

    def log(_t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        if can_id == 0x600 + NODE and data[0] >> 5 == 1:
            size = 4 - (data[0] >> 2 & 3)
            writes.append((int.from_bytes(data[1:3], "little"), data[3], int.from_bytes(data[4 : 4 + size], "little")))

    clock = VirtualClock()
    with can.Bus(interface="haptic_sim", channel=f"{path}@{NODE}", clock=clock) as bus:
        master = CanopenBus(bus, clock, log)
        master.open(plan)
        downloads = list(writes)
        master.stop()
    return downloads


def network(path: Path, plan: Plan, eds: Eds) -> str:
    """Input of dcfgen: the same mapping, identifiers and types, and that all other PDOs are off."""
    drive: dict[str, object] = {"dcf": str(path), "node_id": NODE, "heartbeat_consumer": 0x1016 in eds}
    drive["heartbeat_producer"] = can_traffic(plan).node_heartbeat_ms
    used = {(pdo.direction, pdo.number): pdo for pdo in pdos_of(plan)}
    for direction, name, first in ((Direction.RPDO, "rpdo", 0x1400), (Direction.TPDO, "tpdo", 0x1800)):
        told: dict[int, dict[str, object]] = {}
        drive[name] = told
        for index in (index for index in eds.objects if first <= index < first + 0x200):
            number, pdo = index - first + 1, used.get((direction, index - first + 1))
            identifier = _default(eds, index, 1)
            if pdo is None:
                told[number] = {"cob_id": identifier | INVALID}
                continue
            told[number] = {
                "cob_id": pdo.cob_id | identifier & 1 << 30,
                "transmission": pdo.transmission_type,
                "mapping": [{"index": entry.object, "sub_index": entry.subindex} for entry in pdo.entries],
            }
            if direction is Direction.TPDO:
                told[number]["inhibit_time"] = 0
    guard_ms = round(can_traffic(plan).guard(plan.axes[0].name) * 1e3)
    master = {"node_id": MASTER, "heartbeat_producer": guard_ms, "heartbeat_multiplier": 1}
    return str(yaml.safe_dump({"master": master, "drive": drive}))


def _default(eds: Eds, index: int, subindex: int) -> int:
    entry = eds.find(index, subindex)
    value = entry.value(NODE) if entry is not None else None
    return value if isinstance(value, int) else 0


def written_by_dcfgen(folder: Path, text: str) -> list[Write]:
    """The concise DCF (CiA 302-3) that dcfgen makes."""
    (folder / "network.yml").write_text(text)
    subprocess.run([DCFGEN, "-d", folder, folder / "network.yml"], check=True)
    data = (folder / "drive.bin").read_bytes()
    return list(_concise(data[4:]))


def _concise(data: bytes) -> Iterator[Write]:
    while data:
        index, subindex, size = struct.unpack_from("<HBL", data)
        yield index, subindex, int.from_bytes(data[7 : 7 + size], "little")
        data = data[7 + size :]


def compared(writes: list[Write], eds: Eds) -> list[Write]:
    """Writes of heartbeat and PDOs in the order of the standard, without what the drive holds already."""
    held = {(entry.index, entry.subindex): _default(eds, entry.index, entry.subindex) for entry in eds}
    found: list[Write] = []
    for index, subindex, value in writes:
        if index in (0x1016, 0x1017) or index in PARAMETERS:
            # An identifier that is off says nothing but that.
            off = subindex == 1 and index & 0x200 == 0 and index in PARAMETERS and value & INVALID
            value = INVALID if off else value
            if held.get((index, subindex)) != value or index & 0x200:
                found.append((index, subindex, value))
            held[index, subindex] = value
    return found


def check_order(writes: list[Write]) -> None:
    """For each PDO: off, no entries, entries in their order, their number, and the identifier last."""
    for index in {index for index, _, _ in writes if index in PARAMETERS and index & 0x200}:
        steps = [(at, sub, value) for at, sub, value in writes if at == index or (at == index - 0x200 and sub == 1)]
        names = [(at - index, sub) for at, sub, _ in steps if (at, sub) != (index - 0x200, 1)]
        count = len(names) - 2
        assert names == [(0, 0), *((0, sub) for sub in range(1, count + 1)), (0, 0)]
        assert steps[-1][0] == index - 0x200
        assert not steps[-1][2] & INVALID
        assert all(value & INVALID for at, _, value in steps[:-1] if at != index)


def sheet_of(name: str) -> Eds:
    """Return the sheet of the simulated drive of a file."""
    return sheet(profile_from_eds(eds_of(name)))


CASES = [
    pytest.param(lambda: generic(), id="generic"),
    pytest.param(lambda: sheet(canopen("zeroerr_erob")), id="erob", marks=pytest.mark.thorough("another drive")),
    *(
        pytest.param(lambda name=name: sheet_of(name), id=name, marks=pytest.mark.thorough("another drive"))
        for name in ("cyclic_torque.dcf", "profile_torque.eds", "capitals.eds")
    ),
    *(
        pytest.param(lambda name=name: sheet_of(name), id=name, marks=needs_files)
        for name in ("maxon_epos4_70_15.eds", "elmo_gold_drive.dcf", "zeroerr_erob_v1_5.eds", "delta_asda_a2.eds")
    ),
]


@pytest.mark.parametrize("made", CASES)
def test_the_write_list_is_that_of_dcfgen(made, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    eds: Eds = made()
    path = tmp_path / "drive.eds"
    path.write_text(eds_text(eds), encoding="utf-8", newline="")
    profile = canopen(path)
    rig = rig_of(WALL, profile="drive", raise_max_torque=True, emergency_stop="power")
    plan = unproved(compile_plan(WALL, rig, {"drive": profile}, 1000.0))
    ours = written_by_master(path, plan)
    theirs = written_by_dcfgen(tmp_path, network(path, plan, eds))
    assert len(theirs) > 10
    assert sorted(compared(ours, eds)) == sorted(compared(theirs, eds))
    check_order(ours)
    check_order(theirs)
