"""How a session's two streams come to be in force, the first time and after a daemon restarted. Not for applications.

Generators that never wait: they yield where something has yet to arrive, so that a LIVE session takes a step of them
whenever it sends, and others run them to their end.
"""
from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable, Collection, Generator, Iterable
from typing import NamedTuple

import zmq

from . import messages
from .connection import check_version, hello
from .errors import RustleError, TimedOut
from .transport import Link, nonce, parse_reply, receive, send
from .types import Clock, Endpoints, Gain
from .v1 import session_pb2

LIVE_QUEUE_MESSAGES = 64
SIMULATION_QUEUE_MESSAGES = 4096

_ANSWER_WITHIN_S = 1.0
_AGAIN_AFTER_S = 0.1
_BACK_WITHIN_S = 0.2  #: before another daemon is looked for
_THERE_WITHIN_S = 0.6  #: one that was found
_AVOIDED_S = 5.0  #: one that did not answer, or had no room
_STEP_S = 0.005
_PASSING = (session_pb2.ERROR_CODE_SESSION_EXISTS, session_pb2.ERROR_CODE_QUOTA_EXCEEDED, session_pb2.ERROR_CODE_OVERLOADED)

_log = logging.getLogger("rustle")


class Streams(NamedTuple):
    stream: zmq.Socket[bytes]  #: XPUB to the daemon's SUB
    answers: zmq.Socket[bytes]  #: SUB: credits and notices
    early: list[list[bytes]]  #: what came to `answers` meanwhile


class Reattached(NamedTuple):
    attached: session_pb2.Attached
    streams: Streams
    moved: bool  #: to another daemon


def queue_messages(clock: Clock) -> int:
    return SIMULATION_QUEUE_MESSAGES if clock is Clock.SIMULATION else LIVE_QUEUE_MESSAGES


def streams_in_time(link: Link, session_id: str, queue_messages: int) -> Streams:
    """Waits. Error: TimedOut."""
    deadline = time.monotonic() + link.timeout_s
    with contextlib.closing(open_streams(link, session_id, queue_messages)) as steps:
        while time.monotonic() < deadline:
            try:
                next(steps)
            except StopIteration as done:
                streams: Streams = done.value
                return streams
            time.sleep(_STEP_S)
    raise TimedOut("timeout", f"The daemon did not take the stream at {link.stream_endpoint} and {link.out_endpoint} in time.",
                   "Check that both endpoints can be reached from here.")


def open_streams(link: Link, session_id: str, queue_messages: int) -> Generator[None, None, Streams]:
    """Ends when the daemon takes the stream and publishes answers: nothing is lost from then on."""
    answers = link.sockets.open(zmq.SUB, link.out_endpoint, 0, 65_536)
    stream: zmq.Socket[bytes] | None = None
    try:
        marker = f"subscribed/{nonce()}".encode()
        for topic in (f"{session_id}/acknowledgements".encode(), f"{session_id}/notices".encode(), marker):
            answers.subscribe(topic)
        stream = link.sockets.open(zmq.XPUB, link.stream_endpoint, queue_messages, 0)
        early: list[list[bytes]] = []
        heard = taken = False
        while not (heard and taken):
            while not heard and (parts := receive(answers)):
                heard = parts[0] == marker
                if not heard:
                    early.append(parts)
            while not taken and (parts := receive(stream)):
                taken = parts[0][:1] == b"\x01" and session_id.encode().startswith(parts[0][1:])
            if not (heard and taken):
                yield
        answers.unsubscribe(marker)
        return Streams(stream, answers, early)
    except BaseException:
        for opened in (answers, stream):
            if opened is not None:
                link.sockets.close(opened, 0)
        raise


class _NoAnswer(Exception):
    """Nobody answers, or the connection broke again before the daemon did."""


