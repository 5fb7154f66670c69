"""ZeroMQ under the SDK. Not for applications."""
from __future__ import annotations

import contextlib
import itertools
import os
import threading
import time
from collections.abc import Callable, Collection
from typing import NamedTuple

import zmq
from google.protobuf.message import DecodeError
from zmq.utils.monitor import recv_monitor_message

from . import messages
from .errors import Closed, InvalidArgument, TimedOut, Unreachable
from .keys import Keys
from .types import Endpoints, ServerInfo
from .v1 import session_pb2

PROTOCOL_VERSION = 1
MESSAGE_BYTES = 64 << 20  #: what a daemon takes, and what is taken from it
LOOK_EVERY_S = 0.05
COMES_BACK_WITHIN_S = 0.6  #: a broken connection to a daemon that is still there

LINGER_MS = 500  #: for what is queued when a session closes

_HANDSHAKE_MS = 2_000
_HEARTBEAT_MS = 200
_HEARTBEAT_TIMEOUT_MS = 600
_RECONNECT_MS = 50
_RECONNECT_MAX_MS = 200
_MAX_SOCKETS = 512  #: of one connection: its sessions and readers

_calls = itertools.count(1)
#: Those that have not ended. Of what is collected in a cycle pyzmq might end the context first, and wait for its sockets for ever.
_contexts: set[zmq.Context[zmq.Socket[bytes]]] = set()


def nonce() -> str:
    """Different for every call on this machine."""
    return f"{time.monotonic_ns()}-{os.getpid()}-{next(_calls)}"


class Sockets:
    """The sockets that came of one connection, in a context of their own that ends with the last of them. Any thread."""

    def __init__(self, keys: Keys | None = None) -> None:
        self._keys = keys
        self._lock = threading.RLock()  # a collected reader closes wherever the collector runs
        self._context = zmq.Context()
        self._context.set(zmq.MAX_SOCKETS, _MAX_SOCKETS)
        _contexts.add(self._context)
        self._open: set[zmq.Socket[bytes]] = set()
        self._finished = False

    def open(self, kind: int, endpoint: str, send_queue: int, receive_queue: int,
             monitor: ConnectionMonitor | None = None) -> zmq.Socket[bytes]:
        """A DEALER (control), XPUB (stream) or SUB (listener) that connects to `endpoint`.

        Queues are in messages; 0: no limit. Errors: InvalidArgument (endpoint), Unreachable (no more sockets), Closed.
        """
        with self._lock:
            try:
                socket = self._context.socket(kind)
            except zmq.ZMQError as error:
                if self._context.closed:
                    raise Closed("closed", "The connection was closed.", "Connect again.") from None
                raise Unreachable("unreachable", f"ZeroMQ cannot make a socket: {error.strerror}.",
                                  "Raise the limit of open files, or close connections.") from None
            self._open.add(socket)
        try:
            _set_options(socket, kind, endpoint, send_queue, receive_queue)
            if self._keys is not None:
                _set_keys(socket, self._keys)
            if monitor is not None:
                monitor.watch(socket)
            socket.connect(endpoint)
        except InvalidArgument:
            self.close(socket, 0)
            raise
        except (zmq.ZMQError, TypeError) as error:
            if monitor is not None:
                monitor.close()
            self.close(socket, 0)
            raise InvalidArgument("endpoint", f"{endpoint}: {error}.", "Write tcp://HOST:PORT or ipc://PATH.") from None
        return socket

    def close(self, socket: zmq.Socket[bytes], linger_ms: int) -> None:
        """What is queued still leaves, for so long."""
        with self._lock:
            socket.close(linger_ms)
            self._open.discard(socket)
            self._end_context()

    def finish(self) -> None:
        """The context ends with the last socket that is still open."""
        with self._lock:
            self._finished = True
            self._end_context()

    def _end_context(self) -> None:
        if self._finished and not self._open and not self._context.closed:
            self._context.term()
            _contexts.discard(self._context)


