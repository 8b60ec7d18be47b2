"""docker/: the images are built, and the two services of compose.yaml run as it says, by what this machine has."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from time import monotonic
from typing import Any

import pytest
import yaml

from haptic_fieldbus.api import plan
from tests.cli.test_beside_guide import TOO_SLOW
from tests.docker.buildah import Buildah
from tests.docker.host_base import lay_out
from tests.peers.hosts import free_port, require_multicast

PROJECT = Path(__file__).parents[2]
DOCKER = PROJECT / "docker"
IN_CONTEXT = ("pyproject.toml", "README.md", "LICENSE", "haptic_fieldbus", "profiles", "docker")
SECONDS = 4
HEALTHY_WITHIN = 60.0
COMPOSERS = (["docker", "compose"], ["docker-compose"], ["podman", "compose"], ["podman-compose"])
HOST_BASE = "localhost/host-base"
SLIM = "docker.io/library/python:3.13-slim"


def services(*files: str) -> dict[str, dict[str, Any]]:
    """Services by name, as later files override earlier ones."""
    merged: dict[str, dict[str, Any]] = {}
    for file in files:
        for name, service in yaml.safe_load((DOCKER / file).read_text())["services"].items():
            merged[name] = {**merged.get(name, {}), **service}
    return merged


def words(service: dict[str, Any]) -> list[str]:
    """Command line of a service; $$ is compose's way to write one."""
    entry = service.get("entrypoint", ["haptic-fieldbus"])
    return [
        word.replace("$$", "$").replace("${SECONDS_TO_RENDER:-30}", str(SECONDS)) for word in entry + service["command"]
    ]


def check_of(service: dict[str, Any]) -> list[str]:
    kind, *check = service["healthcheck"]["test"]
    return check if kind == "CMD" else ["sh", "-c", *check]


def mounts_of(service: dict[str, Any]) -> list[str]:
    return [f"{DOCKER}/{mount.removeprefix('./')}" for mount in service.get("volumes", ())]


@pytest.mark.parametrize(
    "files",
    [("compose.yaml",), ("compose.yaml", "compose.socketcan.yaml"), ("compose.yaml", "compose.modbus.yaml")],
    ids=lambda each: each[-1],
)
def test_both_services_name_one_bus_and_the_rig_is_one_that_is_rendered(files: tuple[str, ...]) -> None:
    both = services(*files)
    rig = Path(mounts_of(both["loop"])[0].partition(":")[0])
    text = rig.read_text()
    named = both["drive"]["environment"]
    interface, _, channel = named["BUS"].partition("@")[0].partition(":")
    assert f'interface = "{interface}"' in text
    # A server listens everywhere; its clients call it by the name of its service.
    assert f'channel = "{channel.replace("0.0.0.0", "drive")}"' in text
    assert f'profile = "{named["DRIVE"]}"' in text
    assert "$DRIVE" in words(both["drive"])[-1]
    plan("wall", rig=rig, rate=200.0, settings={"wall.stiffness": "max/2"})


@pytest.mark.thorough("asks an engine of containers")
@pytest.mark.skipif(
    next((each for each in COMPOSERS if shutil.which(each[0])), None) is None,
    reason="no compose: apt-get install podman-compose",
)
def test_compose_renders_a_wall() -> None:
    def works(composer: list[str]) -> bool:
        engine = [composer[0].partition("-")[0], "info"]
        return all(
            shutil.which(each[0]) and subprocess.run(each, capture_output=True, check=False).returncode == 0
            for each in ([*composer, "version"], engine)
        )

    composer = next(filter(works, COMPOSERS), None)
    if composer is None:
        pytest.skip("no compose with an engine that answers: start docker, or apt-get install podman-compose")
    up = [*composer, "-f", str(DOCKER / "compose.yaml"), "up", "--build", "--exit-code-from", "loop"]
    environment = {**os.environ, "SECONDS_TO_RENDER": str(SECONDS)}
    done = subprocess.run(up, env=environment, capture_output=True, text=True, check=False)
    subprocess.run([*composer, "-f", str(DOCKER / "compose.yaml"), "down"], capture_output=True, check=False)
    assert done.returncode == 0 or TOO_SLOW.search(done.stdout), done.stdout + done.stderr
    assert "ready" in done.stdout
    assert "result" in done.stdout