def reattach(link: Link, session_id: str, attach: session_pb2.Attach, gains: Iterable[Gain], queue_messages: int,
             ended: bool, leave: bool, is_heard: Callable[[], bool]) -> Generator[None, None, Reattached | None]:
    """Waits for a daemon, and attaches the session there under its old id unless the daemon still has it.

    ended      the daemon said that it ended the session; it may yet take a moment to forget it
    leave      the daemon ends: the session goes elsewhere at once
    is_heard   whether the session's readers have come back too; they are waited for, a little
    A link that knows elsewhere gives the old daemon a moment to be there again, and then goes from one to another.
    Returns None where the session was there all the time. Error: what the daemon refuses for good, such as a material it does
    not have.
    """
    attached: session_pb2.Attached | None = None
    moved = False
    avoided: dict[str, float] = {}
    if leave:
        avoided[link.endpoints.control] = time.monotonic() + _AVOIDED_S
        yield from _move(link, avoided.keys())
        moved = True
    while True:
        with contextlib.ExitStack() as open_sockets:
            control = link.sockets.open(zmq.DEALER, link.endpoints.control, 16, 16)
            open_sockets.callback(link.sockets.close, control, 0)
            try:
                reach_s = math.inf if link.elsewhere is None else _THERE_WITHIN_S if moved else _BACK_WITHIN_S
                welcome = (yield from _ask(control, hello(), reach_s)).welcome
                check_version(welcome)
                link.server = messages.read_welcome(welcome)
                known = (attached is not None or not moved) and (yield from _is_known(control, session_id))
                if known and attached is None:
                    if not ended:
                        return None
                    yield from _pause(_AGAIN_AFTER_S)
                    continue
                if not known:
                    attached = yield from _attach(control, session_id, attach, gains)
                assert attached is not None
                deadline = time.monotonic() + _ANSWER_WITHIN_S
                while not is_heard() and time.monotonic() < deadline:
                    yield
                if moved:
                    yield from _connected(link)
                streams = yield from _in_time(open_streams(link, session_id, queue_messages), 2 * _ANSWER_WITHIN_S)
                return Reattached(attached, streams, moved)
            except _NoAnswer:
                if link.elsewhere is None:
                    continue
            except RustleError as error:
                if error.code not in _PASSING:
                    raise
                yield from _pause(_AGAIN_AFTER_S)
                if moved and error.code == session_pb2.ERROR_CODE_SESSION_EXISTS:
                    # Left there when this daemon was out of reach; no other session has this id.
                    with contextlib.suppress(_NoAnswer, RustleError):
                        yield from _ask(control, _discard(session_id))
                    continue
                if link.elsewhere is None:
                    continue
        now = time.monotonic()
        avoided = {place: until for place, until in avoided.items() if until > now}
        avoided[link.endpoints.control] = now + _AVOIDED_S
        yield from _move(link, avoided.keys())
        moved, attached = True, None


def _attach(control: zmq.Socket[bytes], session_id: str, attach: session_pb2.Attach,
            gains: Iterable[Gain]) -> Generator[None, None, session_pb2.Attached]:
    attached = (yield from _ask(control, session_pb2.ControlRequest(session_id=session_id, attach=attach))).attached
    if gains:
        request = session_pb2.ControlRequest(session_id=session_id)
        messages.write_gains(gains, request.set_gains)
        yield from _ask(control, request)
    return attached


def _discard(session_id: str) -> session_pb2.ControlRequest:
    request = session_pb2.ControlRequest(session_id=session_id)
    request.detach.discard = True
    return request


def _move(link: Link, avoid: Collection[str]) -> Generator[None, None, None]:
    """Asks for a place, in a thread as that may wait, until there is one."""
    assert link.elsewhere is not None
    find = link.elsewhere
    while True:
        found: list[Endpoints | RustleError] = []

        def look(found: list[Endpoints | RustleError] = found) -> None:
            try:
                found.append(find(avoid))
            except RustleError as error:
                found.append(error)

        asker = threading.Thread(target=look, name="rustle-place", daemon=True)
        asker.start()
        while asker.is_alive():
            yield
        if found and isinstance(found[0], Endpoints):
            while not link.move(found[0]):
                yield
            return
        _log.warning("no place: %s", found[0] if found else "the search failed")
        yield from _pause(_AGAIN_AFTER_S)


def _connected(link: Link) -> Generator[None, None, None]:
    """By this connection the session will know that its daemon has gone."""
    deadline = time.monotonic() + _THERE_WITHIN_S
    while not link.connection().connected:
        if time.monotonic() >= deadline:
            raise _NoAnswer
        yield


def _ask(control: zmq.Socket[bytes], request: session_pb2.ControlRequest,
         reach_s: float = math.inf) -> Generator[None, None, session_pb2.ControlReply]:
    """`reach_s`: the daemon is waited for so long."""
    request.request_id = time.monotonic_ns()
    data = request.SerializeToString()
    reached_by = time.monotonic() + reach_s
    while not send(control, [data]):  # until the daemon is there
        if time.monotonic() >= reached_by:
            raise _NoAnswer
        yield
    deadline = time.monotonic() + _ANSWER_WITHIN_S
    while time.monotonic() < deadline:
        reply = parse_reply(receive(control))
        if reply is None or reply.request_id != request.request_id:
            yield
            continue
        if reply.HasField("error"):
            raise messages.read_error(reply.error)
        return reply
    raise _NoAnswer


def _is_known(control: zmq.Socket[bytes], session_id: str) -> Generator[None, None, bool]:
    request = session_pb2.ControlRequest(session_id=session_id)
    request.get_statistics.SetInParent()
    try:
        yield from _ask(control, request)
    except RustleError as error:
        if error.code != session_pb2.ERROR_CODE_UNKNOWN_SESSION:
            raise
        return False
    return True


def _in_time(steps: Generator[None, None, Streams], seconds: float) -> Generator[None, None, Streams]:
    deadline = time.monotonic() + seconds
    with contextlib.closing(steps):
        while True:
            try:
                next(steps)
            except StopIteration as done:
                streams: Streams = done.value
                return streams
            if time.monotonic() >= deadline:
                raise _NoAnswer
            yield


def _pause(seconds: float) -> Generator[None, None, None]:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        yield
