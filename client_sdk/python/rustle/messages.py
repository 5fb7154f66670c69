"""Plain data into messages of proto/rustle/v1 and back. Not for applications. Pure.

Whatever writes a message checks it first: an InvalidArgument leaves nothing half sent.
"""
from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from . import arrays
from .errors import InvalidArgument, Refused, RustleError, SessionLost
from .types import (Array, Box, Capsule, Channels, Clock, Contacts, Floats, Gain, Mesh, Notice, NoticeLevel, Obstacle, PackInfo,
                    Partition, Plane, PlaybackStatistics, Pose, RecordingInfo, ServerInfo, ServerStatistics, SessionInfo, SessionOptions,
                    SheetKind, SheetOptions, SoundKind, Sphere, Statistics, SynthesisMode, TearTip, ThreadStatistics, UpAxis)
from .v1 import audio_pb2, scene_pb2, session_pb2, sheet_pb2

_CLOCKS = {Clock.LIVE: session_pb2.CLOCK_LIVE, Clock.SIMULATION: session_pb2.CLOCK_SIMULATION}
_UP_AXES = {UpAxis.Z: session_pb2.UP_AXIS_Z, UpAxis.Y: session_pb2.UP_AXIS_Y}
_MODES = {SynthesisMode.CORRECTED: session_pb2.SYNTHESIS_MODE_CORRECTED,
          SynthesisMode.PUBLISHED: session_pb2.SYNTHESIS_MODE_PUBLISHED}
_CHANNELS = {Channels.MONO: session_pb2.CHANNEL_LAYOUT_MONO, Channels.STEREO: session_pb2.CHANNEL_LAYOUT_STEREO,
             Channels.BINAURAL: session_pb2.CHANNEL_LAYOUT_BINAURAL}
_SHEET_KINDS = {SheetKind.PAPER: sheet_pb2.SHEET_KIND_PAPER, SheetKind.CLOTH: sheet_pb2.SHEET_KIND_CLOTH}
_SOUND_KINDS = {SoundKind.CRUMPLING: session_pb2.SOUND_KIND_CRUMPLING, SoundKind.FRICTION: session_pb2.SOUND_KIND_FRICTION,
                SoundKind.TEARING: session_pb2.SOUND_KIND_TEARING}
_LEVELS = {audio_pb2.NOTICE_LEVEL_WARNING: NoticeLevel.WARNING, audio_pb2.NOTICE_LEVEL_ERROR: NoticeLevel.ERROR}


def _choice(table: Mapping[Any, Any], value: Any, field: str) -> Any:
    if value not in table:
        kind = type(next(iter(table)))
        raise InvalidArgument(field, f"{value!r} is no {kind.__name__}.",
                              "Choose one of " + ", ".join(f"rustle.{member}" for member in table) + ".")
    return table[value]


def _named(table: Mapping[Any, int], value: int, otherwise: Any) -> Any:
    return next((name for name, number in table.items() if number == value), otherwise)


def _write_vector(value: Any, out: sheet_pb2.Vector3, field: str) -> None:
    out.x, out.y, out.z = arrays.vector(value, 3, field)
    out.SetInParent()


def _write_pose(pose: Pose, out: scene_pb2.Pose, field: str) -> None:
    _write_vector(pose.position, out.position, f"{field}.position")
    q = out.orientation
    q.w, q.x, q.y, q.z = arrays.vector(pose.orientation, 4, f"{field}.orientation")


def write_sheet(sheet: SheetOptions, out: sheet_pb2.Sheet, field: str = "sheet") -> None:
    out.sheet_id = arrays.identifier(sheet.id, f"{field}.id")
    out.name, out.material, out.touched_surface = sheet.name, sheet.material, sheet.touched_surface
    out.kind = _choice(_SHEET_KINDS, sheet.kind, f"{field}.kind")
    if sheet.grammage_kg_per_m2 is not None:
        out.grammage_kg_per_m2 = arrays.number(sheet.grammage_kg_per_m2, f"{field}.grammage_kg_per_m2")
    if sheet.thickness_m is not None:
        out.thickness_m = arrays.number(sheet.thickness_m, f"{field}.thickness_m")


