"""A session's sound, as it comes."""
from __future__ import annotations

import dataclasses
import enum
import math
import os
import time
from collections.abc import Iterator
from types import TracebackType
from typing import TypeVar, Union

import numpy as np
from google.protobuf.message import DecodeError

from . import opus, wav
from .connection import Connection
from .errors import InvalidArgument, TimedOut
from .transport import Subscription
from .types import Floats, SampleFormat, SoundKind
from .v1 import audio_pb2

LIVE_QUEUE_MESSAGES = 4096
FORGOTTEN_S = 10  #: an emitter that was not heard of for so long has ended unheard


@dataclasses.dataclass(frozen=True)
class Mix:
    """The session's mix."""


@dataclasses.dataclass(frozen=True)
class Stem:
    """One sheet, one kind of sound: its part of the mix before the limiter. Stems add up to the mix wherever that does not act."""

    sheet_id: int = 1
    kind: SoundKind = SoundKind.CRUMPLING


@dataclasses.dataclass(frozen=True)
class Emitters:
    """Dry sound per emitter with its position, for engines that spatialize themselves: mono, as heard at 1 m on the emitter's axis.

    An emitter radiates as a dipole, |cos θ| / R in the distance R at the angle θ from its normal.
    """


Content = Union[Mix, Stem, Emitters]
_Choice = TypeVar("_Choice", bound=enum.Enum)


@dataclasses.dataclass(frozen=True)
class ListenOptions:
    content: Content = Mix()
    format: SampleFormat = SampleFormat.F32  #: on the wire; blocks hold float32 either way
    blocks: int = 4  #: 1 to 4 in one message: fewer come sooner; not of Opus
    #: Messages that wait here for next(); when they are this many, later ones wait at the daemon and then are lost to this
    #: listener (a gap). 0: no limit. None: no limit for a session of the simulation clock, else 4096.
    queue_messages: int | None = None


def with_choices(options: ListenOptions, stem: tuple[int, SoundKind | str] | None, emitters: bool,
                 format: SampleFormat | str | None) -> ListenOptions:
    """The options with what was chosen beside them. Error: InvalidArgument."""
    if stem is not None:
        sheet_id, kind = stem
        options = dataclasses.replace(options, content=Stem(int(sheet_id), _member(SoundKind, kind, "stem")))
    if emitters:
        if stem is not None:
            raise InvalidArgument("stem", "A reader hears a stem or the emitters.", "Listen twice.")
        options = dataclasses.replace(options, content=Emitters())
    if format is not None:
        options = dataclasses.replace(options, format=_member(SampleFormat, format, "format"))
    return options


def _member(kind: type[_Choice], value: _Choice | str, field: str) -> _Choice:
    try:
        return kind(value)
    except ValueError:
        names = ", ".join(f'"{member.value}"' for member in kind)
        raise InvalidArgument(field, f"{value!r} is none of {names}.", "Choose one of them.") from None


@dataclasses.dataclass(frozen=True)
class EmitterState:
    emitter_id: int  #: may come again after its last block
    sheet_id: int
    kind: SoundKind
    position: tuple[float, float, float]  #: at the block's first sample; metres, session's axes
    normal: tuple[float, float, float]
    last: bool  #: nothing follows from it; such a block may hold no samples


@dataclasses.dataclass(frozen=True)
class PcmBlock:
    samples: Floats  #: [samples, channels] float32; read-only
    first_sample: int  #: 0 is the session's time origin
    rate_hz: int
    time_s: float  #: simulation time of the first sample
    #: Lost before this block, of its emitter where it has one: a gap. At a restart on the LIVE clock: about so many, by when blocks were read.
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

    def write_wav(self, path: str | os.PathLike[str]) -> None:
        """A WAV file of the very samples, 32-bit float. Error: OSError."""
        wav.write(path, self.samples, self.rate_hz)


