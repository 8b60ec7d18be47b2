"""Files with the peculiarities of vendors, and vendors' own: each loads as two other readers read it."""

import logging
import math
import re
from dataclasses import replace
from typing import Any

import canopen
import pytest
from canopen.objectdictionary import ODVariable

from haptic_fieldbus.eds import EdsEntry, EdsType, NodeOffset, eds_text, read_eds
from haptic_fieldbus.eds.model import EdsValue
from tests.eds.peculiar import PECULIARITIES, SHEETS
from tests.eds.vendor_files import FILES, both, eds_of, facts_of, needs_files, path_of
from tests.protocols.canopen.test_from_eds import UNUSABLE, USABLE

NODE = 5
EVERY = both(SHEETS, FILES)

FAULTS = {name: sheet.faults for name, sheet in SHEETS.items()} | {
    "elmo_gold_drive.dcf": ["CompactPDO", "a comment after a value"],
    "eyou_yiyouservo_v1_4.eds": ["does not fit into UNSIGNED16"],
    "faulhaber_605_3150_55_d.eds": ["octet 94h is no UTF-8: the file is read as Windows-1252"],
    "igus_dryve_d1.eds": ["CompactPDO"],
    "orientalmotor_blvd_krd_v400.eds": ['"-1" does not fit into UNSIGNED32'],
    "pilz_prbt_0_1.dcf": ["8, but the file has 1 sub-indices", "4, but the file has 3 sub-indices"],
    "schunk_erb415_ros.eds": ["is in no list of objects"],
}
"""Files in which something is wrong, and what; found by looking into each."""


def at_node(value: EdsValue | None) -> object:
    return value.at(NODE) if isinstance(value, NodeOffset) else value


def test_every_peculiarity_stands_in_a_file() -> None:
    assert {each for sheet in SHEETS.values() for each in sheet.peculiarities} == PECULIARITIES.keys()


@pytest.mark.parametrize("name", EVERY)
def test_every_file_loads_and_its_faults_are_those_known(name: str) -> None:
    eds = eds_of(name)
    told = [str(fault) for fault in eds.faults]
    if told and name not in {*USABLE, *UNUSABLE}:
        pytest.skip(f"mistakes of a file that no table names: {told}")
    for words in FAULTS.get(name, []):
        assert any(words in text for text in told)
    assert all(any(words in text for words in FAULTS.get(name, [])) for text in told)
    assert all(fault.line for fault in eds.faults)


@needs_files
@pytest.mark.parametrize("name", FILES)
def test_the_same_objects_are_found_as_by_another_reader(name: str) -> None:
    eds = eds_of(name)
    line = facts_of(name).line("Objects")
    for word in line.partition(": ")[2].partition(";")[0].split():
        index, absent = re.fullmatch(r"0x([0-9A-F]{4})(\(-\))?\.?", word).groups()  # type: ignore[union-attr]
        assert (int(index, 16) in eds) is not bool(absent), word


@needs_files
@pytest.mark.parametrize("name", FILES)
def test_the_supported_modes_are_those_another_reader_found(name: str) -> None:
    line = facts_of(name).line("Modes").partition(": ")[2]
    entry = eds_of(name).find(0x6502)
    if line.startswith("object absent"):
        assert entry is None
    elif line.startswith("no default"):
        assert entry is not None
        assert entry.value(NODE) is None
    else:
        assert entry is not None
        assert entry.value(NODE) == int(line.split()[0], 0)


@needs_files
@pytest.mark.parametrize("name", FILES)
def test_identity_and_bit_rates_are_those_another_reader_found(name: str) -> None:
    eds, text = eds_of(name), facts_of(name)
    found = re.search(r"vendor=(\S+) product=(\S+) \((.*?)\); 1018sub1=(\S+) 1018sub2=(\S+);", text.line("Ids"))
    assert found is not None
    device = eds.device
    subs = [entry.value(NODE) if (entry := eds.find(0x1018, sub)) is not None else None for sub in (1, 2)]
    for read, said in zip([device.vendor_number, device.product_number, *subs], found.group(1, 2, 4, 5), strict=True):
        assert read == (None if said == "None" else int(said, 0))
    if found[3] != "None":
        assert device.product_name == found[3]
    rates = re.search(r"Bit rates \(kbit/s\): ([\d ]*)", text.line("PDOs"))
    assert rates is not None
    assert device.bit_rates == tuple(map(int, rates[1].split()))


