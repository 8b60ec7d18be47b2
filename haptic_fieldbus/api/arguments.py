"""A function of one value, called with the arguments that make the value.

What is asked of the package is a frozen dataclass, and its fields are the arguments of the Python API: they stand once,
with their defaults.
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
    """A function that takes the arguments of a value; `of` takes the value itself."""

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> Answered: ...

    def of(self, asked: AskedBy, /) -> Answered: ...


def arguments_of(make: Callable[P, Asked]) -> Callable[[Callable[[Asked], Answer]], Called[P, Asked, Answer]]:
    """Decorate a function of one value: it is called with the arguments of `make`, and its help shows them."""

    def decorated(function: Callable[[Asked], Answer]) -> Called[P, Asked, Answer]:
        shown = inspect.signature(make).replace(return_annotation=inspect.signature(function).return_annotation)

        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> Answer:
            try:
                shown.bind(*args, **kwargs)
            except TypeError as wrong:  # told of the function that was called, not of the dataclass
                raise TypeError(f"{function.__name__}() {wrong}") from None
            return function(make(*args, **kwargs))

        vars(call).update(__signature__=shown, of=function)
        return cast("Called[P, Asked, Answer]", call)

    return decorated
