"""Rig files: a complete one is read as it stands, and each way to be wrong is told."""

import contextlib
from pathlib import Path
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.drive.rig import ByKind, LinearMechanism, Rig, RotaryMechanism
from haptic_fieldbus.errors import DocumentError, RigError
from haptic_fieldbus.protocols.canopen.bus import Argument, CanSection
from haptic_fieldbus.protocols.catalogue import load_profile, load_rig, profile_folder
from haptic_fieldbus.signals import Workspace

COMPLETE = """\
[bus.can0]
interface = "socketcan"
channel = "can0"
bitrate = 500_000
[axis.handle]
bus = "can0"
node = 5
profile = "maxon_epos4"
rated_torque = 0.1
encoder_counts_per_revolution = 4096
inertia = 6.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3
on_link_loss = "free"
[axis.handle.mechanism]
kind = "linear"
metres_per_revolution = 0.05
sign = -1
zero = "start"
[axis.handle.limits]
effort = 8
speed = 1.0
position = [-0.10, 0.10]
[axis.knob]
bus = "can0"
node = 6
profile = "generic_cia402"
encoder_counts_per_revolution = 2000
mechanism = { kind = "rotary", gear_ratio = 4, zero = 120 }
"""


def test_of_a_faulty_mechanism_the_kind_alone_says_what_it_is_held_against() -> None:
    mechanism: TypeAdapter[object] = TypeAdapter(Annotated[LinearMechanism | RotaryMechanism, ByKind()])
    assert mechanism.validate_python({"kind": "rotary"}) == RotaryMechanism("rotary")
    with pytest.raises(ValidationError) as caught:
        mechanism.validate_python({"kind": "linear"})
    assert [error["loc"] for error in caught.value.errors()] == [("linear", "metres_per_revolution")]


def write(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def faults_of(folder: Path, *replacements: tuple[str, str]) -> list[str]:
    text = COMPLETE
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new, 1)
    with pytest.raises(RigError) as caught:
        load_rig(write(folder, text))
    return [str(fault) for fault in caught.value.faults]


def read(folder: Path, text: str = COMPLETE) -> Rig:
    return load_rig(write(folder, text))


def test_a_complete_rig_is_read_as_it_stands(tmp_path: Path) -> None:
    rig = read(tmp_path)
    assert rig.source == str(tmp_path / "rig.toml")
    assert rig.bus["can0"] == CanSection("socketcan", "can0", 500_000)
    handle, knob = rig.axis["handle"], rig.axis["knob"]
    assert isinstance(handle.mechanism, LinearMechanism)
    assert handle.mechanism.sign == -1
    assert handle.mechanism.workspace is Workspace.LINEAR
    assert handle.limits.position == (-0.10, 0.10)
    assert isinstance(handle.limits.effort, float)
    assert isinstance(knob.mechanism, RotaryMechanism)
    assert knob.mechanism.zero == 120


def test_what_a_rig_leaves_out_is_unknown(tmp_path: Path) -> None:
    knob = read(tmp_path).axis["knob"]
    assert (knob.rated_torque, knob.inertia, knob.viscous_damping) == (None, None, None)
    assert (knob.limits.effort, knob.limits.speed, knob.limits.position) == (None, None, None)


def test_a_channel_may_be_a_number_and_an_interface_have_arguments(tmp_path: Path) -> None:
    text = COMPLETE.replace(
        'interface = "socketcan"\nchannel = "can0"',
        'interface = "slcan"\nchannel = 0\narguments = { ttyBaudrate = 115200, timeout = 0.5, rtscts = true, x = "y" }',
    )
    section = read(tmp_path, text).bus["can0"]
    arguments: dict[str, Argument] = {"ttyBaudrate": 115_200, "timeout": 0.5, "rtscts": True, "x": "y"}
    assert section == CanSection("slcan", "0", 500_000, arguments=arguments)
    assert [type(value) for value in arguments.values()] == [int, float, bool, str]


