"""`simulate`: one line a drive when ready, until it is asked to stop."""

import json
import signal
from pathlib import Path

import pytest

from tests.cli.command import Command
from tests.peers.hosts import STARTS_WITHIN, free_port, line_of, require_multicast, start

pytestmark = pytest.mark.xdist_group("peers")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "--bus says where the drives are hosted"),
        (("--bus", "sim"), 'bus "sim": no other program can join it; host on socketcan:can0'),
        (("--bus", "virtual:a", "--drive", "maxon_epos5"), 'no profile "maxon_epos5"'),
        (("--bus", "virtual:a", "--node", "200"), "node 200"),
        (("--bus", "virtual:a", "--hand", "foot"), 'no hand "foot"'),
        (("--bus", "virtual:a", "--faults", "nowhere.toml"), "nowhere.toml"),
        (("--bus", "sockercan:can0"), 'no bus interface "sockercan"'),
    ],
)
def test_what_cannot_be_hosted_is_refused_before_anything_is_opened(
    command: Command, words: tuple[str, ...], said: str
) -> None:
    finished = command("simulate", *words)
    assert finished.status == 2
    assert said in finished.err
    assert finished.out == ""


def test_faults_of_the_master_s_controller_are_not_hosted(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text('[[fault]]\nkind = "bus_off"\nat = 1.0\n')
    finished = command("simulate", "--bus", "virtual:a", "--faults", str(path))
    assert finished.status == 2
    assert 'fault "bus_off" is one of the bus or of the master\'s computer' in finished.err


def test_a_bus_that_does_not_open_is_a_failure(command: Command) -> None:
    finished = command("simulate", "--bus", "udp_multicast:127.0.0.1")
    assert finished.status == 1
    assert "failed" in finished.err


@pytest.mark.thorough("waits for another process", quick=("Ctrl-C",))
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "SIGTERM"])
def test_it_says_a_line_a_drive_and_ends_cleanly_when_asked_to(number: signal.Signals) -> None:
    port = free_port()
    require_multicast(port)
    bus = "udp_multicast:239.74.163.2@1000000"
    as_json = ("--json",) if number is signal.SIGTERM else ()
    process = start(
        "simulate", "--drive", "maxon_epos4@9", "--drive", "generic_cia402", "--bus", bus, *as_json, port=port
    )
    try:
        lines = [line_of(process), line_of(process)]
        process.send_signal(number)
        assert process.wait(STARTS_WITHIN) == 0
    finally:
        process.kill()
        out, err = process.communicate()
    assert (out, err) == ("", "")
    if as_json:
        assert [json.loads(line) for line in lines] == [
            {"drive": "maxon_epos4", "node": 9, "bus": bus},
            {"drive": "generic_cia402", "node": 1, "bus": bus},
        ]
    else:
        assert lines == [
            f"ready      maxon_epos4, node 9, on {bus}\n",
            f"ready      generic_cia402, node 1, on {bus}\n",
        ]
