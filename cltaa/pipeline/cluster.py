"""Parts of a sequence on the workers of a Dask cluster, which share a file system with this process.

A worker resolves a part, writes its results into a folder of its own beside the finished ones, and reports each; only
this process moves them to their names and records them. A part whose worker is lost restarts on another, after the
results already reported.
"""

from __future__ import annotations

import io
import logging
import os
import pickle
import queue
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

import cltaa
from cltaa.core.backend import DEVICE_VARIABLE, launcher_for
from cltaa.core.build import Storage
from cltaa.core.planes import BLOCK_POOL
from cltaa.core.presets import Preset
from cltaa.core.resolver import Resolver
from cltaa.errors import CltaaError, InputMissing, OutputError, ResourceError, StorageError, UsageError, import_extra
from cltaa.io.manifest import Manifest
from cltaa.pipeline.debug import DebugViews
from cltaa.pipeline.folder import devices_of, resolver_for
from cltaa.pipeline.output import CODE, ResolvedFiles, Written, carried_kinds
from cltaa.pipeline.part import Parts, gathered_from, lineage_of
from cltaa.pipeline.run import Order, Result
from cltaa.process import Stop, is_own
from cltaa.reference.launcher import NumpyLauncher

PATIENCE = "10s"  # timeout for a scheduler's answer
RETRIES = 2  # of a part that failed in a way that may not recur; Dask itself restarts those of lost workers
LOOK = 0.2  # seconds between checks for a request to stop
SHARED = "share it with every worker under the same path"
AGAIN = "run the same again: what is finished is kept"


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Yield a ``distributed.Client`` of the scheduler at ``address``; raises UsageError where none can be had."""
    distributed: Any = import_extra("distributed", package="distributed", extra="dask", purpose="--dask")
    if is_own():  # else the loss of a scheduler prints a traceback beside our line
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, TypeError, ValueError) as error:
        raise UsageError(f"no Dask scheduler answers at {address}: {error}", cure="start one: dask scheduler") from None
    with client:
        yield client


class Tool(NamedTuple):
    """How a worker creates its resolver."""

    preset: Preset
    device: str | None
    storage: Storage
    strict: bool
    band_rows: int | None
    every_step: bool
    jobs: int = 1  # parts at once in one worker

    def elsewhere(self, description: str) -> Resolver:
        """Return a resolver that only describes those on the workers' devices."""
        launcher = NumpyLauncher()
        launcher.description = description
        return Resolver(self.preset, launcher, storage=self.storage, strict=self.strict)


class Cluster:
    """The workers of the Dask cluster of ``client``, in ``jobs`` parts or as many as they have threads. Raises
    UsageError where there are none, or where one of them has another cltaa."""

    def __init__(self, client: Any, tool: Tool, jobs: int | None) -> None:
        self._client, threads = client, client.nthreads()
        if not threads and jobs is None:
            cure = "start some: dask worker ADDRESS; or wait for N of them: --jobs N"
            raise UsageError("the Dask cluster has no workers", cure=cure)
        for worker, versions in client.get_versions(packages=["cltaa"])["workers"].items():
            found = versions["packages"].get("cltaa")
            if found != cltaa.__version__:
                what = f"Dask worker {worker} has another cltaa"
                cure = "install one version everywhere"
                raise UsageError(what, expected=cltaa.__version__, found=found or "none", cure=cure)
        self.parts = sum(threads.values()) if jobs is None else jobs
        device = tool.device or os.environ.get(DEVICE_VARIABLE)
        self._tool = tool._replace(device=device, jobs=max(threads.values(), default=1))

    def description(self) -> str:
        """Return the description of a worker's device, from the first that is free; raises the errors of opening it,
        and ResourceError where the cluster failed."""
        asked = self._client.submit(_description, self._tool.device, pure=False, retries=RETRIES)
        with suppress(Exception):
            asked.result()
        return str(_outcome(asked, "opening a device"))

    def resolve(self, orders: list[Order], stop: Stop, seconds: dict[str, list[float]]) -> Iterator[Result]:
        """Resolve as ``Elsewhere`` does; results reported before an error come first. Raises KeyboardInterrupt once
        ``stop`` is requested, the error of a failed part, and ResourceError where the cluster failed."""
        client, topic, inbox = self._client, f"cltaa-{secrets.token_hex(8)}", queue.SimpleQueue[Any]()
        client.subscribe_topic(topic, lambda event: inbox.put(event[1]))
        parts = {}
        for at, order in enumerate(orders):
            work = _packed((order, self._tool, at, topic))
            future = client.submit(resolve_part, work, key=f"{topic}-{at}", pure=False, retries=RETRIES)
            parts[future] = order
            future.add_done_callback(inbox.put)
        left, ended = set(parts), False
        try:
            while left and not ended:
                try:
                    told = inbox.get(timeout=LOOK)
                except queue.Empty:
                    told = None
                if isinstance(told, bytes):
                    yield msgspec.msgpack.decode(told, type=Result)
                elif told is not None:
                    left.remove(told)
                    done: Done = _outcome(told, f"the part from frame {parts[told].wanted[0]} on")
                    for stage, each in done.seconds.items():
                        seconds.setdefault(stage, []).extend(each)
                    yield from done.results
                ended = stop.requested
            if ended:
                raise KeyboardInterrupt
        except (CltaaError, KeyboardInterrupt):
            while not inbox.empty():
                if isinstance(told := inbox.get(), bytes):
                    yield msgspec.msgpack.decode(told, type=Result)
            raise
        finally:
            with suppress(Exception):  # a lost scheduler has nothing to cancel
                client.cancel(list(left))
                client.unsubscribe_topic(topic)


