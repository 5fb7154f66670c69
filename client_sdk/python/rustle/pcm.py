"""A session's sound, as it comes."""
from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterator
from types import TracebackType
from typing import Union

import numpy as np
from google.protobuf.message import DecodeError

from .connection import Connection
from .errors import InvalidArgument, TimedOut
from .transport import Subscription
from .types import Floats, SampleFormat, SoundKind
from .v1 import audio_pb2

LIVE_QUEUE_MESSAGES = 4096


@dataclasses.dataclass(frozen=True)
class Mix:
    """The session's mix."""


@dataclasses.dataclass(frozen=True)
class Stem:
    """One sheet, one kind of sound."""

    sheet_id: int = 1
    kind: SoundKind = SoundKind.CRUMPLING


@dataclasses.dataclass(frozen=True)
class Emitters:
    """Dry sound per emitter with its position, for engines that spatialize themselves."""


Content = Union[Mix, Stem, Emitters]


@dataclasses.dataclass(frozen=True)
class ListenOptions:
    content: Content = Mix()
    format: SampleFormat = SampleFormat.F32  #: on the wire; blocks hold float32 either way
    blocks: int = 4  #: 1 to 4 in one message: fewer come sooner
    #: Messages that wait here for next(); when they are this many, later ones wait at the daemon and then are lost to this
    #: listener (a gap). 0: no limit. None: no limit for a session of the simulation clock, else 4096.
    queue_messages: int | None = None


@dataclasses.dataclass(frozen=True)
class EmitterState:
    emitter_id: int
    sheet_id: int
    kind: SoundKind
    position: tuple[float, float, float]  #: metres, session's axes
    normal: tuple[float, float, float]
    last: bool  #: nothing follows from it


@dataclasses.dataclass(frozen=True)
class PcmBlock:
    samples: Floats  #: [samples, channels] float32; read-only
    first_sample: int  #: 0 is the session's time origin
    rate_hz: int
    time_s: float  #: simulation time of the first sample
    #: Lost before this block: a gap. At a restart on the LIVE clock: about so many, by when blocks were read.
    missing_samples: int = 0
    restarted: bool = False  #: the first of a daemon that was started anew: first_sample counts from 0 again
    emitter: EmitterState | None = None
    end: bool = False  #: the stream is complete: no samples here, `first_sample` is its length


@dataclasses.dataclass(frozen=True)
class Gap:
    """Samples that were lost: silence in Sound.samples from row `first` on, `samples` rows."""

    first: int
    samples: int


@dataclasses.dataclass(frozen=True)
class Sound:
    samples: Floats  #: [samples, channels] float32
    rate_hz: int
    first_sample: int  #: of the stream; 0 is the session's time origin
    gaps: tuple[Gap, ...] = ()


def _topic(session_id: str, options: ListenOptions) -> str:
    if isinstance(options.content, Stem):
        content = f"stem/{options.content.sheet_id}/{options.content.kind.value}"
    else:
        content = "emitter" if isinstance(options.content, Emitters) else "mix"
    return f"{session_id}/pcm/{content}/{options.format.value}/{options.blocks}"


def _samples(pcm: audio_pb2.Pcm) -> Floats | None:
    """None for a format this version does not know, or data of the wrong size."""
    shape = (pcm.samples, pcm.channels)
    if pcm.format == audio_pb2.SAMPLE_FORMAT_F32 and len(pcm.data) == 4 * shape[0] * shape[1]:
        return np.frombuffer(pcm.data, "<f4").reshape(shape)
    if pcm.format == audio_pb2.SAMPLE_FORMAT_S16 and len(pcm.data) == 2 * shape[0] * shape[1]:
        samples: Floats = (np.frombuffer(pcm.data, "<i2").astype(np.float32) / np.float32(32767)).reshape(shape)
        samples.flags.writeable = False
        return samples
    return None


def _emitter(sent: audio_pb2.Emitter) -> EmitterState:
    kind = next((kind for kind in SoundKind if kind.value == sent.kind), SoundKind.CRUMPLING)
    return EmitterState(sent.emitter_id, sent.sheet_id, kind, (sent.position.x, sent.position.y, sent.position.z),
                        (sent.normal.x, sent.normal.y, sent.normal.z), sent.last)


