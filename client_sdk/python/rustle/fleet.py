"""Many daemons: a place for a session at one of them, and at another when that one goes away.

    places = rustle.fleet.Daemons(["tcp://sound-1:7390", "tcp://sound-2:7390"])       a list, balanced by how full they are
    places = rustle.fleet.Agones("https://allocator.example.org", fleet="rustle")     or whatever Agones gives
    with rustle.fleet.attach(places, rustle.SessionOptions(name="flag")) as session:
        ...                                                                           as any other session
"""
from __future__ import annotations

import dataclasses
import http.client
import json
import random
import ssl
import time
import urllib.error
import urllib.request
import uuid
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple, Protocol

import zmq

from . import messages
from .connection import Connection, hello
from .errors import InvalidArgument, Refused, RustleError, TimedOut, Unreachable
from .keys import Keys
from .notices import log_notice
from .session import Session
from .transport import Sockets, milliseconds_until, parse_reply, receive, send
from .types import Endpoints, Notice, ServerInfo, SessionOptions
from .v1 import session_pb2

_ANSWER_WITHIN_S = 0.5
_FIRST_ALONE_S = 0.05  #: the others are waited for, once one has answered
_AGAIN_AFTER_S = 0.1
_CONNECT_WITHIN_S = 2.0
_NAME_BYTES = 64  #: of the session id
_ELSEWHERE = ("quota_exceeded", "overloaded", "unreachable", "timeout")  #: there may be room at another


class Places(Protocol):
    def place(self, avoid: Collection[str] = ()) -> Endpoints:
        """A daemon that has room. May wait, a second or two; any thread.

        avoid   control endpoints that failed just now: named only where there is no other
        Errors: Unreachable, Refused ("quota_exceeded": all are full).
        """


class _Load(NamedTuple):
    sessions: int
    most: int


class Daemons:
    """Those of a list, asked by name. Knows no Kubernetes."""

    def __init__(self, controls: Sequence[str], *, keys: Keys | None = None) -> None:
        """controls   control endpoints, such as tcp://sound-1:7390"""
        if not controls:
            raise InvalidArgument("controls", "No daemon is named.", "Name the control endpoint of one at least.")
        self._controls = list(dict.fromkeys(controls))
        self._keys = keys

    def place(self, avoid: Collection[str] = ()) -> Endpoints:
        """Of two chosen at random, by the room that they have, the emptier: askers that come all at once spread out."""
        asked = [control for control in self._controls if control not in avoid]
        loads = self._loads(asked) if asked else {}
        if not any(load.sessions < load.most for load in loads.values()):
            loads |= self._loads([control for control in self._controls if control in avoid])
        if not loads:
            raise Unreachable("unreachable", f"None of {', '.join(self._controls)} answers.", "Start rustled at one of them.")
        open_ = {control: load for control, load in loads.items() if load.sessions < load.most}
        if not open_:
            raise Refused("quota_exceeded", f"The {len(loads)} daemons that answer are full.",
                          "Start another one, or detach sessions.", code=session_pb2.ERROR_CODE_QUOTA_EXCEEDED)
        room = [load.most - load.sessions for load in open_.values()]
        two = random.choices(list(open_), room, k=2)
        return Endpoints(min(two, key=lambda control: open_[control].sessions / open_[control].most))

    def _loads(self, controls: Sequence[str]) -> dict[str, _Load]:
        """Of those that answer: all, or so many as do within a moment of the first."""
        loads: dict[str, _Load] = {}
        deadline = time.monotonic() + _ANSWER_WITHIN_S
        sockets = Sockets(self._keys)
        waiting: dict[str, zmq.Socket[bytes]] = {}
        said: set[str] = set()
        try:
            for control in controls:
                waiting[control] = sockets.open(zmq.DEALER, control, 4, 4)
            question = hello()
            question.request_id = 1
            while waiting and time.monotonic() < deadline:
                poller = zmq.Poller()
                for control, socket in waiting.items():
                    poller.register(socket, zmq.POLLIN if control in said else zmq.POLLOUT)
                poller.poll(milliseconds_until(deadline))
                for control, socket in list(waiting.items()):
                    if control not in said:
                        if send(socket, [question.SerializeToString()]):
                            said.add(control)
                        continue
                    reply = parse_reply(receive(socket))
                    if reply is None:
                        continue
                    if reply.HasField("welcome"):
                        loads[control] = _load(messages.read_welcome(reply.welcome))
                        deadline = min(deadline, time.monotonic() + _FIRST_ALONE_S)
                    sockets.close(waiting.pop(control), 0)
        finally:
            for socket in waiting.values():
                sockets.close(socket, 0)
            sockets.finish()
        return loads


def _load(server: ServerInfo) -> _Load:
    """One that does not say counts as empty: it refuses what it cannot take."""
    return _Load(server.sessions, server.most_sessions) if server.most_sessions > 0 else _Load(0, 1)