def write_options(options: SessionOptions, out: session_pb2.SessionOptions) -> None:
    out.clock = _choice(_CLOCKS, options.clock, "options.clock")
    out.time_origin_s = arrays.number(options.time_origin_s, "options.time_origin_s")
    out.metres_per_unit = arrays.number(options.metres_per_unit, "options.metres_per_unit")
    out.up_axis = _choice(_UP_AXES, options.up_axis, "options.up_axis")
    out.seed = arrays.identifier(options.seed, "options.seed", 64)
    out.mode = _choice(_MODES, options.mode, "options.mode")
    if options.playout_delay_s is not None:
        out.playout_delay_s = arrays.number(options.playout_delay_s, "options.playout_delay_s")
    out.rate_hz = arrays.identifier(options.rate_hz, "options.rate_hz")
    out.block_size = arrays.identifier(options.block_size, "options.block_size")
    out.channels = _choice(_CHANNELS, options.channels, "options.channels")
    out.default_material = options.default_material
    out.record = options.record
    out.hrtf = options.hrtf
    out.friction_fft_size = arrays.identifier(options.friction_fft_size, "options.friction_fft_size")
    out.most_voices = arrays.identifier(options.most_voices, "options.most_voices")


def read_options(sent: session_pb2.SessionOptions, asked: SessionOptions) -> SessionOptions:
    """As in force; name and sheets are not in the message: they are kept."""
    return dataclasses.replace(
        asked, clock=_named(_CLOCKS, sent.clock, Clock.LIVE), time_origin_s=sent.time_origin_s,
        metres_per_unit=sent.metres_per_unit or 1.0, up_axis=_named(_UP_AXES, sent.up_axis, UpAxis.Z), seed=sent.seed,
        mode=_named(_MODES, sent.mode, SynthesisMode.CORRECTED),
        playout_delay_s=sent.playout_delay_s if sent.HasField("playout_delay_s") else None, rate_hz=sent.rate_hz,
        block_size=sent.block_size, channels=_named(_CHANNELS, sent.channels, Channels.STEREO),
        default_material=sent.default_material, record=sent.record, hrtf=sent.hrtf, friction_fft_size=sent.friction_fft_size,
        most_voices=sent.most_voices)


def write_attach(options: SessionOptions, out: session_pb2.Attach) -> None:
    out.name = options.name
    write_options(options, out.options)
    for k, sheet in enumerate(options.sheets):
        write_sheet(sheet, out.sheets.add(), f"options.sheets[{k}]")


def write_topology(topology_id: int, triangles: Any, vertex_count: int, material_coordinates: Floats | None,
                   rest_positions: Floats | None, out: sheet_pb2.Topology) -> None:
    """triangles [T,3] below vertex_count; material_coordinates [V,2]; rest_positions [V,3]."""
    out.topology_id = arrays.identifier(topology_id, "topology.id", 64)
    out.vertex_count = vertex_count
    out.triangles = arrays.indices(triangles, (None, 3), vertex_count, "topology.triangles", "vertices", "T")
    rows = f" for {vertex_count} vertices"
    if material_coordinates is not None:
        out.material_coordinates = arrays.floats(material_coordinates, (vertex_count, 2), "topology.material_coordinates", "V",
                                                 rows)
    if rest_positions is not None:
        out.rest_positions = arrays.floats(rest_positions, (vertex_count, 3), "topology.rest_positions", "V", rows)


def _write_contacts(contacts: Contacts, vertices: int, out: sheet_pb2.Contacts) -> None:
    field = "frame.contacts"
    out.vertices = arrays.indices(contacts.vertices, (None,), vertices, f"{field}.vertices", "vertices", "C")
    count = len(out.vertices) // 4
    out.partners = arrays.indices(contacts.partners, (count,), len(contacts.partner_table), f"{field}.partners",
                                  "partners in the table", "C")
    for k, partner in enumerate(contacts.partner_table):
        partner_id = arrays.identifier(partner.id, f"{field}.partner_table[{k}].id")
        entry = out.partner_table.add()
        if partner.is_sheet:
            entry.sheet_id = partner_id
        else:
            entry.obstacle_id = partner_id
    rows = f" for {count} contacts"
    if contacts.slip_velocities is not None:
        out.slip_velocities = arrays.floats(contacts.slip_velocities, (count, 3), f"{field}.slip_velocities", "C", rows)
    if contacts.normal_forces is not None:
        out.normal_forces = arrays.floats(contacts.normal_forces, (count,), f"{field}.normal_forces", "C", rows)
    out.SetInParent()


