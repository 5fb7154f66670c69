"""What the daemon saw in a session's frames, as it comes. Metres, the session's axes."""
from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Any

from google.protobuf.message import DecodeError

from .connection import Connection
from .transport import Subscription
from .v1 import audio_pb2

Point = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class ObservedResonator:
    constrained: bool
    coarse: bool  #: the mesh is too coarse there for the promised accuracy
    ruling_length_m: float  #: l_r
    free_border_length_m: float  #: l_c
    area_m2: float


@dataclasses.dataclass(frozen=True)
class ObservedCrumpling:
    event_id: int
    continues_event_id: int  #: 0: none
    time_s: float  #: when the curvature passed zero
    amplitude_m: float
    area_m2: float
    position: Point
    resonators: tuple[ObservedResonator, ...]


@dataclasses.dataclass(frozen=True)
class ObservedFriction:
    event_id: int  #: stays for the whole episode
    speed_m_per_s: float
    area_m2: float
    position: Point
    touched_surface: str
    resonators: tuple[ObservedResonator, ...]


@dataclasses.dataclass(frozen=True)
class Observation:
    """What the daemon saw in one frame."""

    sheet_id: int
    time_s: float
    crumpling: tuple[ObservedCrumpling, ...]
    friction: tuple[ObservedFriction, ...]


def _point(sent: Any) -> Point:
    return sent.x, sent.y, sent.z


def _resonators(sent: Iterable[audio_pb2.Resonator]) -> tuple[ObservedResonator, ...]:
    return tuple(ObservedResonator(r.constrained, r.coarse, r.ruling_length_m, r.free_border_length_m, r.area_m2) for r in sent)


def _read(sent: audio_pb2.Observation) -> Observation:
    crumpling = tuple(ObservedCrumpling(e.event_id, e.continues_event_id, e.time_s, e.amplitude_m, e.area_m2,
                                        _point(e.position), _resonators(e.resonators)) for e in sent.crumpling)
    friction = tuple(ObservedFriction(c.event_id, c.speed_m_per_s, c.area_m2, _point(c.position), c.touched_surface,
                                      _resonators(c.resonators)) for c in sent.friction)
    return Observation(sent.sheet_id, sent.time_s, crumpling, friction)


class ObservationReader:
    """A session's observations as they come; frames in which nothing happened are not told. One thread at a time; may be
    another one than the session's."""

    def __init__(self, connection: Connection, session_id: str, *, reconnect: bool = False) -> None:
        """For listen() and Session.observe()."""
        self._reconnect = reconnect
        self._subscription = Subscription(connection.link, f"{session_id}/observations", 0)

    @staticmethod
    def listen(connection: Connection, session_id: str, *, reconnect: bool = False) -> ObservationReader:
        """Returns when the daemon has seen the subscription: nothing that is sent to the session afterwards is missed.

        reconnect   a daemon that has gone is waited for, instead of being an Unreachable error
        Errors: TimedOut, Unreachable.
        """
        return ObservationReader(connection, session_id, reconnect=reconnect)

    def next(self, timeout_s: float) -> Observation | None:
        """The next observation; None when none came in time. Error: Unreachable, as PcmReader.next() says."""
        deadline = time.monotonic() + timeout_s
        while (body := self._subscription.next(deadline, not self._reconnect)) is not None:
            try:
                message = audio_pb2.OutMessage.FromString(body)
            except DecodeError:
                continue
            if message.HasField("observation"):
                return _read(message.observation)
        return None

    def __iter__(self) -> Iterator[Observation]:
        """Without end: observations have no last one. Errors: those of next()."""
        while True:
            observation = self.next(math.inf)
            if observation is not None:
                yield observation

    @property
    def subscription(self) -> Subscription:
        """For the SDK's own classes."""
        return self._subscription

    def is_heard(self) -> bool:
        """Whether what the daemon publishes reaches it now, or never will because it was closed. Any thread."""
        return self._subscription.is_heard()

    def close(self) -> None:
        self._subscription.close()

    def __enter__(self) -> ObservationReader:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
