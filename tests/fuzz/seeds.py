#!/usr/bin/python3
"""Writes the seeds of the targets that take messages or captures into tests/fuzz/corpus.
usage: tests/fuzz/seeds.py   (after a build: the messages of build/release/python)
"""
import pathlib
import struct
import sys
import zlib

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "build/release/python"))
from rustle.v1 import session_pb2

floats = lambda *values: struct.pack(f"<{len(values)}f", *values)
indices = lambda *values: struct.pack(f"<{len(values)}I", *values)
TRIANGLES = indices(0, 1, 2, 0, 2, 3)


def save(target, name, *messages):
    folder = HERE / "corpus" / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(b"".join(struct.pack("<H", len(m)) + m for m in (message.SerializeToString() for message in messages)))


def stream(**fields):
    message = session_pb2.StreamMessage(session_id="s", sequence=1)
    for name, value in fields.items():
        getattr(message, name).MergeFrom(value) if not callable(value) else value(getattr(message, name))
        getattr(message, name).SetInParent()
    return message


def frame(time_s, height=0.001, fill=lambda frame: None):
    def write(m):
        m.sheet_id, m.topology_id, m.time_s = 1, 7, time_s
        m.positions = floats(0, 0, height, 0.1, 0, 2 * height, 0.1, 0.1, height, 0, 0.1, height)
        fill(m)
    return stream(frame=write)


def contacts(m):
    m.contacts.vertices, m.contacts.partners = indices(0, 2), indices(0, 1)
    m.contacts.partner_table.add(obstacle_id=5)
    m.contacts.partner_table.add(sheet_id=1)
    m.contacts.slip_velocities, m.contacts.normal_forces = floats(1, 0, 0, 0, 1, 0), floats(0.1, 0.2)


def partition(m):
    m.partition.region_curved, m.partition.triangle_regions = b"\1", indices(0, 0xFFFFFFFF)
    m.partition.rulings, m.partition.ruling_regions = floats(0, 0, 0, 0.1, 0.1, 0), indices(0)
    m.partition.singular_points, m.partition.singular_on_border = floats(0.05, 0.05, 0), b"\0"


def tips(m):
    tip = m.tear_tips.add(tip_id=3, speed=0.2)
    tip.position.x, tip.direction.y = 0.05, 1


def everything(m):
    m.velocities, m.anchored, m.reset_history = floats(*[0.1] * 12), b"\1\0\0\0", True


def topology(m):
    m.topology_id, m.vertex_count, m.triangles = 8, 4, TRIANGLES
    m.rest_positions = floats(0, 0, 0, 0.2, 0, 0, 0.2, 0.1, 0, 0, 0.1, 0)


save("frame", "three", frame(0), frame(0.02, 0.03), frame(0.04, -0.01))
for name, fill in dict(contacts=contacts, partition=partition, tips=tips, everything=everything).items():
    save("frame", name, frame(0), frame(0.02, 0.01, fill), frame(0.04, 0.005, fill))
save("frame", "topology", stream(topology=topology), frame(0), frame(0.1, fill=lambda m: setattr(m, "topology_id", 8)))


def cloth(m):
    m.sheet_id, m.name, m.grammage_kg_per_m2, m.thickness_m = 2, "cloth", 0.1, 1e-4


def torn(m):
    m.sheet_id, m.time_s = 1, 0.03
    tip = m.tips.add(tip_id=1, speed=0.3)
    tip.position.x = 0.01


def announcement(m):
    m.protocol_version, m.name, m.options.clock = 1, "x", session_pb2.CLOCK_SIMULATION


save("frame", "others", stream(sheet=cloth), stream(announcement=announcement), frame(0), stream(tear_tips=torn),
     stream(advance=lambda m: setattr(m, "time_s", 0.05)), stream(end=lambda m: setattr(m, "time_s", 0.06)))


