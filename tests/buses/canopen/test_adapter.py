"""Checks of an adapter, from what Linux tells of it: each fault with what to do."""

import json
from pathlib import Path

import pytest

from haptic_fieldbus.buses.canopen.opening import adapter_checks, shown_by_ip
from haptic_fieldbus.buses.scan_result import Check
from haptic_fieldbus.protocols.canopen.bus import CanSection

CAN0 = CanSection("socketcan", "can0", 500_000)
UP = {
    "ifname": "can0",
    "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"],
    "txqlen": 10,
    "linkinfo": {
        "info_kind": "can",
        "info_data": {
            "state": "ERROR-ACTIVE",
            "restart_ms": 100,
            "bittiming": {"bitrate": 500000, "sample_point": "0.875"},
            "berr_counter": {"tx": 0, "rx": 0},
        },
    },
}
"""As `ip -details -json link show can0` of iproute2 6.1 prints it; keys that nobody reads are left out."""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A /sys with can0 of a gs_usb adapter, and a serial port."""
    net = tmp_path / "class" / "net" / "can0"
    (net / "device").mkdir(parents=True)
    (tmp_path / "drivers" / "gs_usb").mkdir(parents=True)
    (net / "device" / "driver").symlink_to(tmp_path / "drivers" / "gs_usb")
    (net / "tx_queue_len").write_text("10\n")
    port = tmp_path / "bus" / "usb-serial" / "devices" / "ttyUSB0"
    port.mkdir(parents=True)
    (port / "latency_timer").write_text("16\n")
    return tmp_path


def checked(section: CanSection, root: Path, told: object = None) -> dict[str, Check]:
    text = json.dumps([UP if told is None else told])
    return {check.name: check for check in adapter_checks(section, root, lambda channel: text)}


def test_an_interface_that_is_well_is_so_and_its_short_queue_has_advice(root: Path) -> None:
    checks = checked(CAN0, root)
    assert {name: check.ok for name, check in checks.items()} == {
        "driver": True, "state": True, "bit_rate": True, "queue": False, "usb_latency_timer": None,
    }  # fmt: skip
    assert checks["driver"].measured == "gs_usb"
    assert checks["queue"].measured == "10 frames"
    assert "ip link set can0 txqueuelen 1000" in checks["queue"].advice
    rule = 'ACTION=="add", SUBSYSTEM=="net", KERNEL=="can0", ATTR{tx_queue_len}="1000"'
    assert rule in checks["queue"].advice
    (root / "class" / "net" / "can0" / "tx_queue_len").write_text("1000\n")
    assert checked(CAN0, root)["queue"] == Check("queue", True, "1000 frames")


def test_an_interface_that_is_down_is_brought_up_at_the_bit_rate_of_the_rig(root: Path) -> None:
    state = checked(CAN0, root, {**UP, "flags": ["NOARP", "ECHO"]})["state"]
    assert state.ok is False
    assert "ip link set can0 up type can bitrate 500000 restart-ms 100" in state.advice


@pytest.mark.parametrize("state", ["ERROR-WARNING", "ERROR-PASSIVE", "BUS-OFF", "STOPPED"])
def test_a_controller_that_is_not_well_points_at_wires(state: str, root: Path) -> None:
    data = {**UP["linkinfo"]["info_data"], "state": state}  # type: ignore[index]
    found = checked(CAN0, root, {**UP, "linkinfo": {"info_kind": "can", "info_data": data}})["state"]
    assert found.ok is False
    assert "120 Ω" in found.advice


def test_another_bit_rate_is_told_with_the_line_that_sets_it(root: Path) -> None:
    rate = checked(CanSection("socketcan", "can0", 1_000_000), root)["bit_rate"]
    assert (rate.ok, rate.measured) == (False, "500000 bit/s, requested 1000000")
    assert "bitrate 1000000" in rate.advice


def test_an_interface_that_is_not_there_is_named(root: Path) -> None:
    checks = checked(CanSection("socketcan", "can7"), root, {})
    assert checks["driver"].ok is False
    assert "no interface can7" in checks["driver"].measured
    assert checks["state"].ok is None
    assert checks["queue"].ok is None


@pytest.mark.parametrize("text", ["", "[]", "{}", "[1]", "no json", '[{"linkinfo": {}}]'])
def test_whatever_ip_prints_is_taken(text: str, root: Path) -> None:
    assert len(list(adapter_checks(CAN0, root, lambda channel: text))) == 5


def test_a_virtual_interface_has_no_bits(root: Path) -> None:
    checks = checked(CAN0, root, {**UP, "linkinfo": {"info_kind": "vcan"}})
    assert checks["state"].ok is True
    assert (checks["bit_rate"].ok, "virtual" in checks["bit_rate"].measured) == (None, True)


@pytest.mark.parametrize("interface", ["slcan", "robotell"])
def test_the_latency_timer_of_a_serial_adapter_has_its_udev_rule(interface: str, root: Path) -> None:
    section = CanSection(interface, "/dev/ttyUSB0@115200")
    timer = checked(section, root)["usb_latency_timer"]
    assert (timer.ok, timer.measured) == (False, "16 ms")
    assert 'SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"' in timer.advice
    for milliseconds, fits in (("2", False), ("1", True)):
        (root / "bus" / "usb-serial" / "devices" / "ttyUSB0" / "latency_timer").write_text(f"{milliseconds}\n")
        assert checked(section, root)["usb_latency_timer"].ok is fits
    assert checked(CanSection(interface, "/dev/ttyACM0"), root)["usb_latency_timer"].ok is None


def test_ip_tells_nothing_of_what_is_not_there() -> None:
    assert shown_by_ip("no_such_can") == ""
