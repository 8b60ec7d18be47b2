"""What files of each protocol may say, for editors."""

import pytest

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.catalogue import bus_schema, profile_schema, rig_schema
from haptic_fieldbus.protocols.registry import BUILT_IN, protocol_named


@pytest.mark.parametrize("protocol", BUILT_IN)
def test_a_profile_has_the_sections_of_its_protocol(protocol: str) -> None:
    schema = profile_schema(protocol)
    assert {"drive", "identity"} <= schema["properties"].keys()
    assert "name" not in schema["properties"], "a profile is named by its file"


def test_a_bus_of_a_rig_is_one_of_any_protocol_of_ours() -> None:
    assert rig_schema()["$defs"]["BusSection"] == {"anyOf": [bus_schema(protocol) for protocol in BUILT_IN]}
    assert "bitrate" in bus_schema("canopen")["properties"]


def test_a_protocol_that_nobody_knows_is_refused_with_the_nearest() -> None:
    with pytest.raises(UsageError, match='no protocol "canopne"; nearest: canopen'):
        protocol_named("canopne")
