"""A simulator's session with the daemon."""
from __future__ import annotations

import collections
import contextlib
import logging
import math
import time
import weakref
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError

from . import arrays, messages
from .async_readers import AsyncObservationReader, AsyncPcmReader
from .attachment import Reattached, Streams, queue_messages, reattach, streams_in_time
from .connection import Connection
from .errors import Closed, InvalidArgument, RustleError, SessionLost, TimedOut, Unreachable
from .notices import log_notice
from .observations import ObservationReader
from .pcm import ListenOptions, PcmReader, with_choices
from .standing import Standing
from .transport import LINGER_MS, MESSAGE_BYTES, milliseconds_until, receive, send
from .types import (Array, Clock, Contacts, Floats, Gain, Notice, Obstacle, PackInfo, Partition, Pose, RecordingInfo,
                    SampleFormat, Sent, SessionOptions, SheetOptions, SoundKind, Statistics, TearTip, Vector3)
from .v1 import audio_pb2, session_pb2, sheet_pb2

_NOTICES_KEPT = 1024
_PUT_OFF = 256  #: messages kept while a daemon is away; beyond them, what stands is told instead
_DROPPABLE = ("frame", "tear_tips", "listener", "advance")  #: may be left out rather than waited for on the LIVE clock
_STEP_S = 0.005

_log = logging.getLogger("rustle")


class _UnderWay(NamedTuple):
    message: session_pb2.StreamMessage
    sequence: int
    bytes: int


class _KnownSheet(NamedTuple):
    said: bytes  #: its description as sent last; in the same words again it changes nothing
    now: sheet_pb2.Sheet  #: and as changed since


class _Mesh(NamedTuple):
    vertices: int
    triangles: int


