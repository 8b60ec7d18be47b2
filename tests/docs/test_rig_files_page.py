"""The rig that docs/reference/rig_files.md shows works as it stands there, and the page has every key of the schema."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import haptic_fieldbus
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.catalogue import rig_schema
from haptic_fieldbus.protocols.modbus.bus import modbus_section

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "rig_files.md").read_text(encoding="utf-8")
SHOWN, DAEMON, LINES, KNOWN = re.findall(r"^```toml\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_the_rig_that_is_shown_renders_a_wall(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(SHOWN, encoding="utf-8")
    result = haptic_fieldbus.run("wall", rig=path, bus="sim", duration=1.5)
    assert result.trips == ()
    assert (result.verdict or "").startswith("Feels right")


def test_the_knowledge_that_is_shown_lets_values_pass_that_are_refused_without_it(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    heavy = SHOWN.replace("inertia = 6.0e-5", "inertia = 3.0").replace("revolution = 0.05", "revolution = 6.0")
    path.write_text(heavy, encoding="utf-8")
    with pytest.raises(haptic_fieldbus.RigError) as raised:
        haptic_fieldbus.load_rig(path)
    assert len(raised.value.faults) == 2
    path.write_text(heavy.replace("inertia = 3.0", f"inertia = 3.0\n{KNOWN}"), encoding="utf-8")
    assert haptic_fieldbus.load_rig(path).axis["handle"].inertia == 3.0


def test_the_adapter_that_is_shown_is_a_bus_of_a_rig(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(DAEMON + SHOWN.replace('"can0"\nnode', '"desk"\nnode'), encoding="utf-8")
    section = haptic_fieldbus.load_rig(path).bus["desk"]
    assert isinstance(section, CanSection)
    assert section.arguments["port"] == 29536


def test_the_modbus_lines_that_are_shown_are_buses_of_a_rig(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(LINES + SHOWN, encoding="utf-8")
    rig = haptic_fieldbus.load_rig(path)
    assert modbus_section(rig.bus["line"]).silence == 0.3e-3
    assert modbus_section(rig.bus["network"]).address == ("192.168.0.10", 502)


def keys(schema: dict[str, Any]) -> Iterator[str]:
    """Every key of every table, but the tables."""
    whole = (*schema["$defs"].values(), *schema["$defs"]["BusSection"]["anyOf"])
    for table in whole:
        for key, node in table.get("properties", {}).items():
            if "$ref" not in str(node):
                yield key


def test_every_key_of_the_schema_has_its_line() -> None:
    listed = set(re.findall(r"^\| `([^`]+)`", TEXT, re.MULTILINE))
    known = set(keys(rig_schema()))
    assert len(known) > 40
    assert listed == known
