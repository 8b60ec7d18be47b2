import math
import os
from contextlib import suppress
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.buses.writing import FRAME_SUFFIXES
from haptic_fieldbus.defaults import DEFAULT_BIT_RATE
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.planning.request import (
    RECORD_SUFFIXES,
    check_fade_in,
    check_request,
    file_faults,
    parse_changes,
    parse_settings,
)
from haptic_fieldbus.protocols.canopen.bus import (
    BITRATES,
    SIMULATION_INTERFACE,
    CanSection,
    can_interfaces,
    can_section,
)
from haptic_fieldbus.protocols.registry import parse_bus
from haptic_fieldbus.running.rows import ROW_SUFFIXES


def test_every_kind_of_recording_can_be_asked_for() -> None:
    assert RECORD_SUFFIXES == FRAME_SUFFIXES + ROW_SUFFIXES


def test_every_interface_of_python_can_is_known() -> None:
    assert set(can.VALID_INTERFACES) - {SIMULATION_INTERFACE} == set(can_interfaces())


@pytest.mark.parametrize(
    ("text", "interface", "channel", "bitrate", "known"),
    [
        ("socketcan:can0", "socketcan", "can0", DEFAULT_BIT_RATE, False),
        ("socketcan:vcan0@500000", "socketcan", "vcan0", 500_000, True),
        ("udp_multicast:239.74.163.2", "udp_multicast", "239.74.163.2", DEFAULT_BIT_RATE, False),
        ("udp_multicast:ff15:7079::1", "udp_multicast", "ff15:7079::1", DEFAULT_BIT_RATE, False),
        ("pcan:PCAN_USBBUS1@1000000", "pcan", "PCAN_USBBUS1", 1_000_000, True),
        ("slcan:/dev/ttyUSB0@125000", "slcan", "/dev/ttyUSB0", 125_000, True),
        ("virtual:a@b@10000", "virtual", "a@b", 10_000, True),
    ],
)
def test_a_can_bus_is_interface_channel_and_bit_rate(
    text: str, interface: str, channel: str, bitrate: int, known: bool
) -> None:
    bus = parse_bus(text)
    assert bus.section == CanSection(interface, channel, bitrate)
    assert (bus.assumed == "") is known
    assert not bus.simulated
    assert bus.text == text


@pytest.mark.parametrize(
    ("text", "channel", "arguments"),
    [
        ("socketcand:can0@500000,host=192.168.1.20,port=29536", "can0", {"host": "192.168.1.20", "port": 29536}),
        ("slcan:/dev/ttyACM0@500000,ttyBaudrate=115200,listen_only=true", "/dev/ttyACM0",
         {"ttyBaudrate": 115200, "listen_only": True}),
        ("vector:0,1@500000,app_name=a=b,poll_interval=0.5", "0,1", {"app_name": "a=b", "poll_interval": 0.5}),
    ],
)  # fmt: skip
def test_what_an_interface_takes_beyond_the_channel_follows_behind_commas(
    text: str, channel: str, arguments: dict[str, object]
) -> None:
    bus = parse_bus(text)
    assert bus.section == CanSection(text.partition(":")[0], channel, 500_000, arguments=arguments)  # type: ignore[arg-type]
    assert bus.text == text


def test_a_bit_rate_that_is_not_given_is_asked_for_before_the_arguments() -> None:
    assert parse_bus("socketcand:can0,port=29536").assumed.endswith("Write it as socketcand:can0@BITRATE")


@pytest.mark.parametrize(("text", "bitrate"), [("sim", DEFAULT_BIT_RATE), ("sim@500000", 500_000)])
def test_the_simulated_bus_has_a_bit_rate_that_is_known(text: str, bitrate: int) -> None:
    bus = parse_bus(text)
    assert bus.simulated
    assert not bus.assumed
    assert bus.section == CanSection(SIMULATION_INTERFACE, "sim", bitrate)


