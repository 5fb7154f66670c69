"""How a session's two streams come to be in force, the first time and after a daemon restarted. Not for applications.

Generators that never wait: they yield where something has yet to arrive, so that a LIVE session takes a step of them
whenever it sends, and others run them to their end.
"""
from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Generator, Iterable
from typing import NamedTuple

import zmq

from . import messages
from .connection import check_version, hello
from .errors import RustleError
from .transport import Link, nonce, parse_reply, receive, send
from .types import Gain
from .v1 import session_pb2

LIVE_QUEUE_MESSAGES = 64
SIMULATION_QUEUE_MESSAGES = 4096

_ANSWER_WITHIN_S = 1.0
_AGAIN_AFTER_S = 0.1
_PASSING = (session_pb2.ERROR_CODE_SESSION_EXISTS, session_pb2.ERROR_CODE_QUOTA_EXCEEDED, session_pb2.ERROR_CODE_OVERLOADED)


class Streams(NamedTuple):
    stream: zmq.Socket[bytes]  #: XPUB to the daemon's SUB
    answers: zmq.Socket[bytes]  #: SUB: credits and notices
    early: list[list[bytes]]  #: what came to `answers` meanwhile


class Reattached(NamedTuple):
    attached: session_pb2.Attached
    streams: Streams


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
    """The connection broke again before the daemon answered."""


def reattach(link: Link, session_id: str, attach: session_pb2.Attach, gains: Iterable[Gain], queue_messages: int,
             ended: bool, is_heard: Callable[[], bool]) -> Generator[None, None, Reattached | None]:
    """Waits for a daemon, and attaches the session there under its old id unless the daemon still has it.

    ended      the daemon said that it ended the session; it may yet take a moment to forget it
    is_heard   whether the session's readers have come back too; they are waited for, a little
    Returns None where the session was there all the time. Error: what the daemon refuses for good, such as a material it does
    not have.
    """
    attached: session_pb2.Attached | None = None
    while True:
        with contextlib.ExitStack() as open_sockets:
            control = link.sockets.open(zmq.DEALER, link.endpoints.control, 16, 16)
            open_sockets.callback(link.sockets.close, control, 0)
            try:
                welcome = (yield from _ask(control, hello())).welcome
                check_version(welcome)
                link.server = messages.read_welcome(welcome)
                known = yield from _is_known(control, session_id)
                if known and attached is None:
                    if not ended:
                        return None
                    yield from _pause(_AGAIN_AFTER_S)
                    continue
                if not known:
                    request = session_pb2.ControlRequest(session_id=session_id, attach=attach)
                    attached = (yield from _ask(control, request)).attached
                    if gains:
                        request = session_pb2.ControlRequest(session_id=session_id)
                        messages.write_gains(gains, request.set_gains)
                        yield from _ask(control, request)
                assert attached is not None
                deadline = time.monotonic() + _ANSWER_WITHIN_S
                while not is_heard() and time.monotonic() < deadline:
                    yield
                streams = yield from _in_time(open_streams(link, session_id, queue_messages), 2 * _ANSWER_WITHIN_S)
                return Reattached(attached, streams)
            except _NoAnswer:
                continue
            except RustleError as error:
                if error.code not in _PASSING:
                    raise
                yield from _pause(_AGAIN_AFTER_S)


def _ask(control: zmq.Socket[bytes], request: session_pb2.ControlRequest) -> Generator[None, None, session_pb2.ControlReply]:
    request.request_id = time.monotonic_ns()
    data = request.SerializeToString()
    while not send(control, [data]):  # until the daemon is there
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
