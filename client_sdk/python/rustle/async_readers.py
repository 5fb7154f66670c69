"""A session's sound and observations for asyncio: what the blocking readers give, without holding up the event loop."""
from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator, Callable
from types import TracebackType
from typing import Any, Generic, TypeVar, Union

from .connection import Connection
from .errors import Closed
from .observations import Observation, ObservationReader
from .pcm import ListenOptions, PcmBlock, PcmReader, Sound, unended, with_choices
from .transport import LOOK_EVERY_S
from .types import SampleFormat, SoundKind

_Reader = TypeVar("_Reader", bound=Union[PcmReader, ObservationReader])
_Self = TypeVar("_Self", bound="_AsyncReader[Any]")


class _AsyncReader(Generic[_Reader]):
    """A blocking reader that is asked only for what has come. One event loop, one task at a time."""

    def __init__(self, subscribe: Callable[[], _Reader]) -> None:
        self._subscribe = subscribe
        self._reader: _Reader | None = None
        self._closed = False

    async def open(self: _Self) -> _Self:
        """Returns when the daemon has seen the subscription: nothing that is sent to the session afterwards is missed. Done by
        `async with`, and else by the first read. Errors: Closed, TimedOut, Unreachable.
        """
        await self._opened()
        return self

    def is_heard(self) -> bool:
        """Whether what the daemon publishes reaches it now, or never will because it is closed. Any thread."""
        reader = self._reader
        return reader is None or reader.is_heard()

    def close(self) -> None:
        self._closed = True
        if self._reader is not None:
            self._reader.close()

    async def __aenter__(self: _Self) -> _Self:
        return await self.open()

    async def __aexit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    async def _opened(self) -> _Reader:
        if self._closed:
            raise Closed("closed", "The reader was closed.", "Listen again.")
        if self._reader is None:
            # Where this is cancelled the thread's reader is dropped unseen, and closes by that.
            self._reader = await asyncio.to_thread(self._subscribe)
        return self._reader

    async def _wait(self, reader: _Reader, deadline: float) -> bool:
        """Until something may have come, or it is time to see whether the daemon is still there. False: the time is up."""
        left = min(LOOK_EVERY_S, deadline - time.monotonic())
        if left <= 0:
            return False
        loop, come = asyncio.get_running_loop(), asyncio.Event()
        descriptor = reader.subscription.descriptor()
        loop.add_reader(descriptor, come.set)
        try:
            if not reader.subscription.has_come():
                async with asyncio.timeout(left):
                    await come.wait()
        except TimeoutError:
            pass
        finally:
            loop.remove_reader(descriptor)
        return True


class AsyncPcmReader(_AsyncReader[PcmReader]):
    """PcmReader for asyncio: the same blocks, gaps and errors.

        async with session.listen_async() as sound:
            async for block in sound:            # until the stream's end
                play(block.samples)              # float32 [samples, channels]

    Sessions have no asyncio form of their own: on the LIVE clock their calls do not wait; on the SIMULATION clock they wait for
    the daemon, and belong in a thread (`await asyncio.to_thread(session.frame, ...)`, one call at a time).
    """

    @staticmethod
    def listen(connection: Connection, session_id: str, options: ListenOptions = ListenOptions(), *,
               stem: tuple[int, SoundKind | str] | None = None, emitters: bool = False,
               format: SampleFormat | str | None = None, reconnect: bool = False) -> AsyncPcmReader:
        """As PcmReader's, but subscribed when it is entered by `async with`, or else when it is first read."""
        chosen = with_choices(options, stem, emitters, format)
        return AsyncPcmReader(lambda: PcmReader(connection, session_id, chosen, reconnect=reconnect))

    async def next(self, timeout_s: float = math.inf) -> PcmBlock | None:
        """The next block; None when none came in time. Errors: those of PcmReader.next() and open()."""
        reader = await self._opened()
        deadline = time.monotonic() + timeout_s
        await asyncio.sleep(0)  # other tasks have their turn, however much has come
        while (block := reader.next(0)) is None:
            if not await self._wait(reader, deadline):
                return None
        return block

    async def __aiter__(self) -> AsyncIterator[PcmBlock]:
        """Blocks with samples, until the stream's end. Errors: those of next()."""
        reader = await self._opened()
        while not reader.ended:
            block = await self.next()
            if block is not None and not block.end:
                yield block

    async def read_all(self, timeout_s: float = 60.0) -> Sound:
        """As PcmReader's."""
        reader = await self._opened()
        deadline = time.monotonic() + timeout_s
        parts = reader.parts()
        while not reader.ended:
            block = await self.next(max(0.0, deadline - time.monotonic()))
            if block is None:
                raise unended(timeout_s)
            parts.take(block)
        return parts.sound()

    @property
    def missing_samples(self) -> int:
        """In all gaps so far; not of emitters that were lost whole."""
        return 0 if self._reader is None else self._reader.missing_samples

    @property
    def missing_messages(self) -> int:
        """Lost on the way to this listener."""
        return 0 if self._reader is None else self._reader.missing_messages

    @property
    def unreadable_messages(self) -> int:
        """In a format this version does not know."""
        return 0 if self._reader is None else self._reader.unreadable_messages


class AsyncObservationReader(_AsyncReader[ObservationReader]):
    """ObservationReader for asyncio: the same observations and errors."""

    @staticmethod
    def listen(connection: Connection, session_id: str, *, reconnect: bool = False) -> AsyncObservationReader:
        """As ObservationReader's, but subscribed when it is entered by `async with`, or else when it is first read."""
        return AsyncObservationReader(lambda: ObservationReader(connection, session_id, reconnect=reconnect))

    async def next(self, timeout_s: float = math.inf) -> Observation | None:
        """The next observation; None when none came in time. Errors: those of ObservationReader.next() and open()."""
        reader = await self._opened()
        deadline = time.monotonic() + timeout_s
        await asyncio.sleep(0)
        while (observation := reader.next(0)) is None:
            if not await self._wait(reader, deadline):
                return None
        return observation

    async def __aiter__(self) -> AsyncIterator[Observation]:
        """Without end: observations have no last one. Errors: those of next()."""
        while True:
            observation = await self.next()
            if observation is not None:
                yield observation
