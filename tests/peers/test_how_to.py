"""Examples of docs/how-to/test_your_canopen_software.md work as it stands there."""

import re
import signal

import pytest

from tests.peers.hosts import PROJECT, STARTS_WITHIN, free_port, line_of, require_multicast, start

pytestmark = pytest.mark.xdist_group("peers")

TEXT = (PROJECT / "docs" / "how-to" / "test_your_canopen_software.md").read_text()
PROGRAMS = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
COMMANDS = re.findall(r"^```console\n(.*?)\n```", TEXT, re.MULTILINE | re.DOTALL)


@pytest.mark.thorough("runs in real time", quick=("virtual time",))
@pytest.mark.parametrize("program", PROGRAMS, ids=["real time", "virtual time"])
def test_the_programs_run(program: str) -> None:
    exec(compile(program, "how-to", "exec"), {})


@pytest.mark.parametrize("command", COMMANDS)
def test_the_command_hosts_drives(command: str) -> None:
    port = free_port()
    require_multicast(port)
    name, *words = command.split()
    assert name == "haptic-fieldbus"
    process = start(*words, port=port)
    try:
        assert [line_of(process).split()[0] for _ in range(words.count("--drive"))] == ["ready"] * 2
        process.send_signal(signal.SIGINT)
        assert process.wait(STARTS_WITHIN) == 0
    finally:
        process.kill()
        process.communicate()