class Done(NamedTuple):
    """The results of a part from one worker, and the time of its frames in each stage."""

    results: list[Result]
    seconds: dict[str, list[float]]


def _outcome(future: Any, what: str) -> Any:
    """Return the result of a finished task, which did ``what``; raises its error."""
    if future.status not in ("finished", "error"):
        raise ResourceError("the Dask scheduler was lost", cure=AGAIN)
    outcome = future.result() if future.status == "finished" else future.exception()
    if isinstance(outcome, CltaaError):
        raise outcome
    if isinstance(outcome, BaseException):
        raise ResourceError(f"{what} failed on the Dask cluster: {type(outcome).__name__}: {outcome}", cure=AGAIN)
    return outcome


def _description(device: str | None) -> str:
    return launcher_for(device).description


class _Packed(pickle.Pickler):
    """Pickles paths so that they mean the same in every working folder."""

    def reducer_override(self, thing: object) -> Any:
        """Make a path absolute."""
        return (Path, (str(thing.absolute()),)) if isinstance(thing, Path) else NotImplemented


def _packed(thing: object) -> bytes:
    into = io.BytesIO()
    _Packed(into).dump(thing)
    return into.getvalue()


def resolve_part(work: bytes) -> Done | CltaaError:
    """Resolve a part that ``Cluster.resolve`` packed, in a Dask worker; returns an error that would come again, and
    raises ResourceError and StorageError."""
    from distributed import get_worker

    worker = get_worker()
    order, tool, at, topic = pickle.loads(work)
    try:
        return _resolve_part(order, tool, at, worker.address, lambda told: worker.log_event(topic, told))
    except (ResourceError, StorageError):
        raise
    except CltaaError as error:
        return error


class _Outbox:
    """The folder of one try of a part, which reports each result."""

    def __init__(self, place: Path, tell: Any) -> None:
        self.folder, self._tell = place / secrets.token_hex(4), tell
        self.results: list[Result] = []
        self.resolver: Resolver | None = None

    def finish(self, written: Written) -> None:
        """Report a result."""
        cuts = [] if self.resolver is None else [*self.resolver.cuts_found]
        self.results.append(Result(self.folder.name, written, cuts))
        self._tell(msgspec.msgpack.encode(self.results[-1]))


def _resolve_part(order: Order, tool: Tool, at: int, worker: str, tell: Any) -> Done:
    sequence, output = order.sequence, _Outbox(order.place, tell)
    first = sequence.path(order.wanted[0])
    if not first.exists():
        raise InputMissing(f"Dask worker {worker} does not see the frames", path=first, cure=SHARED)
    try:
        output.folder.mkdir()
    except OSError as error:
        what = f"Dask worker {worker} cannot write there: {error.strerror}"
        raise OutputError(what, path=order.output, cure=SHARED) from error
    entries = Manifest(order.output).entries  # of an earlier try, whose worker was lost
    names = {number: sequence.path(number).name for number in order.wanted}
    done = {name for name, entry in entries.items() if entry.sha256 != order.stale.get(name)}
    wanted = [number for number, name in names.items() if name not in done]
    if not wanted:
        return Done([], {})
    resolver = resolver_for(
        tool.preset,
        devices_of(tool.device, at + 1)[at],
        sequence,
        tool.band_rows,
        strict=tool.strict,
        storage=tool.storage,
        half=order.how.half,
        layers=carried_kinds(sequence, order.how.layers),
        jobs=tool.jobs,
        every_step=tool.every_step,
    )
    mine = resolver.settings()
    if mine[CODE] != order.settings[CODE]:
        raise UsageError(f"Dask worker {worker} has other kernels", cure="install one version of cltaa everywhere")
    if mine["device"] != order.settings["device"]:
        cure = "name one that all workers have by --device"
        asked, found = order.settings["device"], mine["device"]
        raise UsageError(f"Dask worker {worker} has another device", expected=asked, found=found, cure=cure)
    output.resolver = resolver
    files = ResolvedFiles(output, resolver, DebugViews(resolver, ()), undeclared=sequence.undeclared)
    parts = Parts(files, order.how, Stop())
    with BLOCK_POOL, resolver:
        part = gathered_from(sequence, wanted, tool.preset, order.how)
        parts.resolve(resolver, part, None, lineage_of(tool.preset, part, order.how), wanted)
    return Done(output.results, dict(parts.seconds))