def _topic(session_id: str, options: ListenOptions) -> str:
    if isinstance(options.content, Stem):
        content = f"stem/{options.content.sheet_id}/{options.content.kind.value}"
    else:
        content = "emitter" if isinstance(options.content, Emitters) else "mix"
    # Opus packets are all of one length: whoever listens shares one stream of them.
    blocks = 4 if options.format is SampleFormat.OPUS else options.blocks
    return f"{session_id}/pcm/{content}/{options.format.value}/{blocks}"


class _Tracks:
    """Opus decoders of sounds that go on from message to message, by emitter; of the mix and of a stem there is one, by 0.

    A packet of which something is dropped begins a sound.
    """

    def __init__(self) -> None:
        self._decoders: dict[int, opus.Decoder] = {}

    def decode(self, pcm: audio_pb2.Pcm) -> Floats | None:
        """None where the message holds no packet, or a shorter one than it says."""
        if pcm.samples == 0:
            return np.zeros((0, pcm.channels), np.float32)
        known = self._decoders.get(pcm.emitter.emitter_id)
        if known is None or pcm.skip_samples > 0 or (known.rate_hz, known.channels) != (pcm.rate_hz, pcm.channels):
            try:
                known = opus.Decoder(pcm.rate_hz, pcm.channels)
            except ValueError:
                return None
            self._decoders[pcm.emitter.emitter_id] = known
        decoded = known.decode(pcm.data)
        if decoded is None or len(decoded) < pcm.skip_samples + pcm.samples:
            return None
        samples = decoded[pcm.skip_samples:pcm.skip_samples + pcm.samples]
        samples.flags.writeable = False
        return samples

    def end(self, emitter_id: int) -> None:
        self._decoders.pop(emitter_id, None)


def _samples(pcm: audio_pb2.Pcm, tracks: _Tracks) -> Floats | None:
    """None for a format this version does not know, or data of the wrong size."""
    if pcm.format == audio_pb2.SAMPLE_FORMAT_OPUS:
        return tracks.decode(pcm)
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


class Parts:
    """Blocks of one sound, put together."""

    def __init__(self, first_sample: int | None) -> None:
        """first_sample   of the stream; None: where the first block begins, with what is missing before it"""
        self._first = first_sample
        self._parts: list[Floats] = []
        self._gaps: list[Gap] = []
        self._length = self._channels = self._rate_hz = 0

    def take(self, block: PcmBlock) -> None:
        if self._first is None:
            self._first = block.first_sample - block.missing_samples
        if not block.end:
            self._channels, self._rate_hz = block.samples.shape[1], block.rate_hz
        if block.missing_samples > 0:
            self._gaps.append(Gap(self._length, block.missing_samples))
            self._add(np.zeros((block.missing_samples, self._channels), np.float32))
        if not block.end:
            self._add(block.samples)

    def sound(self) -> Sound:
        samples = np.concatenate(self._parts) if self._parts else np.zeros((0, self._channels), np.float32)
        return Sound(samples, self._rate_hz, self._first or 0, tuple(self._gaps))

    def _add(self, samples: Floats) -> None:
        self._parts.append(samples)
        self._length += len(samples)


