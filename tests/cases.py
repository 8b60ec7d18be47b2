"""Many cases of one rule as one test: `@every("name", values)` in the place of `@pytest.mark.parametrize`.

A test of its own costs some milliseconds and a line of every report. A rule that is cheap to check and has dozens of
members is one test that names each member that breaks it.
"""

import functools
import inspect
from collections.abc import Callable, Iterable, Sequence
from typing import Any

Test = Callable[..., None]


def every(names: str | Sequence[str], values: Iterable[Any], ids: Any = None) -> Callable[[Test], Test]:
    """Run a test for each of `values`, with the arguments of `pytest.mark.parametrize`; name all that fail.

    The cases share the fixtures of the test. Raises ValueError without a case: such a test could not fail.
    """
    keys = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    cases = [case if isinstance(case, tuple) and len(keys) > 1 else (case,) for case in map(_plain, values)]
    if not cases:
        raise ValueError(f"no case of {', '.join(keys)}")
    told = [_told(case, ids) for case in cases] if ids is None or callable(ids) else list(ids)

    def decorate(test: Test) -> Test:
        @functools.wraps(test)
        def run(*args: Any, **fixtures: Any) -> None:
            failures = []
            for case, name in zip(cases, told, strict=True):
                try:
                    test(*args, **fixtures, **dict(zip(keys, case, strict=True)))
                except Exception as error:
                    error.add_note(f"case: {name}")
                    failures.append(error)
            if len(failures) == 1:
                raise failures[0]
            if failures:
                raise ExceptionGroup(f"{len(failures)} of {len(cases)} cases fail", failures)

        signature = inspect.signature(test)
        kept = [parameter for name, parameter in signature.parameters.items() if name not in keys]
        run.__signature__ = signature.replace(parameters=kept)  # type: ignore[attr-defined]
        return run

    return decorate


def _plain(case: Any) -> Any:
    """Return the values of a `pytest.param`, which may have no marks here: these would be lost."""
    if not hasattr(case, "marks"):
        return case
    if case.marks:
        raise ValueError(f"{case}: a case has no marks of its own; use pytest.mark.parametrize")
    return case.values if len(case.values) > 1 else case.values[0]


def _told(case: tuple[Any, ...], ids: Callable[[Any], object] | None) -> str:
    return ", ".join(str(ids(value)) if ids is not None else repr(value) for value in case)
