"""The Python SDK, driven line by line: see client_sdk/python. The drivers in C and C++ take the same commands.

A command is a verb and NAME=VALUE words on a line of standard input; the answer is a JSON object on a line of standard output. Its
"status" is ok, dropped, nothing or complete, or the kind of an error, of which code, code_name, field, message and remedy follow.
Arrays are files of raw numbers, little-endian: f32, u32.

    connect control=ENDPOINT [keys=FOLDER] [timeout=S]
    check [gone=1] [timeout=S]        waits until the daemon is there, or until it is not
    attach [name=] [clock=live|simulation] [reconnect=always|never] [material=] [sheets=N] [seed=] [channels=mono]     sheets 1 to N
    add_sheet id= [material=]
    add_topology id= vertices=V triangles=FILE [material=FILE]
    frames sheet= topology= vertices=V positions=FILE [first=0] [count=all] [start=S] [fps=60] [repeat=1]
           [contacts=FILE partner=OBSTACLE slip=X,Y,Z force=N]        of these vertices, in every frame
           [regions=FILE]         of the triangles, in every frame: 0 is curved and has a ruling and a singular point
    frames_until_reattached sheet= topology= vertices=V positions=FILE [timeout=S]     by the clock on the wall
    obstacle id= [time=] shape=plane|box|sphere|capsule|mesh [position=] [size=] [length=] [triangles=FILE vertices=FILE]
    move_obstacle id= time= position=      remove_obstacle id= time=
    listener time= position= [forward=]    tear_tips sheet= time= position= speed=
    advance time=      end [time=]         raw message=FILE            drain timeout=      send_timeout seconds=
    notice timeout=S       waits for the next one
    progress figures=...   of sent, dropped, next, acknowledged, reattached, connected
    statistics figures=A,B,...
    gain db= [sheet=] [kind=]
    listen [content=mix|stem|emitters] [sheet=] [kind=] [format=f32|s16|opus] [blocks=]
    read_all [timeout=] [to=FILE]
    blocks [timeout=] [to=FILE] [places=FILE]      until the sound is complete
    block [restarted=1] [timeout=]                 the next one, or the next of a daemon that was started anew
    observe                observations count= [to=FILE]      the first so many
    detach                 close                   frees session, reader and connection
"""
import json
import logging
import pathlib
import sys
import time

import numpy as np

import rustle

logging.getLogger("rustle").setLevel(logging.CRITICAL)

STATUS = ((rustle.InvalidArgument, "invalid_argument"), (rustle.Unreachable, "unreachable"), (rustle.TimedOut, "timed_out"),
          (rustle.SessionLost, "session_lost"), (rustle.Refused, "refused"), (rustle.Closed, "closed"), (rustle.RustleError, "other"))
SENT = {rustle.Sent.QUEUED: "ok", rustle.Sent.DROPPED: "dropped"}


class Words(dict):
    def number(self, name, otherwise=0.0):
        return float(self.get(name, otherwise))

    def whole(self, name, otherwise=0):
        return int(self.get(name, otherwise))

    def vector(self, name):
        return tuple(map(float, self[name].split(","))) if name in self else None

    def file(self, name, kind, *shape):
        return np.fromfile(self[name], kind).reshape(shape) if name in self else None