class PcmReader:
    """A session's sound, as it comes. One thread at a time; may be another one than the session's.

        with session.listen() as sound:
            for block in sound:                  # until the stream's end
                play(block.samples)              # float32 [samples, channels]
    """

    def __init__(self, connection: Connection, session_id: str, options: ListenOptions = ListenOptions(), *,
                 simulation: bool = False, reconnect: bool = False) -> None:
        """For listen() and Session.listen()."""
        if not 1 <= options.blocks <= 4:
            raise InvalidArgument("blocks", f"A message holds 1 to 4 blocks; {options.blocks} are asked for.",
                                  "Ask for 1 to 4.")
        queue = options.queue_messages
        if queue is None:
            queue = 0 if simulation else LIVE_QUEUE_MESSAGES
        self._simulation = simulation
        self._reconnect = reconnect
        self._next_sample: int | None = None
        self._next_time_s = 0.0
        self._sequence = 0
        self._arrived = 0.0
        self._missing_samples = 0
        self._unreadable = 0
        self._ended = False
        self._subscription = Subscription(connection.link, _topic(session_id, options), queue)

    @staticmethod
    def listen(connection: Connection, session_id: str, options: ListenOptions = ListenOptions(), *,
               reconnect: bool = False) -> PcmReader:
        """Returns when the daemon has seen the subscription: nothing that is sent to the session afterwards is missed. The
        session need not exist yet.

        reconnect   a daemon that has gone is waited for, instead of being an Unreachable error
        Errors: InvalidArgument, TimedOut, Unreachable.
        """
        return PcmReader(connection, session_id, options, reconnect=reconnect)

    def next(self, timeout_s: float) -> PcmBlock | None:
        """The next block; None when none came in time.

        Error: Unreachable, once the daemon has gone and everything that came before was read, unless it is waited for.
        """
        deadline = time.monotonic() + timeout_s
        while (body := self._subscription.next(deadline, not self._reconnect)) is not None:
            block = self._read(body)
            if block is not None:
                return block
        return None

    def __iter__(self) -> Iterator[PcmBlock]:
        """Blocks with samples, until the stream's end. Errors: those of next()."""
        while not self._ended:
            block = self.next(math.inf)
            if block is not None and not block.end:
                yield block

    def read_all(self, timeout_s: float = 60.0) -> Sound:
        """What is left until the stream's end in one array, gaps silent and named. Errors: those of next(), TimedOut."""
        deadline = time.monotonic() + timeout_s
        parts: list[Floats] = []
        gaps: list[Gap] = []
        length, channels, rate_hz, first = 0, 0, 0, self._next_sample
        while not self._ended:
            block = self.next(max(0.0, deadline - time.monotonic()))
            if block is None:
                raise TimedOut("timeout", f"The stream did not end within {timeout_s:g} s.",
                               "End the session, or allow more time.")
            if first is None:
                first = block.first_sample - block.missing_samples
            if not block.end:
                channels, rate_hz = block.samples.shape[1], block.rate_hz
            if block.missing_samples > 0:
                gaps.append(Gap(length, block.missing_samples))
                parts.append(np.zeros((block.missing_samples, channels), np.float32))
                length += block.missing_samples
            if not block.end:
                parts.append(block.samples)
                length += len(block.samples)
        samples = np.concatenate(parts) if parts else np.zeros((0, channels), np.float32)
        return Sound(samples, rate_hz, first or 0, tuple(gaps))

    @property
    def missing_samples(self) -> int:
        """In all gaps so far."""
        return self._missing_samples

    @property
    def unreadable_messages(self) -> int:
        """In a format this version does not know."""
        return self._unreadable

    def is_heard(self) -> bool:
        """Whether what the daemon publishes reaches it now, or never will because it was closed. Any thread."""
        return self._subscription.is_heard()

    def close(self) -> None:
        self._subscription.close()

    def __enter__(self) -> PcmReader:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _read(self, body: bytes) -> PcmBlock | None:
        try:
            message = audio_pb2.OutMessage.FromString(body)
        except DecodeError:
            self._unreadable += 1
            return None
        if message.HasField("end"):
            return self._read_end(message.end.samples)
        pcm = message.pcm
        samples = _samples(pcm) if message.HasField("pcm") else None
        if samples is None:
            self._unreadable += 1
            return None
        missing, restarted, emitter = pcm.missing_samples, False, None
        if pcm.HasField("emitter"):
            emitter = _emitter(pcm.emitter)
        else:
            now = time.monotonic()
            if self._next_sample is not None:
                restarted = pcm.first_sample < self._next_sample or 0 < message.sequence <= self._sequence
                missing = max(missing, self._away(pcm, now) if restarted else pcm.first_sample - self._next_sample)
            self._next_sample = pcm.first_sample + pcm.samples
            self._next_time_s = pcm.time_s + pcm.samples / max(1, pcm.rate_hz)
            self._sequence, self._arrived = message.sequence, now
        self._missing_samples += missing
        return PcmBlock(samples, pcm.first_sample, pcm.rate_hz, pcm.time_s, missing, restarted, emitter)

    def _away(self, pcm: audio_pb2.Pcm, now: float) -> int:
        """Samples between two daemons: by simulation time where sound follows it, else by the time that passed."""
        if self._simulation:
            return max(0, round((pcm.time_s - self._next_time_s) * pcm.rate_hz))
        return max(0, round((now - self._arrived) * pcm.rate_hz) - pcm.samples)

    def _read_end(self, length: int) -> PcmBlock:
        self._ended = True
        missing = max(0, length - self._next_sample) if self._next_sample is not None else 0
        self._missing_samples += missing
        return PcmBlock(np.zeros((0, 0), np.float32), length, 0, self._next_time_s, missing, end=True)
