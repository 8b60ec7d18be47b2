"""A protocol that can neither scan nor be watched says so; its adapter has no checks of its own."""

import pytest

from haptic_fieldbus.errors import UsageError
from tests.protocols.plugin.toy_fieldbus import ToyAccess, ToySection

SECTION = ToySection("toy", "wire")


def test_what_a_protocol_lacks_is_told() -> None:
    with pytest.raises(UsageError, match="toy buses cannot be scanned"):
        ToyAccess().scan(SECTION, {}, None)
    with pytest.raises(UsageError, match="drives on toy buses cannot be watched"):
        ToyAccess().onlooker(SECTION, {})
    assert ToyAccess().checks(SECTION, {}, 1000.0) == ()
