"""Methods that keep state between frames, where two threads at once would crash the driver or mix two histories."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import get_ident
from typing import Any, TypeVar, cast

from cltaa.errors import UsageError

INSIDE = "_inside"  # the attribute that names the thread
Method = TypeVar("Method", bound=Callable[..., Any])


def one_thread(method: Method) -> Method:
    """``method``, which raises UsageError while another thread is in it for the same object.

    It does not wait for the other: frames come in order, and which of two threads is first is chance. A method that
    is decorated calls no other one of its object: the inner would end the guard of the outer.
    """

    @wraps(method)
    def alone(owner: Any, *given: Any, **named: Any) -> Any:
        # Who is in it, and no lock: an interrupt between taking and the try would leave that taken for good.
        state, me = vars(owner), get_ident()
        if state.setdefault(INSIDE, me) != me:
            raise UsageError("two threads use one resolver at once", cure="frames come in order: take one a thread")
        try:
            return method(owner, *given, **named)
        finally:
            state.pop(INSIDE, None)

    return cast(Method, alone)