@pytest.mark.parametrize("name", EVERY)
def test_the_object_dictionary_is_that_of_canopen_where_canopen_can_read_it(name: str) -> None:
    """Entry by entry: name, type, access, mappability, default, configured value, limits."""
    try:
        logging.disable(logging.CRITICAL)
        dictionary = canopen.import_od(str(path_of(name)), NODE)
    except UnicodeDecodeError:
        assert name in ("fixed_mappings.eds", "faulhaber_605_3150_55_d.eds")
        return
    finally:
        logging.disable(logging.NOTSET)
    theirs = [variable for variable in _variables(dictionary) if variable.index >= 0x1000]
    ours = {(entry.index, entry.subindex): entry for entry in eds_of(name)}
    assert {(variable.index, variable.subindex) for variable in theirs} == set(ours)
    for variable in theirs:
        _compare(ours[variable.index, variable.subindex], variable)


def _variables(dictionary: canopen.ObjectDictionary) -> list[Any]:
    found: list[Any] = []
    for item in dictionary.values():
        found += [item] if isinstance(item, ODVariable) else list(item.values())
    return found


def _compare(entry: EdsEntry, variable: Any) -> None:
    where = f"{entry.index:04X}h:{entry.subindex:02X}"
    assert entry.type == variable.data_type, where
    assert entry.access == variable.access_type, where
    assert entry.name == variable.name, where
    assert entry.mappable is bool(variable.pdo_mappable), where
    for mine, other in (
        (at_node(entry.default), variable.default),
        (at_node(entry.parameter), variable.value),
        (entry.low, variable.min),
        (entry.high, variable.max),
    ):
        assert mine == other or _explained(entry, mine, other), f"{where}: {mine} {other}"


def _explained(entry: EdsEntry, ours: object, theirs: object) -> bool:
    """Where canopen is known to differ: reals in hexadecimal, two's complement, values outside of their type."""
    if entry.type is EdsType.REAL32:
        return isinstance(ours, float) and math.isfinite(ours) and not isinstance(theirs, float)
    if not theirs and ours is None:
        return True
    assert entry.type is not None
    if entry.type.limits is None or not isinstance(theirs, int):
        return False
    low, high = entry.type.limits
    return not low <= theirs <= high and (ours is None or ours == theirs - (1 << 8 * (entry.type.size or 0)))


@pytest.mark.parametrize("name", both(["positions.eds"], ["xeryon_xla_5.eds"]))
def test_reals_in_hexadecimal_are_read_which_canopen_drops(name: str) -> None:
    entry = eds_of(name).find(0x2013, name not in SHEETS)
    assert entry is not None
    assert entry.default == 250.0


@pytest.mark.parametrize("name", both(["cyclic_torque.dcf"], ["delta_asda_a2.eds"]))
def test_a_configured_value_goes_before_the_default(name: str) -> None:
    """`ParameterValue` in an EDS: the transmission type of RPDO1 is 1, not its default 255."""
    entry = eds_of(name).find(0x1400, 2)
    assert entry is not None
    assert (entry.default, entry.parameter, entry.value(NODE)) == (255, 1, 1)


@pytest.mark.parametrize("name", EVERY)
def test_what_is_written_is_read_back_the_same(name: str) -> None:
    eds = eds_of(name)
    again = read_eds(eds_text(eds).encode(), name)
    assert again.faults == ()
    assert list(map(_content, again)) == [_content(_written(entry)) for entry in eds]
    assert again.dummies == eds.dummies


def _content(entry: EdsEntry) -> tuple[object, ...]:
    return (
        *(entry.index, entry.subindex, entry.name, entry.type, entry.access),
        *(entry.default, entry.parameter, entry.low, entry.high, entry.mappable),
    )


def _written(entry: EdsEntry) -> EdsEntry:
    """Limits that some value of the entry breaks at some node-ID are not written: dcf-tools refuse the whole file."""
    formulas = [each for each in (entry.default, entry.parameter) if each is not None]
    values = [each.at(node) if isinstance(each, NodeOffset) else each for each in formulas for node in (1, 127)]
    numbers = [value for value in values if isinstance(value, int | float)]
    return replace(
        entry,
        low=entry.low if entry.low is None or all(entry.low <= value for value in numbers) else None,
        high=entry.high if entry.high is None or all(value <= entry.high for value in numbers) else None,
    )