class Session:
    """A simulator's session with the daemon. One thread at a time; several sessions may be in several threads.

        with rustle.Connection.connect() as daemon:
            options = rustle.SessionOptions(name="flag", clock=rustle.Clock.SIMULATION, sheets=[rustle.SheetOptions(1)])
            with rustle.Session.attach(daemon, options) as session:
                session.add_topology(1, triangles)
                for t in np.arange(0, 10, 1 / 60):
                    session.frame(1, 1, t, simulate(t))
                session.end()

    SIMULATION clock: every message waits until the daemon's window has room, at most `send_timeout_s`; nothing is dropped.
    LIVE clock: frame(), tear_tips(), listener() and advance() never wait; where the queue to the daemon is full, the message is
    dropped and counted. Sheets, topologies, scenes and the end wait for room, at most `send_timeout_s`.

    What is wrong with an argument is an InvalidArgument, and nothing was sent. What the daemon refuses later comes as a notice
    that names field and remedy: to `on_notice`, and kept for poll_notices().

    A daemon that goes away
      reconnect=False  is an Unreachable error within two seconds; one that was started anew is SessionLost.
      reconnect=True   is waited for. Whatever is sent to the daemon that came back goes on under the same session id: the
                       session attaches again and sends its gains, sheets, topologies, scene and listener first.
                       LIVE: nothing waits and nothing is raised meanwhile; frames are dropped and counted. The calls
                       themselves do the work, so it goes on as long as they come. What the new daemon refuses for good, such
                       as a material it does not have, is raised.
                       SIMULATION: calls wait, at most `send_timeout_s`. What the old daemon had acknowledged is not sent
                       again, what it had not acknowledged is; the new sound begins at the newest acknowledged time. What had
                       been acknowledged and not yet heard, and the motion's history, died with the old daemon: the sound has
                       one gap there (PcmBlock.restarted) and is no longer the same, bit for bit, as without the restart.
    Unless told otherwise LIVE sessions reconnect and SIMULATION sessions, which promise the same samples, do not.
    """

    def __init__(self, connection: Connection, session_id: str, asked: SessionOptions, options: SessionOptions,
                 streams: Streams, breaks: int, reconnect: bool, on_notice: Callable[[Notice], None]) -> None:
        """For attach()."""
        self._connection = connection
        self._link = connection.link
        self._id = session_id
        self._asked = asked
        self._options = options
        self._stream, self._answers = streams.stream, streams.answers
        self._on_notice = on_notice
        self.send_timeout_s = 10.0

        self._reconnect = reconnect
        self._breaks = breaks  # of the control connection, when the session was last known to be there
        self._recovery: Generator[None, None, Reattached | None] | None = None
        self._recovering_since = 0.0
        self._standing = Standing()
        self._sheets: dict[int, _KnownSheet] = {}
        self._pending: collections.deque[session_pb2.StreamMessage] = collections.deque()
        self._tell_all = False  # more was put off than _pending keeps
        self._gains: list[Gain] = []
        self._leaving = False  # the daemon ends, and the session goes elsewhere
        self._readers: weakref.WeakSet[PcmReader | ObservationReader | AsyncPcmReader | AsyncObservationReader] = weakref.WeakSet()
        self._failure: RustleError | None = None
        self._lost: SessionLost | None = None
        self._reattached = 0

        self._detached = False
        self._meshes: dict[int, _Mesh] = {}
        self._next_sequence, self._last_sequence = 1, 0
        self._sent_messages = self._dropped_messages = 0
        self._under_way: collections.deque[_UnderWay] = collections.deque()  # SIMULATION clock: sent, not yet acknowledged
        self._bytes_under_way = 0
        self._acknowledged = 0
        self._recording_file_name, self._stored_sequence = "", 0
        self._window_messages = self._window_bytes = 0
        self._notices: collections.deque[Notice] = collections.deque(maxlen=_NOTICES_KEPT)
        self._untold: collections.deque[Notice] = collections.deque()
        for parts in streams.early:
            self._take(parts)

    @staticmethod
    def attach(connection: Connection, options: SessionOptions = SessionOptions(), *, session_id: str = "",
               reconnect: bool | None = None, on_notice: Callable[[Notice], None] = log_notice) -> Session:
        """Returns when the daemon's subscription to this session has arrived and its credits and notices are heard: nothing is
        lost at the start.

        session_id  1 to 128 characters without a slash; empty: chosen by the daemon, after the session's name
        reconnect   what becomes of the session when the daemon goes away (see above); None: as its clock has it
        on_notice   called with every notice, by the session's own calls and in their thread; what it raises, they raise
        Errors: the daemon's, TimedOut, InvalidArgument, Unreachable.
        """
        link = connection.link
        if not link.stream_endpoint or not link.out_endpoint:
            raise InvalidArgument("endpoints.stream", "The daemon takes no streams: it only subscribes to publishers.",
                                  "Start rustled with --stream, or give Endpoints.stream.")
        request = session_pb2.ControlRequest(session_id=session_id)
        messages.write_attach(options, request.attach)
        attached = link.ask(request).attached
        breaks = link.connection().breaks
        session_id = attached.session_id
        if not session_id:
            raise RustleError("malformed", "The daemon's answer to attach names no session.",
                              "Bring the older of SDK and daemon up to date.")
        in_force = messages.read_options(attached.options, options)
        try:
            streams = streams_in_time(link, session_id, queue_messages(in_force.clock))
        except BaseException:
            connection.tell_detach(session_id, discard=True)
            raise
        wanted = in_force.clock is Clock.LIVE if reconnect is None else reconnect
        session = Session(connection, session_id, options, in_force, streams, breaks, wanted, on_notice)
        if attached.HasField("credit"):
            session._take_credit(attached.credit)
        session._recording_file_name = attached.recording_file_name
        for sheet in request.attach.sheets:
            session._standing.take(session_pb2.StreamMessage(sheet=sheet))
            session._note(sheet)
        return session

    def __enter__(self) -> Session:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Detaches; what was sent is rendered. A daemon that is gone is no error here."""
        try:
            if not self._detached:
                self.detach()
        except RustleError as problem:
            _log.warning("session %s: %s", self._id, problem)
        finally:
            self._close()

    def __del__(self) -> None:
        if getattr(self, "_detached", True):
            return
        with contextlib.suppress(Exception):
            self._connection.tell_detach(self._id, last_sequence=self._last_sequence)
            self._close()

    # ---- what is known of it

    @property
    def id(self) -> str:
        return self._id

    @property
    def options(self) -> SessionOptions:
        """As in force: rate, block and so on settled by the daemon."""
        return self._options

    @property
    def sent_messages(self) -> int:
        return self._sent_messages

    @property
    def dropped_messages(self) -> int:
        """LIVE clock: because the queue was full, or the daemon away."""
        return self._dropped_messages

    @property
    def acknowledged_sequence(self) -> int:
        """SIMULATION clock."""
        return self._acknowledged

    @property
    def next_sequence(self) -> int:
        return self._next_sequence

    @property
    def recording_file_name(self) -> str:
        """Where the session is recorded; empty: nowhere, as far as was heard."""
        return self._recording_file_name

    @property
    def stored_sequence(self) -> int:
        """Everything up to this message that was recorded is on the daemon's disk, as far as was heard."""
        return self._stored_sequence

    @property
    def connected(self) -> bool:
        """False while the daemon is away and waited for."""
        return self._recovery is None and not self._pending and self._failure is None

    @property
    def control_endpoint(self) -> str:
        """Of its daemon; one of a fleet may go to another."""
        return self._link.endpoints.control

    @property
    def reattached(self) -> int:
        """How often it attached again, to a daemon that came back without it."""
        return self._reattached

    # ---- what it sends

    def add_sheet(self, sheet: SheetOptions) -> Sent:
        message = session_pb2.StreamMessage()
        messages.write_sheet(sheet, message.sheet)
        return self._send(message)

    def add_topology(self, topology_id: int, triangles: Array | Sequence[Sequence[int]], vertex_count: int | None = None, *,
                     material_coordinates: Floats | None = None, rest_positions: Floats | None = None) -> Sent:
        """The triangles of one or several sheets; immutable once sent.

        triangles              [T,3] whole numbers below V, counter-clockwise seen from the side the normals point to
        vertex_count           V; None: the rows of material_coordinates or rest_positions, else the largest index plus one
        material_coordinates   [V,2] float32, the flat sheet before any deformation; helps, and remeshing simulators need it
        rest_positions         [V,3] float32, the sheet at rest
        """
        if vertex_count is None:
            given = next((array for array in (material_coordinates, rest_positions) if array is not None), None)
            top = np.asarray(triangles).max(initial=-1) + 1 if given is None else len(given)
            vertex_count = int(top)
        vertex_count = arrays.identifier(vertex_count, "topology.vertex_count")
        message = session_pb2.StreamMessage()
        messages.write_topology(topology_id, triangles, vertex_count, material_coordinates, rest_positions, message.topology)
        mesh = _Mesh(vertex_count, len(message.topology.triangles) // 12)
        sent = self._send(message)
        self._meshes[topology_id] = mesh
        return sent

    def frame(self, sheet_id: int, topology_id: int, time_s: float, positions: Floats, *, velocities: Floats | None = None,
              anchored: Array | None = None, reset_history: bool = False, contacts: Contacts | None = None,
              partition: Partition | None = None, tear_tips: Sequence[TearTip] = ()) -> Sent:
        """Where a sheet's vertices are at `time_s`, later than its frame before.

        positions       [V,3] float32, C-contiguous, of a topology that was added
        velocities      [V,3] float32, units per second; None: differenced from positions
        anchored        [V] bool or uint8, where a hand or a pin holds the vertex
        reset_history   the sheet jumped (teleport, loop, cut): this frame is compared with nothing before it
        contacts        replace what proximity finds; Contacts() says "touches nothing"
        partition       replaces what the geometry shows
        tear_tips       replace what the mesh shows
        Errors: InvalidArgument (nothing was sent), and those of every message.
        """
        mesh = self._meshes.get(topology_id)
        if mesh is None:
            raise InvalidArgument("frame.topology_id", f"Topology {topology_id} was not added.",
                                  "Call add_topology() before the first frame that uses it.")
        message = session_pb2.StreamMessage()
        messages.write_frame(sheet_id, topology_id, time_s, positions, mesh.vertices, mesh.triangles, velocities, anchored,
                             reset_history, contacts, partition, tear_tips, message.frame)
        return self._send(message)

    def scene(self, time_s: float, *, obstacles: Iterable[Obstacle] = (), poses: Mapping[int, Pose] | None = None,
              vertices: Mapping[int, Floats] | None = None, removed: Iterable[int] = ()) -> Sent:
        """Changes to the scene. Obstacles named here are created or replaced; others stay as they are.

        poses      of obstacles by id; between updates they move linearly
        vertices   of mesh obstacles by id, [V,3] float32
        removed    ids
        """
        message = session_pb2.StreamMessage()
        messages.write_scene(time_s, obstacles, poses or {}, vertices or {}, removed, message.scene)
        return self._send(message)

    def listener(self, time_s: float, position: Vector3, forward: Vector3 | None = None, up: Vector3 | None = None) -> Sent:
        """forward None: toward the sheets; up None: the session's up axis."""
        message = session_pb2.StreamMessage()
        messages.write_listener(time_s, position, forward, up, message.listener)
        return self._send(message)

    def tear_tips(self, sheet_id: int, time_s: float, tips: Iterable[TearTip]) -> Sent:
        """Tear tips between frames."""
        message = session_pb2.StreamMessage()
        message.tear_tips.sheet_id = arrays.identifier(sheet_id, "tear_tips.sheet_id")
        message.tear_tips.time_s = arrays.number(time_s, "tear_tips.time_s")
        messages.write_tear_tips(tips, message.tear_tips.tips, "tear_tips.tips")
        return self._send(message)

    def advance(self, time_s: float) -> Sent:
        """Sound up to this time may be rendered, whatever is still to come."""
        message = session_pb2.StreamMessage()
        message.advance.time_s = arrays.number(time_s, "advance.time_s")
        message.advance.SetInParent()
        return self._send(message)

    def end(self, time_s: float | None = None) -> Sent:
        """The last message; None: the newest time sent."""
        message = session_pb2.StreamMessage()
        message.end.time_s = 0.0 if time_s is None else arrays.number(time_s, "end.time_s")
        message.end.SetInParent()
        self._link.ended = True
        return self._send(message)

    def raw(self, stream_message: bytes, *, keep_sequence: bool = False, wait: bool = True) -> Sent:
        """A serialized rustle.v1.StreamMessage made elsewhere, such as one of a capture; its session id is replaced by this
        session's.

        keep_sequence   else numbered as this session's next, and stamped with this sender's clock
        wait            False: dropped where frame() of the LIVE clock would drop it
        """
        try:
            message = session_pb2.StreamMessage.FromString(stream_message)
        except DecodeError:
            raise InvalidArgument("stream_message", "The bytes are no rustle.v1.StreamMessage.",
                                  "Give a message as a capture's stream channel holds it.") from None
        if message.HasField("topology"):
            topology = message.topology
            self._meshes[topology.topology_id] = _Mesh(topology.vertex_count, len(topology.triangles) // 12)
        return self._send(message, keep_sequence=keep_sequence, may_drop=not wait)

    # ---- what it hears and asks

    def listen(self, options: ListenOptions = ListenOptions(), *, stem: tuple[int, SoundKind | str] | None = None,
               emitters: bool = False, format: SampleFormat | str | None = None) -> PcmReader:
        """The session's sound. Subscribes and returns when that is in force: what is sent afterwards is heard whole.

        stem      (sheet_id, kind), such as (1, "friction"): one sheet's sound of one kind, in place of options.content
        emitters  every emitter's dry sound with its position, in place of options.content
        format    such as "s16": on the wire, in place of options.format
        """
        options = with_choices(options, stem, emitters, format)
        reader = PcmReader(self._connection, self._id, options, simulation=self._is_simulation, reconnect=self._reconnect)
        self._readers.add(reader)
        return reader

    def observe(self) -> ObservationReader:
        """What the daemon sees in the session's frames, from now on."""
        reader = ObservationReader(self._connection, self._id, reconnect=self._reconnect)
        self._readers.add(reader)
        return reader

    def listen_async(self, options: ListenOptions = ListenOptions(), *, stem: tuple[int, SoundKind | str] | None = None,
                     emitters: bool = False, format: SampleFormat | str | None = None) -> AsyncPcmReader:
        """listen() for asyncio: subscribes when it is entered by `async with`, or else when it is first read."""
        options = with_choices(options, stem, emitters, format)
        reader = AsyncPcmReader(lambda: PcmReader(self._connection, self._id, options, simulation=self._is_simulation,
                                                  reconnect=self._reconnect))
        self._readers.add(reader)
        return reader

    def observe_async(self) -> AsyncObservationReader:
        """observe() for asyncio: subscribes when it is entered by `async with`, or else when it is first read."""
        reader = AsyncObservationReader(lambda: ObservationReader(self._connection, self._id, reconnect=self._reconnect))
        self._readers.add(reader)
        return reader

    def statistics(self) -> Statistics:
        return self._connection.statistics(self._id)

    def set_gains(self, gains: Iterable[Gain] = ()) -> list[Gain]:
        """As Connection's; told again to a daemon that comes back."""
        self._gains = self._connection.set_gains(self._id, gains)
        return list(self._gains)

    def change_pack(self, sheet_id: int, material: str, touched_surface: str = "") -> PackInfo:
        """As Connection's; told again to a daemon that comes back."""
        pack = self._connection.change_pack(self._id, sheet_id, material, touched_surface)
        if sheet_id in self._sheets:
            now = self._sheets[sheet_id].now
            now.material, now.touched_surface = material or now.material, touched_surface or now.touched_surface
        return pack

    def start_recording(self, file_name: str = "") -> str:
        """Records from now on, in a file of the daemon's recording folder: a plain name, or empty for one that the daemon
        chooses. Returns the name.

        What sounds already, and the motion so far, is not in it: a session that is to be recorded whole is attached with
        SessionOptions(record=True). Ends with the session; a daemon that starts anew does not go on with it.
        """
        self._recording_file_name = self._connection.start_recording(self._id, file_name)
        return self._recording_file_name

    def stop_recording(self) -> RecordingInfo:
        """Returns when the file is closed."""
        stopped = self._connection.stop_recording(self._id)
        self._recording_file_name = ""
        return stopped

    def poll_notices(self) -> list[Notice]:
        """What the daemon said about this session's messages since the last call, oldest first; at most 1024 are kept."""
        self._take_answers()
        notices = list(self._notices)
        self._notices.clear()
        return notices

    def drain(self, timeout_s: float = 10.0) -> None:
        """Waits until everything sent was acknowledged. SIMULATION clock only; on the LIVE clock it returns at once.

        Errors: TimedOut, Unreachable, SessionLost.
        """
        if self._is_simulation:
            self._wait_until(lambda: not self._under_way and not self._pending, timeout_s)

    def detach(self, discard: bool = False) -> Statistics:
        """Ends the session at the daemon; returns its last figures. With `discard` what was not yet rendered is dropped."""
        self._link.ended = True
        statistics = self._connection.detach(self._id, discard, self._last_sequence)
        self._close()
        return statistics

    def abandon(self) -> None:
        """Leaves without a word, as a process that dies: the daemon finds out by itself. Nothing can be called afterwards."""
        self._close()

    # ---- under it

    @property
    def _is_simulation(self) -> bool:
        return self._options.clock is Clock.SIMULATION

    def _close(self) -> None:
        self._detached = True
        if self._recovery is not None:
            self._recovery.close()
            self._recovery = None
        self._link.sockets.close(self._stream, LINGER_MS)
        self._link.sockets.close(self._answers, 0)

    def _take_credit(self, credit: audio_pb2.FlowCredit) -> None:
        self._acknowledged = max(self._acknowledged, credit.acknowledged_sequence)
        self._window_messages, self._window_bytes = credit.window_messages, credit.window_bytes
        while self._under_way and self._under_way[0].sequence <= self._acknowledged:
            done = self._under_way.popleft()
            self._bytes_under_way -= done.bytes
            if self._reconnect:
                self._standing.take(done.message)

    def _take(self, parts: list[bytes]) -> None:
        if len(parts) != 2:
            return
        with contextlib.suppress(DecodeError):
            message = audio_pb2.OutMessage.FromString(parts[1])
            if message.HasField("credit"):
                self._take_credit(message.credit)
            if message.HasField("stored"):
                self._recording_file_name = message.stored.file_name
                self._stored_sequence = message.stored.sequence
            if message.HasField("notice"):
                notice = messages.read_notice(message.notice)
                if notice.code in ("idle", "unknown_session"):
                    self._lost = SessionLost(notice.code, notice.message, notice.remedy, notice.field)
                if notice.code == "ending" and self._link.elsewhere is not None:
                    self._leaving = True
                if notice.code == "storage":
                    self._recording_file_name = ""
                self._notices.append(notice)
                self._untold.append(notice)

    def _take_answers(self) -> None:
        if self._detached:
            return
        while parts := receive(self._answers):
            self._take(parts)
        while receive(self._stream):  # subscriptions of a daemon that came back
            pass
        while self._untold:
            self._on_notice(self._untold.popleft())

    def _has_room(self, size: int) -> bool:
        """A message larger than the whole window goes alone."""
        if not self._is_simulation:
            return True
        if len(self._under_way) >= self._window_messages:
            return False
        return self._window_bytes == 0 or not self._under_way or self._bytes_under_way + size <= self._window_bytes

    def _look(self) -> None:
        """Whether the session can still be there; a step of bringing it back where it is not."""
        if self._failure is not None:
            raise self._failure
        state = self._link.connection()
        if self._reconnect and not self._standing.ended:
            idle = self._lost is not None and self._lost.code_name == "idle"
            if self._recovery is None and (state.breaks != self._breaks or idle or self._leaving):
                self._breaks = state.breaks
                self._lost = None
                self._recovering_since = time.monotonic()
                self._recovery = reattach(self._link, self._id, self._attach_again(), self._gains,
                                          queue_messages(self._options.clock), idle, self._leaving, self._is_heard)
                self._leaving = False
            if self._recovery is not None:
                self._recover()
            self._send_pending()
        if self._lost is not None:
            raise self._lost
        if self._reconnect and not self._standing.ended:
            return
        self._link.check()
        # A daemon that came back may be another one. On the LIVE clock its notices tell; a simulation would wait for credit.
        if self._is_simulation and state.breaks != self._breaks and state.connected:
            self._connection.statistics(self._id)
            self._breaks = state.breaks

    def _is_heard(self) -> bool:
        """A simulation may be rendered before its readers are back; on the LIVE clock nobody waits."""
        return not self._is_simulation or all(reader.is_heard() for reader in list(self._readers))

    def _attach_again(self) -> session_pb2.Attach:
        """As the first time, with what was settled then; a simulation goes on from what was acknowledged."""
        attach = session_pb2.Attach()
        messages.write_attach(self._asked, attach)
        attach.options.rate_hz, attach.options.block_size = self._options.rate_hz, self._options.block_size
        del attach.sheets[:]
        attach.sheets.extend(sheet.now for sheet in self._sheets.values())  # for gains that concern them
        newest_s = self._standing.newest_time_s
        if self._is_simulation and newest_s is not None:
            samples = math.floor((newest_s - self._options.time_origin_s) * self._options.rate_hz)
            attach.options.time_origin_s = self._options.time_origin_s + max(0, samples) / self._options.rate_hz
        return attach

    def _recover(self) -> None:
        assert self._recovery is not None
        try:
            next(self._recovery)
        except StopIteration as done:
            self._recovery = None
            if done.value is not None:
                self._begin_again(done.value)
            elif self._tell_all:
                self._tell_again(self._standing.messages())
            self._tell_all = False
        except RustleError as error:
            self._recovery = None
            self._failure = error
            raise

    def _begin_again(self, again: Reattached) -> None:
        self._link.sockets.close(self._stream, 0)
        self._link.sockets.close(self._answers, 0)
        self._stream, self._answers = again.streams.stream, again.streams.answers
        if again.moved:
            self._breaks = 0  # of a connection that is new
        unacknowledged = [item.message for item in self._under_way]
        self._under_way.clear()
        self._bytes_under_way = 0
        self._lost = None
        self._reattached += 1
        self._tell_again([*self._standing.messages(), *unacknowledged])
        if again.attached.HasField("credit"):
            self._take_credit(again.attached.credit)
        self._recording_file_name = again.attached.recording_file_name
        for parts in again.streams.early:
            self._take(parts)
        away_s = time.monotonic() - self._recovering_since
        _log.warning("session %s: attached again at %s; the daemon was away for %.1f s", self._id, self._link.endpoints.control, away_s)

    def _note(self, sheet: sheet_pb2.Sheet) -> None:
        said = sheet.SerializeToString(deterministic=True)
        if sheet.sheet_id not in self._sheets or self._sheets[sheet.sheet_id].said != said:
            self._sheets[sheet.sheet_id] = _KnownSheet(said, sheet_pb2.Sheet.FromString(said))

    def _tell_again(self, told: Iterable[session_pb2.StreamMessage]) -> None:
        """To be sent before anything else, each sheet as it is now."""
        self._pending = collections.deque(told)
        for k, message in enumerate(self._pending):
            if message.HasField("sheet"):
                self._pending[k] = session_pb2.StreamMessage(sheet=self._sheets[message.sheet.sheet_id].now)

    def _put_off(self, message: session_pb2.StreamMessage) -> None:
        """Keeps for a daemon that is away."""
        if self._recovery is not None and len(self._pending) >= _PUT_OFF:
            self._tell_all = True
            self._pending.clear()
        if not self._tell_all:
            self._pending.append(message)

    def _send_pending(self) -> None:
        while self._recovery is None and self._pending and self._send_now(self._pending[0], keep_sequence=False):
            self._pending.popleft()

    def _send_now(self, message: session_pb2.StreamMessage, keep_sequence: bool) -> bool:
        """Numbers, stamps and sends, at once. False: there is no room."""
        message.session_id = self._id
        if not keep_sequence:
            message.sequence = self._next_sequence
            message.sent_at_s = time.monotonic()
        data = message.SerializeToString()
        if len(data) > MESSAGE_BYTES:
            raise RustleError("too_large", f"The message has {len(data)} bytes; a daemon takes {MESSAGE_BYTES}.",
                              "Send a coarser mesh, or several smaller ones.")
        if not self._has_room(len(data)) or not send(self._stream, [self._id.encode(), data]):
            return False
        sequence = message.sequence
        self._last_sequence = max(self._last_sequence, sequence)
        self._sent_messages += 1
        if sequence > 0:
            self._next_sequence = max(self._next_sequence, sequence + 1)
            if self._is_simulation:
                self._under_way.append(_UnderWay(message, sequence, len(data)))
                self._bytes_under_way += len(data)
        return True

    def _send(self, message: session_pb2.StreamMessage, keep_sequence: bool = False, may_drop: bool = True) -> Sent:
        if self._detached:
            raise Closed("closed", "The session was detached.", "Attach a new one.")
        self._take_answers()
        self._look()
        if message.HasField("sheet"):
            self._note(message.sheet)
        if not self._is_simulation:
            body = message.WhichOneof("body")
            if may_drop and body in _DROPPABLE:
                if self._reconnect:
                    self._standing.take(message)
                if self.connected and self._send_now(message, keep_sequence):
                    return Sent.QUEUED
                self._dropped_messages += 1
                self._next_sequence += 1
                return Sent.DROPPED
            if not self.connected and body in ("sheet", "topology", "scene"):
                self._standing.take(message)  # told when the session attaches again
                self._put_off(message)  # or here, where the daemon had the session all the time
                return Sent.QUEUED
        self._wait_until(lambda: self.connected and self._send_now(message, keep_sequence), self.send_timeout_s)
        if self._reconnect and not self._is_simulation:
            self._standing.take(message)
        return Sent.QUEUED

    def _wait_until(self, reached: Callable[[], bool], timeout_s: float) -> None:
        """Takes answers until `reached`. Errors: those of _look(), TimedOut, Unreachable."""
        deadline = time.monotonic() + timeout_s
        self._take_answers()
        self._look()
        while not reached():
            if time.monotonic() >= deadline:
                raise self._too_late(timeout_s)
            if self._recovery is not None:
                time.sleep(_STEP_S)
            elif self._is_simulation:
                self._answers.poll(milliseconds_until(deadline))
            else:
                self._answers.poll(milliseconds_until(deadline, _STEP_S))
            self._take_answers()
            self._look()

    def _too_late(self, waited_s: float) -> RustleError:
        if self._recovery is not None:
            return Unreachable("unreachable",
                               f"The daemon at {self._link.endpoints.control} is gone and did not come back within {waited_s:g} s.",
                               "See why rustled ended, start it again, or allow more time by send_timeout_s.")
        if self._is_simulation:
            return TimedOut("timeout",
                            f"The daemon at {self._link.endpoints.control} is there but acknowledged too little within "
                            f"{waited_s:g} s: {len(self._under_way)} messages are under way, the newest acknowledged is "
                            f"{self._acknowledged}.", "See in rustled's log what it is busy with, or allow more time.")
        return TimedOut("timeout", f"The queue to the daemon at {self._link.stream_endpoint} stayed full for {waited_s:g} s.",
                        "See in rustled's log what it is busy with, or allow more time.")
