"""Functions of one value that are called with the arguments of that value.

A request to the package is a frozen dataclass, and its fields are the arguments of a function of the Python API. So
each argument and its default is written once.
"""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, Protocol, TypeVar, cast

P = ParamSpec("P")
Asked = TypeVar("Asked")
Answer = TypeVar("Answer")
AskedBy = TypeVar("AskedBy", contravariant=True)
Answered = TypeVar("Answered", covariant=True)


class Called(Protocol[P, AskedBy, Answered]):
    """A function that takes the fields of a value as arguments; `of` takes the value itself."""

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> Answered: ...

    def of(self, asked: AskedBy, /) -> Answered: ...


def arguments_of(make: Callable[P, Asked]) -> Callable[[Callable[[Asked], Answer]], Called[P, Asked, Answer]]:
    """Decorate a function of one value: it takes the arguments of `make` instead, and its signature shows them.

    A call with wrong arguments raises TypeError with the name of the decorated function.
    """

    def decorated(function: Callable[[Asked], Answer]) -> Called[P, Asked, Answer]:
        shown = inspect.signature(make).replace(return_annotation=inspect.signature(function).return_annotation)

        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> Answer:
            try:
                shown.bind(*args, **kwargs)
            except TypeError as wrong:  # names the function that was called, not the dataclass
                raise TypeError(f"{function.__name__}() {wrong}") from None
            return function(make(*args, **kwargs))

        vars(call).update(__signature__=shown, of=function)
        return cast("Called[P, Asked, Answer]", call)

    return decorated