def _write_partition(partition: Partition, triangles: int, out: sheet_pb2.Partition) -> None:
    field = "frame.partition"
    out.region_curved = arrays.mask(partition.region_curved, (None,), f"{field}.region_curved", "R")
    regions = len(out.region_curved)
    out.triangle_regions = arrays.indices(partition.triangle_regions, (triangles,), regions, f"{field}.triangle_regions",
                                          "regions", "T", none=arrays.NO_REGION)
    out.rulings = arrays.floats(partition.rulings, (None, 6), f"{field}.rulings", "L")
    rulings = len(out.rulings) // 24
    out.ruling_regions = arrays.indices(partition.ruling_regions, (rulings,), regions, f"{field}.ruling_regions", "regions",
                                        "L")
    out.singular_points = arrays.floats(partition.singular_points, (None, 3), f"{field}.singular_points", "S")
    if partition.singular_on_border is not None:
        out.singular_on_border = arrays.mask(partition.singular_on_border, (len(out.singular_points) // 12,),
                                             f"{field}.singular_on_border", "S")
    out.SetInParent()


def write_tear_tips(tips: Iterable[TearTip], out: Any, field: str) -> None:
    for k, tip in enumerate(tips):
        sent = out.add()
        sent.tip_id = arrays.identifier(tip.id, f"{field}[{k}].id")
        _write_vector(tip.position, sent.position, f"{field}[{k}].position")
        sent.speed = arrays.number(tip.speed, f"{field}[{k}].speed")
        if tip.direction is not None:
            _write_vector(tip.direction, sent.direction, f"{field}[{k}].direction")


def write_frame(sheet_id: int, topology_id: int, time_s: float, positions: Floats, vertices: int, triangles: int,
                velocities: Floats | None, anchored: Array | None, reset_history: bool, contacts: Contacts | None,
                partition: Partition | None, tear_tips: Sequence[TearTip], out: sheet_pb2.MeshFrame) -> None:
    rows = f" for {vertices} vertices"
    out.sheet_id = arrays.identifier(sheet_id, "frame.sheet_id")
    out.topology_id = topology_id
    out.time_s = arrays.number(time_s, "frame.time_s")
    out.positions = arrays.floats(positions, (vertices, 3), "frame.positions", "V", rows)
    if velocities is not None:
        out.velocities = arrays.floats(velocities, (vertices, 3), "frame.velocities", "V", rows)
    if anchored is not None:
        out.anchored = arrays.mask(anchored, (vertices,), "frame.anchored", "V", rows)
    out.reset_history = reset_history
    if contacts is not None:
        _write_contacts(contacts, vertices, out.contacts)
    if partition is not None:
        _write_partition(partition, triangles, out.partition)
    write_tear_tips(tear_tips, out.tear_tips, "frame.tear_tips")


def _write_obstacle(obstacle: Obstacle, out: scene_pb2.Obstacle, field: str) -> None:
    out.obstacle_id = arrays.identifier(obstacle.id, f"{field}.id")
    out.name, out.surface_material, out.reflecting = obstacle.name, obstacle.surface_material, obstacle.reflecting
    out.reflection_coefficient = arrays.number(obstacle.reflection_coefficient, f"{field}.reflection_coefficient")
    shape = obstacle.shape
    if isinstance(shape, Plane):
        _write_vector(shape.point, out.plane.point, f"{field}.plane.point")
        _write_vector(shape.normal, out.plane.normal, f"{field}.plane.normal")
    elif isinstance(shape, Box):
        _write_vector(shape.half_extents, out.box.half_extents, f"{field}.box.half_extents")
    elif isinstance(shape, Sphere):
        out.sphere.radius = arrays.number(shape.radius, f"{field}.sphere.radius")
    elif isinstance(shape, Capsule):
        out.capsule.radius = arrays.number(shape.radius, f"{field}.capsule.radius")
        out.capsule.half_length = arrays.number(shape.half_length, f"{field}.capsule.half_length")
    elif isinstance(shape, Mesh):
        out.mesh.vertices = arrays.floats(shape.vertices, (None, 3), f"{field}.mesh.vertices", "V")
        out.mesh.triangles = arrays.indices(shape.triangles, (None, 3), len(out.mesh.vertices) // 12, f"{field}.mesh.triangles",
                                            "vertices", "T")
    else:
        raise InvalidArgument(f"{field}.shape", f"{type(shape).__name__} is no shape.",
                              "Give a Plane, Box, Sphere, Capsule or Mesh.")
    _write_pose(obstacle.pose, out.pose, f"{field}.pose")


def write_scene(time_s: float, obstacles: Iterable[Obstacle], poses: Mapping[int, Pose], vertices: Mapping[int, Floats],
                removed: Iterable[int], out: scene_pb2.SceneUpdate) -> None:
    out.time_s = arrays.number(time_s, "scene.time_s")
    for k, obstacle in enumerate(obstacles):
        _write_obstacle(obstacle, out.obstacles.add(), f"scene.obstacles[{k}]")
    for obstacle_id, pose in poses.items():
        moved = out.poses.add()
        moved.obstacle_id = arrays.identifier(obstacle_id, "scene.poses")
        _write_pose(pose, moved.pose, f"scene.poses[{obstacle_id}]")
    for obstacle_id, points in vertices.items():
        deformed = out.vertices.add()
        deformed.obstacle_id = arrays.identifier(obstacle_id, "scene.vertices")
        deformed.vertices = arrays.floats(points, (None, 3), f"scene.vertices[{obstacle_id}]", "V")
    out.removed_obstacle_ids.extend(arrays.identifier(obstacle_id, "scene.removed") for obstacle_id in removed)


def write_listener(time_s: float, position: Any, forward: Any, up: Any, out: scene_pb2.Listener) -> None:
    out.time_s = arrays.number(time_s, "listener.time_s")
    _write_vector(position, out.position, "listener.position")
    if forward is not None:
        _write_vector(forward, out.forward, "listener.forward")
    if up is not None:
        _write_vector(up, out.up, "listener.up")


def write_gains(gains: Iterable[Gain], out: session_pb2.SetGains) -> None:
    out.SetInParent()
    for k, gain in enumerate(gains):
        sent = out.gains.add()
        silence = gain.gain_db == -math.inf
        sent.gain_db = gain.gain_db if silence else arrays.number(gain.gain_db, f"gains[{k}].gain_db")
        if gain.sheet_id is not None:
            sent.sheet_id = arrays.identifier(gain.sheet_id, f"gains[{k}].sheet_id")
        if gain.kind is not None:
            sent.kind = _choice(_SOUND_KINDS, gain.kind, f"gains[{k}].kind")
        sent.material = gain.material


# ---- what the daemon says

def read_error(error: session_pb2.Error) -> RustleError:
    name = session_pb2.ErrorCode.Name(error.code) if error.code in session_pb2.ErrorCode.values() else "ERROR_CODE_ERROR"
    kind = SessionLost if error.code in (session_pb2.ERROR_CODE_UNKNOWN_SESSION, session_pb2.ERROR_CODE_IDLE) else Refused
    return kind(name[len("ERROR_CODE_"):].lower(), error.message, error.remedy, error.field, error.code)


def read_welcome(welcome: session_pb2.Welcome) -> ServerInfo:
    return ServerInfo(welcome.server, welcome.stream_endpoint, welcome.out_endpoint, welcome.rate_hz, welcome.block_size,
                      welcome.sessions, welcome.most_sessions)


def read_pack(pack: session_pb2.PackInfo) -> PackInfo:
    return PackInfo(pack.name, pack.material, pack.touched_surface, pack.version, pack.licence, pack.rate_hz, pack.units,
                    pack.spectra, tuple(pack.models))


def read_session(session: session_pb2.SessionInfo) -> SessionInfo:
    so_far = session.recording
    recording = RecordingInfo(so_far.file_name, so_far.messages, so_far.bytes) if session.HasField("recording") else None
    return SessionInfo(session.session_id, session.name, _named(_CLOCKS, session.clock, Clock.LIVE), session.sheets,
                       session.newest_time_s, recording)


def read_statistics(sent: session_pb2.Statistics) -> Statistics:
    names = [field.name for field in dataclasses.fields(Statistics) if field.name != "frames_dropped"]
    return Statistics(frames_dropped=dict(sent.frames_dropped), **{name: getattr(sent, name) for name in names})


def read_server_statistics(sent: session_pb2.ServerStatistics) -> ServerStatistics:
    def read(kind: type, message: Any) -> Any:
        return kind(*(getattr(message, field.name) for field in dataclasses.fields(kind)))

    threads = tuple(read(ThreadStatistics, thread) for thread in sent.threads)
    playback = read(PlaybackStatistics, sent.playback) if sent.HasField("playback") else None
    return ServerStatistics(sent.uptime_s, sent.cpu_s, sent.sessions, threads, playback)


def read_gains(sent: session_pb2.GainsSet) -> list[Gain]:
    return [Gain(gain.gain_db, gain.sheet_id if gain.HasField("sheet_id") else None, _named(_SOUND_KINDS, gain.kind, None),
                 gain.material) for gain in sent.gains]


def read_notice(notice: audio_pb2.Notice) -> Notice:
    return Notice(_LEVELS.get(notice.level, NoticeLevel.INFO), notice.code, notice.field, notice.message, notice.remedy,
                  notice.sequence, notice.count)
