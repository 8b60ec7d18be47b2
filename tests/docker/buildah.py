"""Images and containers by buildah, which needs no daemon: a chroot, in the network of the host."""

import os
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Buildah:
    """Storage in a folder."""

    folder: Path

    def call(self, *words: str) -> str:
        """Call buildah, and return what it prints; what went wrong becomes the text of the error."""
        done = subprocess.run(self._words(*words), env=self._environment(), capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"buildah {' '.join(words)}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
        return done.stdout.strip()

    def pull(self, image: str) -> bool:
        """Whether a registry gave it."""
        words = self._words("pull", "-q", image)
        return subprocess.run(words, env=self._environment(), capture_output=True, check=False).returncode == 0

    def image_of(self, root: Path, name: str) -> None:
        """Make an image of a file system."""
        container = self.call("from", "scratch")
        self.call("copy", "-q", container, str(root), "/")
        self.call("config", "--env", "PATH=/usr/local/bin:/usr/bin:/bin", container)
        self.call("commit", "-q", container, name)
        self.call("rm", container)

    def build(self, context: Path, name: str, arguments: Mapping[str, str]) -> None:
        """Build the Dockerfile."""
        given = [word for key, value in arguments.items() for word in ("--build-arg", f"{key}={value}")]
        self.call("bud", "-q", "-f", str(context / "docker" / "Dockerfile"), *given, "-t", name, str(context))

    def start(
        self, container: str, words: Sequence[str], environment: Mapping[str, str], mounts: Sequence[str]
    ) -> "subprocess.Popen[str]":
        """Run a program in a container, as the user of the image."""
        given = [word for key, value in environment.items() for word in ("--env", f"{key}={value}")]
        mounted = [word for mount in mounts for word in ("--volume", mount)]
        return subprocess.Popen(
            self._words("run", *given, *mounted, container, "--", *words),
            env=self._environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def holds(self, container: str, words: Sequence[str]) -> bool:
        """Whether a check succeeds in a container."""
        check = self._words("run", container, "--", *words)
        return subprocess.run(check, env=self._environment(), capture_output=True, check=False).returncode == 0

    def _words(self, *words: str) -> list[str]:
        return ["buildah", "--root", str(self.folder / "store"), "--runroot", str(self.folder / "run"), *words]

    @staticmethod
    def _environment() -> dict[str, str]:
        return {**os.environ, "BUILDAH_ISOLATION": "chroot", "STORAGE_DRIVER": "vfs"}
