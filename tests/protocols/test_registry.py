"""Protocols by name, and what is said where a part of another protocol is handed over."""

from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.drive.rig import BusSection, default_axis
from haptic_fieldbus.errors import ProfileError, UsageError
from haptic_fieldbus.protocols.canopen.bus import CanSection, can_section
from haptic_fieldbus.protocols.canopen.protocol import PROTOCOL
from haptic_fieldbus.protocols.protocol import FieldbusProtocol
from haptic_fieldbus.protocols.registry import BUILT_IN, TRAFFIC_KEYS, WORDS, parse_bus, protocol_named
from haptic_fieldbus.signals import Workspace
from tests.builders import PROFILE
from tests.cases import every

PLUGIN = Path(__file__).parent / "plugin"


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_protocol_of_ours_is_found_by_the_name_that_it_has(name: str) -> None:
    assert protocol_named(name).name == protocol_named(name).section.protocol == name


def test_every_protocol_that_is_ours_has_a_key_in_the_json_of_a_plan() -> None:
    assert set(TRAFFIC_KEYS) == set(BUILT_IN)


@pytest.mark.parametrize("word", WORDS)
def test_a_word_of_a_bus_name_belongs_to_its_protocol(word: str) -> None:
    channel = "" if word.startswith("sim-") else ":somewhere"
    assert parse_bus(word + channel).section.protocol == WORDS[word]


class TestMixedUp:
    """A drive, a bus or a traffic of another protocol, as a program could hand them over."""

    @pytest.fixture(autouse=True)
    def _toy(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.syspath_prepend(str(PLUGIN))

    def toy(self) -> FieldbusProtocol:
        return protocol_named("toy")

    def test_a_bus_of_another_protocol_is_no_can_bus(self) -> None:
        with pytest.raises(TypeError, match="toy:toy is not a CAN bus"):
            can_section(parse_bus("toy").section)
        with pytest.raises(UsageError, match='bus "toy" is not a CAN bus, but socketcan:can0 of the rig is'):
            PROTOCOL.in_place_of(CanSection("socketcan", "can0"), parse_bus("toy"), None)

    def test_a_bus_that_is_named_takes_the_place_of_one_of_a_rig(self) -> None:
        named = parse_bus("toy")
        assert self.toy().in_place_of(BusSection("toy", "bench"), named, None) is named.section

    def test_a_drive_of_another_protocol_is_no_canopen_drive(self) -> None:
        from haptic_fieldbus.protocols.catalogue import load_profile

        toy = load_profile(PLUGIN / "toy_drive.toml")
        axis = default_axis(Workspace.LINEAR, bus="b", node=1, profile="toy")
        with pytest.raises(UsageError, match="toy works Mover uses toy; expected a CANopen drive"):
            PROTOCOL.axis_traffic(axis, CanSection("haptic_sim", "sim"), toy, (), ())
        traffic = self.toy().axis_traffic(axis, parse_bus("toy").section, toy, (), ())
        with pytest.raises(TypeError, match="expected PDOs, not ToyAxis"):
            PROTOCOL.bus_traffic(CanSection("haptic_sim", "sim"), {"handle": (PROFILE, traffic)}, 1000.0, 0.0)

    def test_a_protocol_without_vendors_files_says_so(self) -> None:
        with pytest.raises(ProfileError, match=r"drive\.eds: toy reads no vendors' files"):
            self.toy().vendor_profile("drive.eds")


@every(
    ("text", "rate"),
    [
        ("sim@1M", 1_000_000),
        ("sim@500k", 500_000),
        ("sim@0.5M", 500_000),
        ("sim@250kbit/s", 250_000),
        ("socketcan:can0@125k", 125_000),
        ("haptic_sim:maxon_epos4@5@500k", 500_000),
        ("sim-modbus-rtu@115.2k", 115_200),
        ("modbus-rtu:/dev/ttyUSB0@1M", 1_000_000),
    ],
)
def test_a_bit_rate_may_have_its_prefix(text: str, rate: int) -> None:
    section: Any = parse_bus(text).section
    assert (section.bitrate if isinstance(section, CanSection) else section.baud) == rate


@every("text", ["sim@1m", "sim@1 M", "sim@M", "sim@1G", "sim@0.3k1", "sim@" + "9" * 5000])
def test_another_spelling_of_a_bit_rate_is_refused_with_one_that_is_understood(text: str) -> None:
    with pytest.raises(UsageError, match=r"expected the bit rate in bit/s after @, for example @500000, @500k or @1M$"):
        parse_bus(text)
