"""The control socket of a daemon: what is asked is answered."""
from __future__ import annotations

from collections.abc import Iterable
from types import TracebackType
from typing import Any

from . import arrays, messages
from .errors import Refused, RustleError
from .keys import Keys
from .transport import PROTOCOL_VERSION, Link
from .types import Endpoints, Gain, PackInfo, RecordingInfo, ServerInfo, ServerStatistics, SessionInfo, Statistics
from .v1 import session_pb2

CLIENT_NAME = "rustle Python SDK 0.1.0"


def hello() -> session_pb2.ControlRequest:
    request = session_pb2.ControlRequest()
    request.hello.protocol_version = PROTOCOL_VERSION
    request.hello.client = CLIENT_NAME
    return request


def check_version(welcome: session_pb2.Welcome) -> None:
    """Error: Refused, "protocol_version"."""
    if welcome.protocol_version != PROTOCOL_VERSION:
        raise Refused("protocol_version",
                      f"The daemon speaks version {welcome.protocol_version}, this SDK version {PROTOCOL_VERSION}.",
                      "Bring the older of SDK and daemon up to date.", code=session_pb2.ERROR_CODE_PROTOCOL_VERSION)


def _expect(reply: session_pb2.ControlReply, kind: str) -> Any:
    if reply.WhichOneof("reply") != kind:
        raise RustleError("malformed", "The daemon's answer is of another kind than what was asked.",
                          "Bring the older of SDK and daemon up to date.")
    return getattr(reply, kind)


class Connection:
    """A daemon to ask, and to attach sessions to. Any thread; requests take turns.

        with rustle.Connection.connect() as daemon:
            print(daemon.server, daemon.list_sessions())

    Every call raises what the daemon refuses as Refused (SessionLost for a session it does not have), and Unreachable where it
    has gone, which is noticed within two seconds. A connection by itself comes back when the daemon does.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    @staticmethod
    def connect(endpoints: Endpoints | str = Endpoints(), timeout_s: float = 5.0, *, keys: Keys | None = None) -> Connection:
        """Says hello and waits for the welcome; `timeout_s` holds for every later request too.

        `endpoints` may be the control endpoint alone; `keys` are for a daemon that was started with keys, and for all that comes
        of the connection. Errors: InvalidArgument (endpoint, keys), Unreachable (nobody answers, or not to this key), Refused
        ("protocol_version").
        """
        connection = Connection(Link(Endpoints(endpoints) if isinstance(endpoints, str) else endpoints, timeout_s, keys))
        try:
            connection._link.server = connection.ping()
        except BaseException:
            connection.close()
            raise
        return connection

    @property
    def server(self) -> ServerInfo:
        return self._link.server

    @property
    def link(self) -> Link:
        """For the SDK's own classes."""
        return self._link

    def close(self) -> None:
        """Nothing can be asked any more: detach its sessions before."""
        self._link.close()

    def __enter__(self) -> Connection:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def check(self) -> None:
        """Whether the daemon is still there, without asking it: at once. Error: Unreachable."""
        self._link.check()

    def ping(self) -> ServerInfo:
        """Says hello again."""
        welcome = _expect(self._link.ask(hello()), "welcome")
        check_version(welcome)
        return messages.read_welcome(welcome)

    def list_packs(self) -> list[PackInfo]:
        request = session_pb2.ControlRequest()
        request.list_packs.SetInParent()
        return [messages.read_pack(pack) for pack in _expect(self._link.ask(request), "pack_list").packs]

    def list_sessions(self) -> list[SessionInfo]:
        request = session_pb2.ControlRequest()
        request.list_sessions.SetInParent()
        return [messages.read_session(session) for session in _expect(self._link.ask(request), "session_list").sessions]

    def statistics(self, session_id: str) -> Statistics:
        request = session_pb2.ControlRequest(session_id=session_id)
        request.get_statistics.SetInParent()
        return messages.read_statistics(_expect(self._link.ask(request), "statistics"))

    def server_statistics(self) -> ServerStatistics:
        """Of the daemon itself."""
        request = session_pb2.ControlRequest()
        request.get_statistics.SetInParent()
        return messages.read_server_statistics(_expect(self._link.ask(request), "server_statistics"))

    def set_gains(self, session_id: str, gains: Iterable[Gain]) -> list[Gain]:
        """Changes gains while the session sounds, without a click: each takes the place of the one for the same sheet, kind and
        material, 0 dB takes it away, the others stay. Returns all in force; none given: only asks."""
        request = session_pb2.ControlRequest(session_id=session_id)
        messages.write_gains(gains, request.set_gains)
        return messages.read_gains(_expect(self._link.ask(request), "gains_set"))

    def change_pack(self, session_id: str, sheet_id: int, material: str, touched_surface: str = "") -> PackInfo:
        """The sheet gets another pack while it sounds: what sounds goes on as it began, what begins has the new one, friction
        goes over to it. Empty: as it is."""
        request = session_pb2.ControlRequest(session_id=session_id)
        request.change_pack.sheet_id = arrays.identifier(sheet_id, "sheet_id")
        request.change_pack.material = material
        request.change_pack.touched_surface = touched_surface
        return messages.read_pack(_expect(self._link.ask(request), "pack_changed").pack)

    def reload_pack(self, name: str = "") -> list[PackInfo]:
        """The daemon reads packs of this name or material from disk anew, or all that are there; sessions that play them go over.
        Returns them. All or nothing: where one cannot be read the error names the file."""
        request = session_pb2.ControlRequest()
        request.reload_pack.name = name
        request.reload_pack.SetInParent()
        return [messages.read_pack(pack) for pack in _expect(self._link.ask(request), "pack_list").packs]

    def start_recording(self, session_id: str, file_name: str = "") -> str:
        """Records a session from now on in the daemon's recording folder. Returns the file's name; empty: chosen by the daemon."""
        request = session_pb2.ControlRequest(session_id=session_id)
        request.start_recording.file_name = file_name
        request.start_recording.SetInParent()
        name: str = _expect(self._link.ask(request), "recording_started").file_name
        return name

    def stop_recording(self, session_id: str) -> RecordingInfo:
        """Returns when the file is closed; also of a session that has ended."""
        request = session_pb2.ControlRequest(session_id=session_id)
        request.stop_recording.SetInParent()
        stopped = _expect(self._link.ask(request), "recording_stopped")
        return RecordingInfo(stopped.file_name, stopped.messages, stopped.bytes)

    def detach(self, session_id: str, discard: bool = False, last_sequence: int = 0) -> Statistics:
        """`discard`: what was not yet rendered is dropped. Else the session ends once the stream's message `last_sequence` has
        come; 0: at once."""
        request = session_pb2.ControlRequest(session_id=session_id)
        request.detach.discard = discard
        request.detach.last_sequence = last_sequence
        request.detach.SetInParent()
        return messages.read_statistics(_expect(self._link.ask(request), "detached").statistics)

    def tell_detach(self, session_id: str, discard: bool = False, last_sequence: int = 0) -> None:
        """detach() without waiting for the answer."""
        request = session_pb2.ControlRequest(session_id=session_id)
        request.detach.discard = discard
        request.detach.last_sequence = last_sequence
        request.detach.SetInParent()
        self._link.tell(request)
