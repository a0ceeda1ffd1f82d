"""What holds a device lives in one process: drivers know nothing of copies, and no other process has their handles."""

from __future__ import annotations

from typing import Any, SupportsIndex

from cltaa.errors import UsageError


class OneProcess:
    """Neither copied nor pickled, which is one line: UsageError."""

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        """Refuse what ``copy`` and ``pickle`` ask for."""
        raise no_copy(self)


def no_copy(held: object) -> UsageError:
    """The error for something that cannot be copied, since it holds a device."""
    what = f"a {type(held).__name__} holds a device of this process and cannot be copied or pickled"
    return UsageError(what, cure="make one in each process")