def _set_options(socket: zmq.Socket[bytes], kind: int, endpoint: str, send_queue: int, receive_queue: int) -> None:
    """Every option whose default would bite, on purpose."""
    options = {zmq.LINGER: LINGER_MS, zmq.MAXMSGSIZE: MESSAGE_BYTES, zmq.SNDHWM: send_queue, zmq.RCVHWM: receive_queue,
               zmq.HANDSHAKE_IVL: _HANDSHAKE_MS, zmq.RECONNECT_IVL: _RECONNECT_MS, zmq.RECONNECT_IVL_MAX: _RECONNECT_MAX_MS,
               zmq.IPV6: int("[" in endpoint)}
    if kind != zmq.SUB:  # a listener whose queue is full reads no heartbeats, which would end its connection
        options |= {zmq.HEARTBEAT_IVL: _HEARTBEAT_MS, zmq.HEARTBEAT_TIMEOUT: _HEARTBEAT_TIMEOUT_MS,
                    zmq.HEARTBEAT_TTL: _HEARTBEAT_TIMEOUT_MS}
    if kind == zmq.DEALER:
        # A request waits for the connection instead of reaching a daemon that starts long after its asker gave up.
        options[zmq.IMMEDIATE] = 1
    if kind == zmq.XPUB:
        # A full queue is reported, so that the session decides between waiting and dropping.
        options[zmq.XPUB_NODROP] = 1
    for option, value in options.items():
        socket.setsockopt(option, value)


def _set_keys(socket: zmq.Socket[bytes], keys: Keys) -> None:
    try:
        socket.curve_serverkey = keys.server_key.encode()
        socket.curve_publickey = keys.public_key.encode()
        socket.curve_secretkey = keys.secret_key.encode()
    except (zmq.ZMQError, ValueError) as error:
        raise InvalidArgument("keys", f"They are no CURVE keys: {error}.", "Read them with Keys.read().") from None


def reachable(bound: str, control: str) -> str:
    """An endpoint as the daemon bound it, seen from here: of one that is bound to all addresses, at the host of `control`."""
    if bound.startswith(("tcp://0.0.0.0:", "tcp://[::]:")) and control.startswith("tcp://"):
        return control.rpartition(":")[0] + ":" + bound.rpartition(":")[2]
    return bound


def receive(socket: zmq.Socket[bytes]) -> list[bytes]:
    """One message's parts; empty when none waits."""
    try:
        return socket.recv_multipart(zmq.NOBLOCK)
    except zmq.Again:
        return []


def send(socket: zmq.Socket[bytes], parts: list[bytes]) -> bool:
    """At once or not at all: False where there is no room."""
    try:
        socket.send_multipart(parts, zmq.NOBLOCK)
    except zmq.Again:
        return False
    return True


def milliseconds_until(deadline: float, at_most_s: float = LOOK_EVERY_S) -> int:
    return max(0, int(1000 * min(at_most_s, deadline - time.monotonic()) + 0.999))


class ConnectionState(NamedTuple):
    breaks: int  #: so far
    connected: bool
    since: float  #: time.monotonic() of the newest change


