"""Keep what the OpenEXR module prints on standard output while it decodes out of the answers of the command line."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO


class _StandardOutput:
    """Standard output that swallows the text of some threads and hands on that of all others."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self.muted: set[int] = set()

    def write(self, text: str) -> int:
        return len(text) if threading.get_ident() in self.muted else self.stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


_lock = threading.Lock()
_output: _StandardOutput | None = None


@contextmanager
def muted_output() -> Iterator[None]:
    """Swallow what this thread prints to ``sys.stdout``; other threads, such as a progress display, are not touched.

    A redirection of the file descriptor, or of ``sys.stdout`` by each thread for itself, would swallow the text of
    the other threads too and could be undone in the wrong order; here the last thread to leave restores the stream.
    """
    global _output
    thread = threading.get_ident()
    with _lock:
        if _output is None:
            _output = _StandardOutput(sys.stdout)
            sys.stdout = _output
        _output.muted.add(thread)
    try:
        yield
    finally:
        with _lock:
            _output.muted.discard(thread)
            if not _output.muted:
                if sys.stdout is _output:
                    sys.stdout = _output.stream
                _output = None