@pytest.mark.parametrize(
    ("text", "channel", "bitrate"),
    [
        ("haptic_sim:bench", "bench", DEFAULT_BIT_RATE),
        ("haptic_sim:maxon_epos4@5", "maxon_epos4@5", DEFAULT_BIT_RATE),
        ("haptic_sim:maxon_epos4@5,generic_cia402@6@250000", "maxon_epos4@5,generic_cia402@6", 250_000),
    ],
)
def test_a_rig_may_name_the_simulation_by_its_interface(text: str, channel: str, bitrate: int) -> None:
    bus = parse_bus(text)
    assert bus.simulated
    assert bus.section == CanSection(SIMULATION_INTERFACE, channel, bitrate)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("simm", "nearest: sim"),
        ("socketcna:can0", "nearest: socketcan"),
        ("can0", "nearest: socketcan:can0"),
        ("vcan1@500000", "nearest: socketcan:vcan1@500000"),
        ("socketcan", "has no channel"),
        (
            "socketcan:can0,receive_own_messages=true",
            "receive_own_messages would make the master receive its own frames",
        ),
        ("socketcan:", "has no channel"),
        ("socketcan:@500000", "has no channel"),
        ("sim:1", "write sim[@BITRATE]"),
        ("sim@", "expected the bit rate in bit/s after @"),
        ("sim@fast", "expected the bit rate in bit/s after @"),
        ("sim@-500000", "expected the bit rate in bit/s after @"),
        ("sim@9600", "for CAN"),
        ("pcan:PCAN_USBBUS1@5000000", "for CAN"),
        ("haptic_sim:bench@5000000", "for CAN"),
        ("", 'no bus ""'),
        ("modbus:192.168.0.2:502", "modbus-tcp:HOST[:PORT]"),
        ("modbus-tcp", "has no channel"),
        ("modbus-tcp:192.168.0.2:port", "expected a port after the host, 1 to 65535"),
        ("modbus-rtu:/dev/ttyUSB0@fast", "the bit rate in bit/s"),
        ("sim-modbus-rtu@5", "1200 to 20000000"),
        ("sim-modbus-tcp:bench", "has no channel"),
    ],
)
def test_a_wrong_bus_is_answered_with_what_was_expected(text: str, sentence: str) -> None:
    with pytest.raises(UsageError) as raised:
        parse_bus(text)
    assert sentence in str(raised.value)


@given(st.text(max_size=30))
def test_no_text_breaks_the_parser_of_bus_names(text: str) -> None:
    with suppress(UsageError):
        bus = can_section(parse_bus(text).section)
        assert bus.interface
        assert BITRATES[0] <= bus.bitrate <= BITRATES[1]


def test_settings_are_taken_apart_at_the_first_equals_sign() -> None:
    assert parse_settings(["wall.stiffness=400", " wall.side = negative", "a.b=c=d"]) == {
        "wall.stiffness": "400",
        "wall.side": "negative",
        "a.b": "c=d",
    }
    assert parse_settings([]) == {}


def test_all_malformed_settings_are_told_at_once() -> None:
    wrong = ["stiffness=4", "wall.stiffness", "wall.=4", ".stiffness=4", "wall.stiffness="]
    with pytest.raises(UsageError) as raised:
        parse_settings([*wrong, "wall.damping=1", "wall.damping=2"])
    sentences = str(raised.value).splitlines()
    assert len(sentences) == len(wrong) + 1
    assert all(f'"{text}"' in sentence for text, sentence in zip(wrong, sentences, strict=False))
    assert "twice" in sentences[-1]


def test_changes_are_taken_apart_at_the_first_colon_those_of_one_time_together() -> None:
    assert parse_changes(["2:wall.stiffness=800", "0.5: wall.side = a:b", "2.0:wall.damping=3"]) == [
        (0.5, {"wall.side": "a:b"}),
        (2.0, {"wall.stiffness": "800", "wall.damping": "3"}),
    ]
    assert parse_changes(["1s:wall.stiffness=300", "500 ms:wall.damping=3"]) == [
        (0.5, {"wall.damping": "3"}),
        (1.0, {"wall.stiffness": "300"}),
    ]
    assert parse_changes([]) == []