def unended(waited_s: float) -> TimedOut:
    return TimedOut("timeout", f"The stream did not end within {waited_s:g} s.", "End the session, or allow more time.")


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
        self._link = connection.link
        self._simulation = simulation
        self._reconnect = reconnect
        self._next_sample: int | None = None
        self._next_time_s = 0.0
        self._sequence = 0
        self._many = isinstance(options.content, Emitters)
        self._emitters: dict[int, int] = {}  # by id: the sample that follows
        self._missing_messages = 0
        self._tracks = _Tracks()
        if options.format is SampleFormat.OPUS:
            opus.library()
        self._arrived = 0.0
        self._missing_samples = 0
        self._unreadable = 0
        self._ended = False
        self._subscription = Subscription(connection.link, _topic(session_id, options), queue)

    @staticmethod
    def listen(connection: Connection, session_id: str, options: ListenOptions = ListenOptions(), *,
               stem: tuple[int, SoundKind | str] | None = None, emitters: bool = False,
               format: SampleFormat | str | None = None, reconnect: bool = False) -> PcmReader:
        """Returns when the daemon has seen the subscription: nothing that is sent to the session afterwards is missed. The
        session need not exist yet.

        stem, emitters, format  as of Session.listen()
        reconnect               a daemon that has gone is waited for, instead of being an Unreachable error
        Errors: InvalidArgument, TimedOut, Unreachable, RustleError (Opus without libopus).
        """
        return PcmReader(connection, session_id, with_choices(options, stem, emitters, format), reconnect=reconnect)

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
        """What is left until the stream's end in one array, gaps silent and named.

        Errors: those of next(), TimedOut, InvalidArgument (emitters, which are many sounds).
        """
        deadline = time.monotonic() + timeout_s
        parts = self.parts()
        while not self._ended:
            block = self.next(max(0.0, deadline - time.monotonic()))
            if block is None:
                raise unended(timeout_s)
            parts.take(block)
        return parts.sound()

    def parts(self) -> Parts:
        """For the SDK's own classes. Error: InvalidArgument (emitters)."""
        if self._many:
            raise InvalidArgument("content", "Emitters are many sounds.", "Read block after block.")
        return Parts(self._next_sample)

    @property
    def ended(self) -> bool:
        """Whether the stream's end was read."""
        return self._ended

    @property
    def subscription(self) -> Subscription:
        """For the SDK's own classes."""
        return self._subscription

    @property
    def missing_samples(self) -> int:
        """In all gaps so far; not of emitters that were lost whole."""
        return self._missing_samples

    @property
    def missing_messages(self) -> int:
        """Lost on the way to this listener."""
        return self._missing_messages

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
        back = self._follow(message.sequence)
        if message.HasField("end"):
            if self._link.elsewhere is not None and not self._link.ended:
                return None  # of a daemon that is drained; the session goes on at another
            return self._read_end(message.end.samples)
        pcm = message.pcm
        samples = _samples(pcm, self._tracks) if message.HasField("pcm") else None
        if samples is None:
            self._unreadable += 1
            return None
        missing, restarted, emitter = pcm.missing_samples, False, None
        if pcm.HasField("emitter"):
            emitter, restarted = _emitter(pcm.emitter), back
            missing = max(missing, self._place(pcm, back))
        else:
            now = time.monotonic()
            if self._next_sample is not None:
                restarted = pcm.first_sample < self._next_sample or back
                missing = max(missing, self._away(pcm, now) if restarted else pcm.first_sample - self._next_sample)
            self._next_sample = pcm.first_sample + pcm.samples
            self._next_time_s = pcm.time_s + pcm.samples / max(1, pcm.rate_hz)
            self._arrived = now
        self._missing_samples += missing
        return PcmBlock(samples, pcm.first_sample, pcm.rate_hz, pcm.time_s, missing, restarted, emitter)

    def _follow(self, sequence: int) -> bool:
        """Counts what messages were lost before this one. True: another daemon sent it."""
        back = 0 < sequence <= self._sequence
        if 0 < self._sequence < sequence:
            self._missing_messages += sequence - self._sequence - 1
        self._sequence = sequence
        return back

    def _place(self, pcm: audio_pb2.Pcm, back: bool) -> int:
        """Samples missing before those of an emitter, each of which goes on by itself."""
        oldest = pcm.first_sample - FORGOTTEN_S * pcm.rate_hz
        if back:
            self._emitters.clear()
        for emitter_id in [id for id, following in self._emitters.items() if following < oldest]:
            del self._emitters[emitter_id]
            if emitter_id != pcm.emitter.emitter_id:
                self._tracks.end(emitter_id)
        missing = max(0, pcm.first_sample - self._emitters.get(pcm.emitter.emitter_id, pcm.first_sample))
        self._emitters[pcm.emitter.emitter_id] = pcm.first_sample + pcm.samples
        if pcm.emitter.last:
            del self._emitters[pcm.emitter.emitter_id]
            self._tracks.end(pcm.emitter.emitter_id)
        return missing

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