def test_a_profile_given_as_a_path_is_found_beside_the_rig(tmp_path: Path) -> None:
    text = (profile_folder() / "maxon_epos4.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    rig = read(tmp_path, COMPLETE.replace('"maxon_epos4"', '"mine.toml"'))
    assert load_profile(rig.axis["handle"].profile).name == "mine"
    assert rig.axis["knob"].profile == "generic_cia402"


def test_axes_on_different_buses_may_have_the_same_node(tmp_path: Path) -> None:
    second = '[bus.can1]\ninterface = "socketcan"\nchannel = "can1"\n'
    text = second + COMPLETE.replace('bus = "can0"\nnode = 6', 'bus = "can1"\nnode = 5')
    assert {axis.node for axis in read(tmp_path, text).axis.values()} == {5}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "bitrate = 500_000",
            'bitrate = "500k"',
            'line 4: bus.can0.bitrate: "500k"; expected a bit rate in bit/s; unknown unit; '
            "known: Mbit/s, bit/s, kbit/s",
        ),
        ('channel = "can0"', "", "line 1: bus.can0.channel: missing; expected a non-empty string"),
        ('bus = "can0"', 'bus = "cann0"', "line 6: axis.handle.bus: no [bus.cann0] in this file; nearest: can0"),
        (
            "bitrate = 500_000",
            "arguments = { bitrate = 500_000 }",
            "line 4: bus.can0.arguments: bitrate belongs to the bus itself; move it one table up",
        ),
        (
            "bitrate = 500_000",
            "arguments = { receive_own_messages = true }",
            "line 4: bus.can0.arguments: receive_own_messages would make the master receive its own "
            "frames as those of another master; remove it",
        ),
        (
            "bitrate = 500_000",
            "arguments = { x = [1] }",
            "line 4: bus.can0.arguments.x: [1]; expected true or false or a whole number or a number or a string",
        ),
        ('channel = "can0"', "channel = -1", "line 3: bus.can0.channel: -1; expected a non-empty string"),
        ("node = 5", "node = 128", "line 7: axis.handle.node: 128; expected a whole number from 1 to 127"),
        (
            "node = 6",
            "node = 5",
            "line 26: axis.knob.node: 5 is already the node-ID of axis handle on can0; expected another one",
        ),
        (
            '"maxon_epos4"',
            '"maxon_epos5"',
            'line 8: axis.handle.profile: no profile "maxon_epos5"; nearest: maxon_epos4, maxon_epos2',
        ),
        (
            '"maxon_epos4"',
            '"sub/mine.toml"',
            'line 8: axis.handle.profile: no file "sub/mine.toml" in the folder of this file',
        ),
        ('"maxon_epos4"', "4", "line 8: axis.handle.profile: 4; expected a string"),
        (
            "inertia = 6.0e-5",
            "inertia = 0",
            "line 11: axis.handle.inertia: 0; expected a number from 1e-12 to 1e6",
        ),
        (
            "[axis.handle.limits]",
            "gear_ratio = 2\n[axis.handle.limits]",
            "line 20: axis.handle.mechanism.gear_ratio: unknown key; known: kind, metres_per_revolution, sign, zero",
        ),
        (
            "metres_per_revolution = 0.05",
            "",
            "line 15: axis.handle.mechanism.metres_per_revolution: missing; expected a number from 1e-6 to 1000",
        ),
        (
            'kind = "linear"',
            'kind = "linaer"',
            'line 16: axis.handle.mechanism.kind: "linaer"; expected "linear" or "rotary"; nearest: linear',
        ),
        (
            'kind = "linear"',
            "",
            'line 15: axis.handle.mechanism.kind: missing; expected "linear" or "rotary"',
        ),
        ("sign = -1", "sign = 0", "line 18: axis.handle.mechanism.sign: 0; expected -1 or 1"),
        ("sign = -1", "sign = true", "line 18: axis.handle.mechanism.sign: true; expected a whole number"),
        ("sign = -1", "sign = -1.0", "line 18: axis.handle.mechanism.sign: -1.0; expected a whole number"),
        (
            'zero = "start"',
            'zero = "end"',
            'line 19: axis.handle.mechanism.zero: "end"; '
            'expected "start" or a whole number from -2147483648 to 2147483647',
        ),
        (
            "effort = 8",
            "effort = inf",
            "line 21: axis.handle.limits.effort: inf; expected a number from 1e-9 to 1e9",
        ),
        (
            "[-0.10, 0.10]",
            "[0.10, -0.10]",
            "line 23: axis.handle.limits.position: [0.10, -0.10]; expected the lower limit first",
        ),
        (
            "[-0.10, 0.10]",
            "[0, 0]",
            "line 23: axis.handle.limits.position: [0, 0]; expected the lower limit first",
        ),
        (
            "[-0.10, 0.10]",
            "[0.03, 0.10]",
            "line 23: axis.handle.limits.position: [0.03, 0.10]; expected a travel that contains 0, which is the place "
            "of the handle when the drive is enabled; for another zero state mechanism.zero, an encoder count",
        ),
        (
            "[-0.10, 0.10]",
            '["a", 0.10]',
            'line 23: axis.handle.limits.position[0]: "a"; expected a number without quotes, '
            'or one with its unit such as "2 m"',
        ),
        (
            '{ kind = "rotary", gear_ratio = 4, zero = 120 }',
            "4",
            "line 29: axis.knob.mechanism: 4; expected a table with kind, metres_per_revolution, sign and zero"
            " or a table with kind, gear_ratio, sign and zero",
        ),
    ],
)
def test_a_fault_is_told_with_key_and_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert faults_of(tmp_path, (old, new)) == [message]


def test_faults_of_values_and_of_rules_are_told_together(tmp_path: Path) -> None:
    faults = faults_of(tmp_path, ("inertia = 6.0e-5", "inertia = -1"), ("node = 6", "node = 5"))
    assert [fault.partition(":")[0] for fault in faults] == ["line 11", "line 26"]


def test_a_rig_needs_a_bus_and_an_axis(tmp_path: Path) -> None:
    with pytest.raises(RigError) as caught:
        load_rig(write(tmp_path, "axis = {}"))
    assert [str(fault) for fault in caught.value.faults] == [
        "line 1: axis: {}; expected a non-empty table",
        "bus: missing; expected a non-empty table",
    ]


def test_a_file_cannot_say_where_it_was_read_from(tmp_path: Path) -> None:
    assert faults_of(tmp_path, ("[bus.can0]", 'source = "x"\n[bus.can0]')) == [
        "line 1: source: unknown key; known: axis, bus"
    ]


@given(
    st.text() | st.text(alphabet='axisbu_[]{}=".\n1') | st.lists(st.sampled_from(COMPLETE.splitlines())).map("\n".join)
)
def test_garbage_raises_nothing_but_a_document_error(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = write(tmp_path_factory.getbasetemp(), text)
    with contextlib.suppress(DocumentError):
        load_rig(path)


def test_of_a_bus_without_a_usable_interface_no_range_of_node_ids_is_told(tmp_path: Path) -> None:
    (fault,) = faults_of(tmp_path, ('interface = "socketcan"', "interface = 5"), ("node = 5", "node = 200"))
    assert fault == "line 2: bus.can0.interface: 5; expected a non-empty string"


def test_a_bus_of_another_protocol_has_the_keys_of_that_protocol(tmp_path: Path) -> None:
    (fault,) = faults_of(tmp_path, ('interface = "socketcan"', 'interface = "modbus-tcp"'))
    assert fault.startswith("line 4: bus.can0.bitrate: unknown key")