@pytest.fixture(scope="module")
def context(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files that the Dockerfile sees, and below docker/ the wheels that it needs, for no network is given to it."""
    folder = tmp_path_factory.mktemp("context")
    for name in (*IN_CONTEXT, ".dockerignore"):
        here = PROJECT / name
        if here.is_dir():
            shutil.copytree(here, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(here, folder)
    wheel = [sys.executable, "-m", "pip", "wheel", "-q", "--wheel-dir", str(folder / "docker")]
    subprocess.run([*wheel, f"{PROJECT}[multicast,plot]", "hatchling>=1.27"], check=True)
    for own in (folder / "docker").glob("haptic_fieldbus-*.whl"):
        own.unlink()
    return folder


@pytest.fixture(scope="module")
def buildah(tmp_path_factory: pytest.TempPathFactory, context: Path) -> Iterator[Buildah]:
    """With the images `demo` and `can`; the base is python:3.13-slim, or this machine's Python where no registry is."""
    if shutil.which("buildah") is None:
        pytest.skip("no buildah: apt-get install buildah")
    folder = tmp_path_factory.mktemp("buildah")
    engine, base, options = Buildah(folder), SLIM, {}
    if not engine.pull(SLIM):
        lay_out(folder / "root")
        base, options = HOST_BASE, {"PIP_OPTIONS": "--no-index"}
        engine.image_of(folder / "root", base)
    for name, extras in (("can", "multicast"), ("demo", "multicast,plot")):
        engine.build(context, name, {"BASE": base, "EXTRAS": extras, **options})
    yield engine
    engine.call("rm", "--all")
    shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.thorough("builds images")
class TestBuildah:
    """The same commands, checks and mounts as compose has them, without compose."""

    def test_the_demo_is_rendered_and_drawn_by_a_user_who_is_not_root(
        self, buildah: Buildah, request: pytest.FixtureRequest
    ) -> None:
        bases = [base for base in (SLIM, HOST_BASE) if base in buildah.call("images", "--format", "{{.Name}}:{{.Tag}}")]
        request.node.user_properties.extend(("base", base) for base in bases)  # in the JUnit file
        buildah.call("from", "--name", "demo", "demo")
        process = buildah.start(
            "demo", ["sh", "-c", "haptic-fieldbus run wall --duration 1 --plot demo.png && ls"], {}, []
        )
        said, _ = process.communicate(timeout=300.0)
        assert process.returncode == 0, said
        assert "demo.png" in said
        assert not buildah.holds("demo", ["test", "-w", "/usr"])

    def test_a_wall_is_rendered_between_two_containers(self, buildah: Buildah) -> None:
        port = free_port()
        require_multicast(port)
        both = services("compose.yaml")
        with ExitStack() as ended:
            started = {}
            for name in ("drive", "loop"):
                buildah.call("from", "--name", name, "can")
                assert not buildah.holds(name, check_of(both[name])), "healthy before it has begun"
                environment = {**both[name].get("environment", {}), "CAN_CONFIG": f'{{"port": {port}}}'}
                started[name] = buildah.start(name, words(both[name]), environment, mounts_of(both[name]))
                ended.callback(started[name].terminate)
                await_health(buildah, name, both[name], started[name])
            said, _ = started["loop"].communicate(timeout=120.0)
            assert started["loop"].returncode == 0 or TOO_SLOW.search(said), said
            assert started["loop"].returncode or "result" in said
        said, _ = started["drive"].communicate(timeout=60.0)
        assert said.startswith("ready      maxon_epos4, node 1")


def await_health(buildah: Buildah, name: str, service: dict[str, Any], process: "subprocess.Popen[str]") -> None:
    """Wait until the check of a service succeeds."""
    deadline = monotonic() + HEALTHY_WITHIN
    ended = False
    while not buildah.holds(name, check_of(service)):
        if ended:
            pytest.fail(f"{name} ended before it was healthy:\n{process.communicate()[0]}")
        ended = process.poll() is not None
        assert monotonic() < deadline, f"{name} did not become healthy"