class ConnectionMonitor:
    """Whether a socket is connected, without asking the other side. Any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._watched: zmq.Socket[bytes] | None = None
        self._events: zmq.Socket[bytes] | None = None
        self._state = ConnectionState(0, False, time.monotonic())
        self.key_refused = False  #: the daemon admits no such key, as far as the newest attempt says

    def watch(self, socket: zmq.Socket[bytes]) -> None:
        """Once, before the socket connects."""
        self._watched = socket
        self._events = socket.get_monitor_socket(
            zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED | zmq.EVENT_HANDSHAKE_FAILED_AUTH)
        self._events.setsockopt(zmq.LINGER, 0)

    def look(self) -> ConnectionState:
        with self._lock:
            while self._events is not None and not self._events.closed:
                try:
                    event = recv_monitor_message(self._events, zmq.NOBLOCK)["event"]
                except zmq.Again:
                    break
                connected = event == zmq.EVENT_HANDSHAKE_SUCCEEDED
                if connected or event == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                    self.key_refused = not connected
                if connected != self._state.connected and event in (zmq.EVENT_HANDSHAKE_SUCCEEDED, zmq.EVENT_DISCONNECTED):
                    self._state = ConnectionState(self._state.breaks + (not connected), connected, time.monotonic())
            return self._state

    def leave(self) -> None:
        """The socket goes to another endpoint: a connection to the one before counts no more."""
        self.look()
        with self._lock:
            self._state = ConnectionState(self._state.breaks, False, time.monotonic())

    def close(self) -> None:
        with self._lock:
            if self._watched is not None and not self._watched.closed:
                self._watched.disable_monitor()
            if self._events is not None:
                self._events.close(0)
            self._events = self._watched = None


class Link:
    """A control connection. Any thread; requests take turns."""

    def __init__(self, endpoints: Endpoints, timeout_s: float, keys: Keys | None = None) -> None:
        self.endpoints = endpoints
        self.timeout_s = timeout_s
        self.sockets = Sockets(keys)
        self.closed = False
        #: Where to go when the daemon has gone, of any but these control endpoints; may wait. None: it is waited for where it was.
        self.elsewhere: Callable[[Collection[str]], Endpoints] | None = None
        self.ended = False  #: where it knows elsewhere: its session has sent its end
        self._monitor = ConnectionMonitor()
        self._lock = threading.RLock()
        self._control = self.sockets.open(zmq.DEALER, endpoints.control, 256, 256, self._monitor)
        self._next_request = 1
        self.server = ServerInfo("", "", "", 0, 0)

    @property
    def stream_endpoint(self) -> str:
        """The caller's choice, or the daemon's."""
        return self.endpoints.stream or reachable(self.server.stream_endpoint, self.endpoints.control)

    @property
    def out_endpoint(self) -> str:
        return self.endpoints.out or reachable(self.server.out_endpoint, self.endpoints.control)

    def connection(self) -> ConnectionState:
        return self._monitor.look()

    def move(self, endpoints: Endpoints) -> bool:
        """To another daemon; the connection's breaks are counted anew. At once: False while somebody asks the one before."""
        if not self._lock.acquire(blocking=False):
            return False
        try:
            monitor = ConnectionMonitor()
            control = self.sockets.open(zmq.DEALER, endpoints.control, 256, 256, monitor)
            self._monitor.close()
            self.sockets.close(self._control, 0)
            self._control, self._monitor, self.endpoints = control, monitor, endpoints
            return True
        finally:
            self._lock.release()

    def check(self) -> None:
        """At once. Error: Unreachable: the daemon was there, and has been gone longer than a connection takes to come back."""
        if self.closed:
            raise Closed("closed", "The connection was closed.", "Connect again.")
        state = self.connection()
        if state.connected or state.breaks == 0 or time.monotonic() - state.since < COMES_BACK_WITHIN_S:
            return
        raise Unreachable("unreachable",
                          f"The daemon at {self.endpoints.control} is gone: its connection broke and does not come back.",
                          "See why rustled ended, start it again, and attach anew.")

    def ask(self, request: session_pb2.ControlRequest) -> session_pb2.ControlReply:
        """Asks and waits for the answer with the same id. Errors: the daemon's, Unreachable."""
        with self._lock:
            deadline = time.monotonic() + self.timeout_s
            request.request_id = self._number()
            sent, breaks = False, 0
            while True:
                self.check()
                if sent and self.connection().breaks != breaks:
                    raise Unreachable("unreachable",
                                      f"The connection to {self.endpoints.control} broke before the answer came.",
                                      "Ask again; if rustled has ended, start it again and attach anew.")
                if time.monotonic() >= deadline:
                    self.connection()
                    if self._monitor.key_refused:
                        raise Unreachable("unreachable", f"The daemon at {self.endpoints.control} does not admit this key.",
                                          "Have its operator take it in: rustle keys allow NAME.key, then reload rustled.", "keys")
                    raise Unreachable("unreachable", f"No answer from {self.endpoints.control} within {self.timeout_s:g} s.",
                                      "Start rustled, or give the control endpoint it prints when it starts.")
                if not self._control.poll(milliseconds_until(deadline), zmq.POLLIN if sent else zmq.POLLOUT):
                    continue
                if not sent:
                    breaks = self.connection().breaks
                    sent = send(self._control, [request.SerializeToString()])
                    continue
                reply = parse_reply(receive(self._control))
                if reply is not None and reply.request_id == request.request_id:
                    if reply.HasField("error"):
                        raise messages.read_error(reply.error)
                    return reply

    def tell(self, request: session_pb2.ControlRequest) -> None:
        """Asks without waiting for the answer; not at all while somebody else waits for long."""
        if not self._lock.acquire(timeout=LINGER_MS / 1000):
            return
        try:
            if not self.closed:
                request.request_id = self._number()
                send(self._control, [request.SerializeToString()])
        finally:
            self._lock.release()

    def close(self) -> None:
        with self._lock:
            if self.closed:
                return
            self.closed = True
            self._monitor.close()
            self.sockets.close(self._control, LINGER_MS)
            self.sockets.finish()

    def __del__(self) -> None:
        if not getattr(self, "closed", True) and hasattr(self, "_control"):
            self.close()

    def _number(self) -> int:
        self._next_request += 1
        return self._next_request


