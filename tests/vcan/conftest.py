"""Interfaces of SocketCAN for tests marked `vcan`: see plugin.py."""

from collections.abc import Iterator

import pytest

from tests.vcan.links import Link
from tests.vcan.plugin import INTERFACES


@pytest.fixture
def vcan() -> Iterator[Link]:
    """The first interface, up; it is up again afterwards."""
    yield from _link(INTERFACES[0])


@pytest.fixture
def second_vcan() -> Iterator[Link]:
    """The second interface, up; it is up again afterwards."""
    yield from _link(INTERFACES[1])


def _link(name: str) -> Iterator[Link]:
    link = Link(name)
    yield link
    if not link.is_up:
        link.up()
