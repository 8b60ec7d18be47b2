"""Where drive profiles are: the folder that is shipped, and a folder of one's own.

The caller names the own folder, else the environment variable HAPTIC_FIELDBUS_PROFILES does. Its `*.toml` are found by
their names beside the shipped ones. A name that stands in both is refused: which of the two moves a motor must not
depend on what somebody forgot.
"""

import os
from pathlib import Path

from haptic_fieldbus.documents import file_names, file_of, is_path
from haptic_fieldbus.documents.octets import IMPOSSIBLE_NAME
from haptic_fieldbus.errors import UsageError

VARIABLE = "HAPTIC_FIELDBUS_PROFILES"


def profile_folder() -> Path:
    """Return the folder of the shipped profiles: inside an installed package, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "profiles"
    return installed if installed.is_dir() else package.parent / "profiles"


def profile_names() -> list[str]:
    """Return the names of the shipped profiles, sorted."""
    return file_names(profile_folder())


def own_files(profiles: str | Path | None = None) -> dict[str, Path]:
    """Return the files of the own folder by their names, empty where there is no such folder.

    Names that would be taken for paths, and hidden files, are left out. Raises UsageError for a folder that cannot be
    listed.
    """
    named, said = (str(profiles), "profiles") if profiles is not None else (os.environ.get(VARIABLE, ""), VARIABLE)
    if profiles is None and not named:
        return {}
    folder = Path(named).absolute()
    try:
        if not named:
            raise FileNotFoundError(2, "no name")
        names = sorted(os.listdir(folder))
    except (OSError, ValueError) as error:
        reason = str(error.strerror) if isinstance(error, OSError) else IMPOSSIBLE_NAME
        raise UsageError(f'{said} "{named}": expected a folder of drive profiles: {reason}') from error
    stems = {name.removesuffix(".toml"): folder / name for name in names if name.endswith(".toml")}
    return {stem: path for stem, path in stems.items() if stem and stem[0] != "." and not is_path(stem)}


def known_names(profiles: str | Path | None = None) -> list[str]:
    """Return the names of all profiles, shipped and own; raises what `own_files` raises."""
    return sorted({*profile_names(), *own_files(profiles)})


def profile_file(name: str | Path, profiles: str | Path | None = None) -> Path:
    """Return the file of a profile by its name, or the path that is given.

    Raises UsageError for a name that there is not, or that is both a shipped and an own one, and what `own_files`
    raises.
    """
    own = own_files(profiles)
    if is_path(name) or name not in own:
        return file_of("profile", name, profile_folder(), own)
    path, shipped = own[str(name)], profile_folder() / f"{name}.toml"
    if not path.is_file():  # a pipe would be waited for
        raise UsageError(f'profile "{name}": {path} is not a file')
    if shipped.is_file() and not shipped.samefile(path):
        raise UsageError(f'profile "{name}" is both {path} and the shipped {shipped}; give your own another name')
    return path


def own_profile(name: str, profiles: str | Path | None = None) -> str:
    """Return the path of an own profile; the name of a shipped one, and a path, stay as they are.

    Raises what `profile_file` raises of names that are own ones.
    """
    own = own_files(profiles)
    return str(profile_file(name, profiles)) if not is_path(name) and name in own else name