def parse_reply(parts: list[bytes]) -> session_pb2.ControlReply | None:
    """None where they are no reply."""
    reply = session_pb2.ControlReply()
    with contextlib.suppress(DecodeError):
        if len(parts) == 1:
            reply.ParseFromString(parts[0])
            return reply
    return None


class Subscription:
    """One topic of the out socket. One thread at a time, is_heard() any."""

    def __init__(self, link: Link, topic: str, queue: int) -> None:
        """Returns when the daemon has the subscription: what is published from then on is not missed.

        `queue` messages wait here; 0: no limit. Errors: TimedOut, Unreachable, Refused ("permission_denied").
        """
        self._link = link
        self._endpoint = link.out_endpoint
        if not self._endpoint:
            raise Unreachable("unreachable", "The daemon names no endpoint to listen at.", "Give Endpoints.out.")
        self._lock = threading.RLock()
        self._monitor = ConnectionMonitor()
        self._socket = link.sockets.open(zmq.SUB, self._endpoint, 0, queue, self._monitor)
        self._socket.subscribe(topic)
        self._early: list[list[bytes]] = []
        marker = f"subscribed/{nonce()}".encode()
        self._socket.subscribe(marker)
        deadline = time.monotonic() + link.timeout_s
        while True:
            if self._socket.poll(milliseconds_until(deadline)):
                parts = receive(self._socket)
                if parts and parts[0] == marker:
                    if len(parts) > 1 and parts[1]:
                        self.close()
                        raise messages.read_error(session_pb2.Error.FromString(parts[1]))
                    break
                self._early.append(parts)
            elif time.monotonic() >= deadline:
                self.close()
                raise TimedOut("timeout", f"The daemon did not confirm the subscription at {self._endpoint} in time.",
                               "Check that the out endpoint can be reached from here.")
        self._socket.unsubscribe(marker)

    def next(self, deadline: float, gone_is_error: bool) -> bytes | None:
        """The next message's body; None when none came by then.

        Errors: Closed; Unreachable where the daemon has gone, if that is to be one.
        """
        while True:
            if self._socket.closed:
                raise Closed("closed", "The reader was closed.", "Listen again.")
            with self._lock:
                parts = self._early.pop(0) if self._early else receive(self._socket)
            if len(parts) == 2:
                return parts[1]
            if parts:
                continue
            if gone_is_error:
                self._link.check()
            with self._lock:
                self._follow()
            if time.monotonic() >= deadline:
                return None
            with self._lock:
                self._socket.poll(milliseconds_until(deadline))

    def descriptor(self) -> int:
        """Becomes readable when something may have come since has_come() was asked; Closed, where it was closed."""
        if self._socket.closed:
            raise Closed("closed", "The reader was closed.", "Listen again.")
        return int(self._socket.getsockopt(zmq.FD))

    def has_come(self) -> bool:
        """Whether next() has something at once. The thread of next()."""
        with self._lock:
            return bool(self._early or self._socket.closed or self._socket.poll(0))

    def _follow(self) -> None:
        """To where a daemon that came back publishes, or another one that the link went to."""
        if self._link.out_endpoint not in ("", self._endpoint):
            self._socket.disconnect(self._endpoint)
            self._monitor.leave()
            self._endpoint = self._link.out_endpoint
            self._socket.connect(self._endpoint)

    def is_heard(self) -> bool:
        """Whether what the daemon publishes reaches it, or never will. Any thread."""
        # ZeroMQ subscribes again, at a daemon that came back, only when the socket is used.
        if self._lock.acquire(blocking=False):
            try:
                if self._socket.closed:
                    return True
                self._follow()
                self._socket.getsockopt(zmq.EVENTS)
            finally:
                self._lock.release()
        return self._monitor.look().connected

    def close(self) -> None:
        with self._lock:
            self._monitor.close()
            self._link.sockets.close(self._socket, 0)

    def __del__(self) -> None:
        if hasattr(self, "_socket") and not self._socket.closed:
            self.close()