@dataclasses.dataclass(frozen=True)
class Agones:
    """Those of an Agones fleet, by the allocator service's REST interface: deploy/fleet has the manifests."""

    url: str  #: of the allocator, such as https://allocator.example.org
    fleet: str = "rustle"
    namespace: str = "default"
    ca: str = ""  #: file of the authority that vouches for the allocator; empty: the system's
    certificate: str = ""  #: file of one's own certificate, for an allocator that asks for it (mTLS is its default)
    key: str = ""  #: and of its key
    timeout_s: float = 1.0

    def place(self, avoid: Collection[str] = ()) -> Endpoints:
        """One that is allocated and has room, so that daemons fill up one after the other, or else a fresh one. After a failure the
        other way round: Agones may not know yet that the daemon is gone."""
        given = self._ask(fresh_first=bool(avoid))
        if given.control in avoid:
            raise Unreachable("unreachable", f"Agones still names {given.control}, which has gone.",
                              "Ask again in a moment; a fleet that keeps a spare daemon ready (bufferSize) is spared the wait.")
        return given

    def _ask(self, fresh_first: bool) -> Endpoints:
        selectors = [{"matchLabels": {"agones.dev/fleet": self.fleet}, "gameServerState": state,
                      "counters": {"sessions": {"minAvailable": "1"}}} for state in ("ALLOCATED", "READY")]
        question = {"namespace": self.namespace, "gameServerSelectors": selectors[::-1] if fresh_first else selectors,
                    "priorities": [{"type": "Counter", "key": "sessions", "order": "Descending" if fresh_first else "Ascending"}],
                    "counters": {"sessions": {"action": "Increment", "amount": "1"}}}
        request = urllib.request.Request(f"{self.url.rstrip('/')}/gameserverallocation", json.dumps(question).encode(),
                                         {"Content-Type": "application/json"}, method="POST")
        try:
            context = None
            if self.url.startswith("https:"):
                context = ssl.create_default_context(cafile=self.ca or None)
                if self.certificate:
                    context.load_cert_chain(self.certificate, self.key or None)
            with urllib.request.urlopen(request, timeout=self.timeout_s, context=context) as answer:
                return _endpoints(json.loads(answer.read(1 << 20)))
        except urllib.error.HTTPError as refusal:
            said = refusal.read(1000).decode(errors="replace").strip()
            if refusal.code in (404, 409, 429, 503):  # nothing matches, or others were faster
                raise Refused("quota_exceeded", f"Agones has no place in the fleet {self.fleet}: {refusal.code} {said}",
                              "Allow the autoscaler more (maxCapacity), or wait until it has started a daemon.",
                              code=session_pb2.ERROR_CODE_QUOTA_EXCEEDED) from None
            raise Unreachable("unreachable", f"The allocator at {self.url} refuses: {refusal.code} {said}",
                              "See that namespace and certificate are those that it lets in.") from None
        except (OSError, http.client.HTTPException, ValueError) as error:
            raise Unreachable("unreachable", f"The allocator at {self.url} does not answer: {error}.",
                              "Give the address of the service agones-allocator, and its ca.") from None


def _endpoints(answer: Any) -> Endpoints:
    """Error: Unreachable, where a port is missing."""
    ports = {port.get("name"): port.get("port") for port in answer.get("ports", [])}
    missing = [name for name in ("control", "stream", "out") if not ports.get(name)]
    address = answer.get("address", "")
    if missing or not address:
        raise Unreachable("unreachable", f"Agones names no {' and no '.join(missing or ['address'])} of {answer.get('gameServerName')}.",
                          "Name the ports control, stream and out in the fleet's manifest.")
    host = f"[{address}]" if ":" in address else address
    return Endpoints(*(f"tcp://{host}:{ports[name]}" for name in ("control", "stream", "out")))


def attach(places: Places, options: SessionOptions = SessionOptions(), *, keys: Keys | None = None, timeout_s: float = 10.0,
           on_notice: Callable[[Notice], None] = log_notice) -> Session:
    """Asks for a place and attaches there. When its daemon goes away, killed, cut off or drained, the session asks for another
    place and attaches there under its own id, as Session's reconnect=True says; its readers follow.

    The session has a connection of its own, which ends with it. SIMULATION sessions have one gap at such a move, and are no longer the
    same, bit for bit. Readers go on until the session's own end.
    timeout_s   for all attempts together; where all daemons are full, others may detach meanwhile
    Errors: those of `places`, and of Session.attach(); what one daemon refuses for want of room is asked of others.
    """
    deadline = time.monotonic() + timeout_s
    avoid: set[str] = set()
    while True:
        endpoints: Endpoints | None = None
        try:
            endpoints = places.place(avoid)
            return _attach_at(endpoints, places, options, keys, on_notice)
        except RustleError as error:
            if error.code_name not in _ELSEWHERE or time.monotonic() >= deadline:
                raise
            if endpoints is None:
                avoid.clear()
            else:
                avoid.add(endpoints.control)
        time.sleep(_AGAIN_AFTER_S)


def _attach_at(endpoints: Endpoints, places: Places, options: SessionOptions, keys: Keys | None,
               on_notice: Callable[[Notice], None]) -> Session:
    connection = Connection.connect(endpoints, _CONNECT_WITHIN_S, keys=keys)
    try:
        session = Session.attach(connection, options, session_id=_own_id(options.name), reconnect=True, on_notice=on_notice)
    except BaseException:
        connection.close()
        raise
    connection.link.elsewhere = places.place
    return session


def _own_id(name: str) -> str:
    """No other session's at any daemon, as it may go to any."""
    plain = "".join(character for character in name if character.isprintable() and character != "/")
    plain = plain.encode()[:_NAME_BYTES].decode(errors="ignore").strip()
    return f"{plain or 'session'}-{uuid.uuid4().hex[:16]}"