def test_all_malformed_changes_are_told_at_once() -> None:
    wrong = ["wall.stiffness=4", "x:wall.stiffness=4", "2:stiffness=4", "2:wall.stiffness", "2"]
    with pytest.raises(UsageError) as raised:
        parse_changes([*wrong, "1:wall.damping=1", "1.0:wall.damping=2"])
    sentences = str(raised.value).splitlines()
    assert [f'--change "{text}"' in sentence for text, sentence in zip(wrong, sentences, strict=False)] == [True] * 5
    assert sentences[5:] == ["--change 1:wall.damping: given twice, as 1 and 2"]


@pytest.mark.parametrize("node", [1, 127])
@pytest.mark.parametrize("rate", [0.5, 1000.0])
def test_a_good_request_gives_the_bus_that_was_named(node: int, rate: float) -> None:
    bus = check_request(bus="sim@250000", node=node, rate=rate, duration=2.0)
    assert bus == parse_bus("sim@250000")


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"node": 0}, "node 0"),
        ({"node": 128}, "node 128"),
        ({"rate": 0.0}, "rate 0"),
        ({"rate": -1.0}, "rate -1"),
        ({"rate": math.nan}, "rate nan"),
        ({"rate": math.inf}, "rate inf"),
        ({"rate": 1e9}, "rate 1e9"),
        ({"duration": 0.0}, "duration 0"),
        ({"duration": math.nan}, "duration nan"),
        ({"duration": math.inf}, "duration inf"),
        ({"duration": 1e-4}, "less than one period"),
        ({"seed": -1}, "seed -1"),
        ({"bus": "simm"}, 'no bus "simm"'),
        ({"record": Path("frames.txt")}, "suffix must be one of .log, .blf, .csv"),
        ({"record": Path("no such folder/demo.csv")}, ": no folder"),
    ],
)
def test_each_wrong_value_is_named_alone(wrong: dict[str, object], sentence: str) -> None:
    with pytest.raises(UsageError) as raised:
        check_request(**wrong)  # type: ignore[arg-type]
    assert sentence in str(raised.value)
    assert len(str(raised.value).splitlines()) == 1


def test_all_wrong_values_are_told_at_once() -> None:
    with pytest.raises(UsageError) as raised:
        check_request(bus="simm", node=0, rate=0.0, duration=-1.0, seed=-1)
    assert len(str(raised.value).splitlines()) == 5


def test_what_cannot_be_written_is_known_before(tmp_path: Path) -> None:
    folder = tmp_path / "folder.csv"
    folder.mkdir()
    with pytest.raises(UsageError, match="Is a directory"):
        check_request(record=folder)


def test_asking_whether_a_file_can_be_written_leaves_no_trace(tmp_path: Path) -> None:
    kept = tmp_path / "frames.log"
    kept.write_text("frames of another run")
    check_request(record=kept)
    check_request(record=tmp_path / "rows.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["frames.log"]
    assert kept.read_text() == "frames of another run"


def test_a_fifo_to_be_written_is_refused_without_waiting_for_a_reader(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    os.mkfifo(path)
    with pytest.raises(UsageError, match="it is a FIFO; expected a regular file"):
        check_request(record=path)


@pytest.mark.parametrize("fade_in", [0.0, 0.05, 61.0, -1.0, math.nan, math.inf])
def test_a_fade_in_that_nobody_would_notice_is_refused(fade_in: float) -> None:
    with pytest.raises(UsageError, match=r"expected 0\.1 to 60 s"):
        check_fade_in(fade_in)


@pytest.mark.parametrize("fade_in", [0.1, 0.5, 60.0])
def test_a_fade_in_within_its_range_is_taken(fade_in: float) -> None:
    check_fade_in(fade_in)


def test_a_file_in_a_working_folder_that_was_removed_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    faults = file_faults("record", Path("x.log"), (".log",))
    assert faults == ['record "x.log": cannot be written: No such file or directory']