def shapes(m):
    m.time_s = 0.5
    box, sphere, capsule = (m.obstacles.add(obstacle_id=k) for k in (10, 11, 12))
    box.box.half_extents.x = box.box.half_extents.y = box.box.half_extents.z = 0.05
    sphere.sphere.radius, capsule.capsule.radius, capsule.capsule.half_length = 0.03, 0.01, 0.05
    sphere.pose.position.z, sphere.pose.orientation.w = 0.02, 1
    box.reflecting, box.reflection_coefficient, box.surface_material = True, 0.4, "steel"


def moved(m):
    m.time_s = 0.8
    pose = m.poses.add(obstacle_id=5).pose
    pose.position.z, pose.orientation.w, pose.orientation.x = 0.01, 0.9, 0.1
    m.vertices.add(obstacle_id=5, vertices=floats(-1, -1, 0, 1, -1, 0.1, 1, 1, 0, -1, 1, 0))
    m.removed_obstacle_ids.append(6)


def listener(m):
    m.position.y, m.forward.y, m.up.z = -1, 1, 1


save("scene", "shapes", stream(scene=shapes), stream(scene=moved), stream(listener=listener))
save("scene", "moved", stream(scene=moved), stream(scene=lambda m: m.MergeFrom(session_pb2.StreamMessage().scene)))


def request(**fields):
    message = session_pb2.ControlRequest(request_id=7, session_id="s")
    for name, fill in fields.items():
        fill(getattr(message, name))
        getattr(message, name).SetInParent()
    return message


def attach(m):
    m.name, m.options.rate_hz, m.options.block_size, m.options.playout_delay_s = "x", 44100, 64, 0.1
    m.options.up_axis, m.options.metres_per_unit, m.options.channels = session_pb2.UP_AXIS_Y, 0.01, session_pb2.CHANNEL_LAYOUT_MONO
    m.options.friction_fft_size, m.options.most_voices, m.options.default_material = 512, 32, "printer-paper"
    m.sheets.add(sheet_id=4, name="y", material="printer-paper")


def gains(m):
    m.gains.add(gain_db=-6, sheet_id=1)
    m.gains.add(gain_db=float("-inf"), kind=session_pb2.SOUND_KIND_FRICTION, material="printer-paper")


save("control", "attach", request(attach=attach))
save("control", "gains", request(set_gains=gains), request(set_gains=lambda m: m.gains.add(gain_db=3)))
save("control", "rest", request(hello=lambda m: setattr(m, "protocol_version", 1)), request(detach=lambda m: setattr(m, "discard", True)),
     *(request(**{name: lambda m: None}) for name in ("get_statistics", "list_packs", "list_sessions", "stop_recording")),
     request(change_pack=lambda m: (setattr(m, "sheet_id", 1), setattr(m, "material", "printer-paper"))),
     request(reload_pack=lambda m: setattr(m, "name", "x")), request(start_recording=lambda m: setattr(m, "file_name", "take")))

# ---- captures without checksums and compression, which a mutation would have to guess


def record(opcode, content):
    return bytes([opcode]) + struct.pack("<Q", len(content)) + content


def text(value):
    return struct.pack("<I", len(value)) + value.encode()


def capture(messages, chunked):
    magic = b"\x89MCAP0\r\n"
    schema = record(3, struct.pack("<H", 1) + text("rustle.v1.StreamMessage") + text("protobuf") + struct.pack("<I", 0))
    channels = record(4, struct.pack("<HH", 1, 1) + text("/s/frame/1") + text("protobuf") + struct.pack("<I", 0))
    body = schema + channels + b"".join(record(5, struct.pack("<HIQQ", 1, k, k * 10**6, k * 10**6) + m.SerializeToString())
                                        for k, m in enumerate(messages))
    if chunked:
        body = record(6, struct.pack("<QQQI", 0, 10**7, len(body), 0) + text("") + struct.pack("<Q", len(body)) + body)
    return magic + record(1, text("") + text("fuzz")) + body + record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0)) + magic


folder = HERE / "corpus/capture"
folder.mkdir(parents=True, exist_ok=True)
for name, chunked in (("plain", False), ("chunked", True)):
    (folder / name).write_bytes(capture([stream(topology=topology), frame(0), frame(0.02, 0.03)], chunked))