class Driver:
    def __init__(self):
        self.connection = self.session = self.reader = self.observer = self.last = None
        self.notices = []

    def connect(self, words):
        keys = rustle.Keys.read(words["keys"]) if "keys" in words else None
        self.connection = rustle.Connection.connect(words["control"], words.number("timeout", 30), keys=keys)

    def check(self, words):
        deadline = time.monotonic() + words.number("timeout", 30)
        while True:
            try:
                self.connection.check()
                if "gone" not in words or time.monotonic() > deadline:
                    return
            except rustle.Unreachable:
                if "gone" in words or time.monotonic() > deadline:
                    raise
            time.sleep(0.01)

    def attach(self, words):
        sheets = [rustle.SheetOptions(k + 1) for k in range(words.whole("sheets"))]
        options = rustle.SessionOptions(name=words.get("name", ""), clock=rustle.Clock(words.get("clock", "live")), seed=words.whole("seed"),
                                        channels=rustle.Channels(words.get("channels", "stereo")), default_material=words.get("material", ""),
                                        sheets=sheets)
        reconnect = {"always": True, "never": False}.get(words.get("reconnect"))
        self.session = rustle.Session.attach(self.connection, options, reconnect=reconnect, on_notice=lambda notice: None)
        return {"session": self.session.id, "rate_hz": self.session.options.rate_hz}

    def add_sheet(self, words):
        return self.session.add_sheet(rustle.SheetOptions(words.whole("id"), material=words.get("material", "")))

    def add_topology(self, words):
        return self.session.add_topology(words.whole("id"), words.file("triangles", "<u4", -1, 3), words.whole("vertices"),
                                         material_coordinates=words.file("material", "<f4", -1, 2))

    def frames(self, words):
        positions = words.file("positions", "<f4", -1, words.whole("vertices"), 3)
        first, start, fps = words.whole("first"), words.number("start"), words.number("fps", 60)
        contacts = None
        if "contacts" in words:
            vertices = words.file("contacts", "<u4", -1)
            slip, force = (np.array(value, np.float32) for value in (words.vector("slip"), words.number("force")))
            contacts = rustle.Contacts(vertices, np.zeros(len(vertices), int), [rustle.ContactPartner(words.whole("partner"))],
                                       np.tile(slip, (len(vertices), 1)), np.full(len(vertices), force, np.float32))
        regions = None
        if "regions" in words:
            regions = rustle.Partition(words.file("regions", "<u4", -1), np.array([True]), np.float32([[0, 0, 0, 1, 0, 0]]), np.array([0]),
                                       np.float32([[0, 0, 0]]))
        sent = rustle.Sent.QUEUED
        count = words.whole("count", len(positions) - first)
        for k in range(count * words.whole("repeat", 1)):
            sent = self.session.frame(words.whole("sheet"), words.whole("topology"), start + k / fps, positions[first + k % count], contacts=contacts,
                                      partition=regions)
        return sent

    def frames_until_reattached(self, words):
        positions = words.file("positions", "<f4", -1, words.whole("vertices"), 3)
        begun, k = time.monotonic(), 0
        while not (self.session.reattached and self.session.connected):
            if time.monotonic() - begun > words.number("timeout", 30):
                return {"status": "nothing"}
            self.session.frame(words.whole("sheet"), words.whole("topology"), time.monotonic(), positions[k % len(positions)])
            k += 1
            time.sleep(0.01)

    def obstacle(self, words):
        size = words.number("size", 1)
        shapes = {"plane": lambda: rustle.Plane(), "box": lambda: rustle.Box((size, size, size)), "sphere": lambda: rustle.Sphere(size),
                  "capsule": lambda: rustle.Capsule(size, words.number("length", 1)),
                  "mesh": lambda: rustle.Mesh(words.file("triangles", "<u4", -1, 3), words.file("vertices", "<f4", -1, 3))}
        pose = rustle.Pose(words.vector("position") or (0, 0, 0))
        return self.session.scene(words.number("time"), obstacles=[rustle.Obstacle(words.whole("id"), shapes[words["shape"]](), pose)])

    def move_obstacle(self, words):
        return self.session.scene(words.number("time"), poses={words.whole("id"): rustle.Pose(words.vector("position"))})

    def remove_obstacle(self, words):
        return self.session.scene(words.number("time"), removed=[words.whole("id")])

    def listener(self, words):
        return self.session.listener(words.number("time"), words.vector("position"), forward=words.vector("forward"))

    def tear_tips(self, words):
        tip = rustle.TearTip(1, words.vector("position"), words.number("speed"))
        return self.session.tear_tips(words.whole("sheet"), words.number("time"), [tip])

    def advance(self, words):
        return self.session.advance(words.number("time"))

    def end(self, words):
        return self.session.end(words.number("time") if "time" in words else None)

    def raw(self, words):
        return self.session.raw(pathlib.Path(words["message"]).read_bytes())

    def drain(self, words):
        self.session.drain(words.number("timeout"))

    def send_timeout(self, words):
        self.session.send_timeout_s = words.number("seconds")

    def notice(self, words):
        deadline = time.monotonic() + words.number("timeout", 20)
        self.notices += self.session.poll_notices()
        while not self.notices:
            if time.monotonic() > deadline:
                return {"status": "nothing"}
            time.sleep(0.005)
            self.notices += self.session.poll_notices()
        notice = self.notices.pop(0)
        return {"level": notice.level.value, "code": notice.code, "field": notice.field, "message": notice.message, "remedy": notice.remedy,
                "sequence": notice.sequence}

    def progress(self, words):
        session = self.session
        known = {"sent": session.sent_messages, "dropped": session.dropped_messages, "next": session.next_sequence,
                 "acknowledged": session.acknowledged_sequence, "reattached": session.reattached, "connected": int(session.connected)}
        return {name: known[name] for name in words["figures"].split(",")}

    def statistics(self, words):
        known = self.last if self.last else self.session.statistics()
        figures = {}
        for name in words["figures"].split(","):
            drop = name.removeprefix("frames_dropped.")
            figures[name] = known.frames_dropped.get(drop, 0) if drop != name else getattr(known, name)
        return figures

    def gain(self, words):
        kind = rustle.SoundKind(words["kind"]) if "kind" in words else None
        self.session.set_gains([rustle.Gain(words.number("db"), words.whole("sheet") if "sheet" in words else None, kind)])

    def listen(self, words):
        contents = {"mix": lambda: rustle.Mix(), "emitters": lambda: rustle.Emitters(),
                    "stem": lambda: rustle.Stem(words.whole("sheet"), rustle.SoundKind(words["kind"]))}
        options = rustle.ListenOptions(content=contents[words.get("content", "mix")](), format=rustle.SampleFormat(words.get("format", "f32")),
                                       blocks=words.whole("blocks", 4))
        self.reader = self.session.listen(options)

    def read_all(self, words):
        sound = self.reader.read_all(words.number("timeout", 60))
        if "to" in words:
            sound.samples.tofile(words["to"])
        return {"samples": len(sound.samples), "channels": sound.samples.shape[1], "rate_hz": sound.rate_hz, "first_sample": sound.first_sample,
                "gaps": len(sound.gaps)}

    def blocks(self, words):
        samples, places = [], []
        for block in self.reader:
            samples.append(block.samples)
            emitter, place = block.emitter, ""
            if emitter is not None:
                place = " ".join([str(emitter.emitter_id), str(emitter.sheet_id), emitter.kind.value, str(int(emitter.last)),
                                  *(f"{x:.9g}" for x in (*emitter.position, *emitter.normal))])
            places.append(f"{block.first_sample} {len(block.samples)} {place}\n")
        if "to" in words:
            np.concatenate(samples).tofile(words["to"])
        if "places" in words:
            pathlib.Path(words["places"]).write_text("".join(places))
        return {"status": "complete", "missing": self.reader.missing_samples}

    def block(self, words):
        deadline = time.monotonic() + words.number("timeout", 30)
        while time.monotonic() < deadline:
            block = self.reader.next(0.2)
            if block is not None and (block.restarted or "restarted" not in words):
                return None
        return {"status": "nothing"}

    def observe(self, words):
        self.observer = self.session.observe()

    def observations(self, words):
        lines, deadline = [], time.monotonic() + words.number("timeout", 60)
        for _ in range(words.whole("count")):
            seen = self.observer.next(max(0.0, deadline - time.monotonic()))
            if seen is None:
                return {"status": "nothing"}
            lines.append(f"sheet {seen.sheet_id} {seen.time_s:.9g}\n")
            for event in seen.crumpling:
                figures = (event.time_s, event.amplitude_m, event.area_m2, *event.position)
                lines.append(f"crumpling {event.event_id} {event.continues_event_id}{words_of(figures, event.resonators)}\n")
            for contact in seen.friction:
                figures = (contact.speed_m_per_s, contact.area_m2, *contact.position)
                lines.append(f"friction {contact.event_id} {contact.touched_surface}{words_of(figures, contact.resonators)}\n")
        if "to" in words:
            pathlib.Path(words["to"]).write_text("".join(lines))

    def detach(self, words):
        self.last = self.session.detach()

    def close(self, words):
        for reader in (self.reader, self.observer):
            if reader is not None:
                reader.close()
        self.session = None  # which tells the daemon
        if self.connection is not None:
            self.connection.close()
        self.__init__()


def words_of(figures, resonators):
    each = (f" {r.constrained:d} {r.coarse:d} {r.ruling_length_m:.9g} {r.free_border_length_m:.9g} {r.area_m2:.9g}" for r in resonators)
    return "".join(f" {x:.9g}" for x in figures) + "".join(each)


def error_of(error):
    status = next(name for kind, name in STATUS if isinstance(error, kind))
    return {"status": status, "code": error.code, "code_name": error.code_name, "field": error.field, "message": error.message,
            "remedy": error.remedy}


def main():
    driver = Driver()
    for line in sys.stdin:
        verb, *rest = line.split()
        try:
            told = getattr(driver, verb)(Words(word.split("=", 1) for word in rest))
        except rustle.RustleError as error:
            told = error_of(error)
        if isinstance(told, rustle.Sent):
            told = {"status": SENT[told]}
        print(json.dumps({"status": "ok", **(told or {})}), flush=True)


if __name__ == "__main__":
    main()
