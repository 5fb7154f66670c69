#!/usr/bin/python3
"""The daemon's side of its page: what viewers see and hear is what was sent and rendered, who may do what, and that viewers cost nobody else."""
import http.client
import json
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import numpy as np

from support import BIN, BUILD, RustleTest, grid, main, read_wav, rms_dbfs, table, wait_until
from support import rustle as run_rustle
from monitor_test import Watched
from page_client import Closed, Page, Refused, kind_of
from python_sdk_test import LIVE, SIMULATION, Motion, options

sys.path.insert(0, str(BUILD / "python"))
import rustle

NAMES = ("index.html", "assets/app-1234.js", "assets/look-5678.css", "favicon.svg")


class PageTest(RustleTest):
    def daemon(self, *more):
        self.site = self.folder / "site"
        (self.site / "assets").mkdir(parents=True, exist_ok=True)
        for name in NAMES:
            (self.site / name).write_text(f"<!-- {name} -->")
        os.environ["RUSTLE_PAGE_PATH"] = str(self.site)
        self.addCleanup(os.environ.pop, "RUSTLE_PAGE_PATH", None)
        return Watched(self.folder, *more)

    def get(self, daemon, path, headers=None, method="GET"):
        connection = http.client.HTTPConnection(daemon.address, timeout=20)
        try:
            connection.request(method, path, headers=headers or {})
            response = connection.getresponse()
            return response.status, {name.lower(): value for name, value in response.getheaders()}, response.read().decode()
        finally:
            connection.close()

    def page_figures(self, daemon):
        return json.loads(daemon.get("/figures")[2])["page"]


class Moving:
    """A live session whose sheet flaps and slides until it is left."""

    def __init__(self, connection, name="moving", rate_hz=60, motion=None, reader=False):
        self.motion, self.period = motion or Motion(), 1 / rate_hz
        self.session = rustle.Session.attach(connection, options(LIVE, name=name))
        self.reader = self.session.listen() if reader else None
        self.session.scene(0, obstacles=[rustle.Obstacle(1, rustle.Mesh(table()["obstacle0_triangles"], table()["obstacle0_vertices"])),
                                         rustle.Obstacle(2, rustle.Sphere(0.05))])
        self.session.add_topology(1, self.motion.triangles, material_coordinates=self.motion.material)
        self.left, self.thread = threading.Event(), threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        begun, k = time.monotonic(), 0
        while not self.left.is_set():
            t = k * self.period
            self.session.frame(1, 1, t, self.motion.at(1 - abs(1 - t % 2)))  # to and fro
            k += 1
            time.sleep(max(0, begun + k * self.period - time.monotonic()))

    @property
    def id(self):
        return self.session.id

    def __enter__(self):
        return self

    def __exit__(self, *why):
        self.left.set()
        self.thread.join()
        self.session.detach()


class Files(PageTest):
    def test_the_files_are_served_and_nothing_else_is(self):
        with self.daemon() as daemon:
            status, headers, body = self.get(daemon, "/")
            self.assertEqual((status, body, headers["content-type"], headers["cache-control"]),
                             (200, "<!-- index.html -->", "text/html; charset=utf-8", "no-cache"))
            self.assertIn(f"connect-src 'self' ws://{daemon.address}", headers["content-security-policy"])
            self.assertEqual(headers["x-content-type-options"], "nosniff")
            status, headers, body = self.get(daemon, "/assets/app-1234.js")
            self.assertEqual((status, headers["content-type"]), (200, "text/javascript; charset=utf-8"))
            self.assertIn("immutable", headers["cache-control"])
            self.assertEqual(self.get(daemon, "/", method="HEAD")[2], "")
            (self.folder / "secret.txt").write_text("secret")
            for path in ("/../secret.txt", "/assets/../../secret.txt", "/%2e%2e/secret.txt", "/assets/%2e%2e%2f%2e%2e%2fsecret.txt", "//secret.txt",
                         "/assets/", "/assets", "/.hidden", "/no.js", "/index.html/"):
                self.assertEqual(self.get(daemon, path)[0], 404, path)
            self.assertEqual(self.get(daemon, "/healthz")[0], 200)

    def test_without_files_the_page_says_what_to_do(self):
        with self.daemon() as daemon:
            (self.site / "index.html").unlink()
            status, _, body = self.get(daemon, "/")
            self.assertEqual(status, 200)
            for told in ("RUSTLE_PAGE_PATH", "/metrics", "/healthz", "RUSTLE_PAGE=ON"):
                self.assertIn(told, body)


class Seen(PageTest):
    def test_a_viewer_sees_what_was_sent(self):
        motion, sent = Motion(), {}
        with self.daemon() as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, Page(daemon.address) as page:
            hello = page.until("hello")
            self.assertEqual((hello["version"], hello["sample_rate"], hello["channels"], hello["rights"], hello["needs_key"]),
                             (1, 48000, 2, {"listen": True, "change": True}, False))
            self.assertIn("Sec-WebSocket-Protocol: rustle.page.1", page.head)
            with rustle.Session.attach(connection, options(LIVE)) as session:
                arrays = table()
                session.scene(0, obstacles=[rustle.Obstacle(7, rustle.Mesh(arrays["obstacle0_triangles"], arrays["obstacle0_vertices"])),
                                            rustle.Obstacle(9, rustle.Sphere(0.25))])
                session.add_topology(1, motion.triangles, material_coordinates=motion.material)
                session.listener(0, (1, 2, 3), (0, -1, 0))
                figures = page.until(lambda message: kind_of(message) == "figures" and message["sessions"], what="a session")
                self.assertEqual([each["id"] for each in figures["sessions"]], [session.id])
                page.send("watch", session=session.id, frames_per_second=30)
                for k in range(40):
                    t = 0.05 * k
                    sent[t] = motion.at(t)
                    session.frame(1, 1, t, sent[t])
                    time.sleep(0.05)
                page.until(lambda message: kind_of(message) == "frame" and message[2] == max(sent), what="the last frame")
                session.detach()
        topology, obstacle = page.of_kind("topology"), page.of_kind("obstacle")
        self.assertEqual(len(topology), 1)
        np.testing.assert_array_equal(topology[0][3], motion.triangles)
        self.assertEqual(topology[0][2], len(motion.material))
        np.testing.assert_array_equal(obstacle[0][2], arrays["obstacle0_vertices"])
        np.testing.assert_array_equal(obstacle[0][3], arrays["obstacle0_triangles"])
        frames = page.of_kind("frame")
        self.assertGreater(len(frames), 30)
        curved = 0
        for _, sheet, time_s, positions, regions, ridges, rulings in frames:
            self.assertEqual(sheet, 0)
            np.testing.assert_array_equal(positions, sent[time_s])
            self.assertLess(regions.max(), 0xffff)
            curved += len(rulings) > 0
            for start, end in rulings:  # the sheet bends along x: rulings run along y
                self.assertGreater(abs(end - start)[1], 5 * abs(end - start)[[0, 2]].max())
        self.assertGreater(curved, 10)
        scene = page.of_kind("scene")[-1]
        self.assertEqual((scene["session"], scene["listener"]["position"], scene["listener"]["forward"]), (session.id, [1, 2, 3], [0, -1, 0]))
        mesh, sphere = scene["obstacles"]
        self.assertEqual((mesh["id"], mesh["kind"], mesh["mesh"]), (7, "mesh", True))
        self.assertEqual((sphere["id"], sphere["kind"], sphere["radius"], sphere["orientation"]), (9, "sphere", 0.25, [1, 0, 0, 0]))
        self.assertEqual(scene["sheets"], [dict(index=0, id=1, name="", material="printer-paper", vertices=len(motion.material),
                                                triangles=len(motion.triangles))])
        events = page.of_kind("events")
        self.assertTrue(any(each["crumples"] for each in events))
        self.assertTrue(any(contact["slip_m_s"] > 0.01 for each in events for contact in each["contacts"]))
        for each in events:
            self.assertIn(each["time_s"], sent)

    def test_a_fold_shows_as_a_ridge(self):
        material, triangles = grid(0.2, 0.1, 40, 20)
        with self.daemon() as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, Page(daemon.address) as page:
            with rustle.Session.attach(connection, options(LIVE)) as session:
                session.add_topology(1, triangles, material_coordinates=material)
                folded = np.stack([np.abs(material[:, 0] - 0.1), material[:, 1], np.abs(material[:, 0] - 0.1)], 1) * np.float32([0.8, 1, 0.6])
                folded[:, 0] *= np.sign(material[:, 0] - 0.1)
                for k in range(4):
                    session.frame(1, 1, 0.1 * k, folded.astype(np.float32))
                    time.sleep(0.1)
                # Of a session that pauses, too, the newest is shown.
                page.send("watch", session=session.id)
                _, _, _, _, regions, ridges, _ = page.until("frame")
                session.detach()
        self.assertEqual(len(set(regions)), 2)
        self.assertGreaterEqual(len(ridges), 18)
        self.assertLess(np.abs(ridges[:, :, 0]).max(), 0.006)

    def test_frames_come_as_seldom_as_was_asked(self):
        with self.daemon() as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, Page(daemon.address) as page:
            with Moving(connection) as moving:
                page.send("watch", session=moving.id, frames_per_second=5)
                page.until("frame")
                heard = [message for message in page.listen_for(3) if kind_of(message) == "frame"]
                page.send("watch", session=None)
                page.listen_for(0.3)
                after = page.listen_for(0.5)
        self.assertLessEqual(len(heard), 17)
        self.assertGreaterEqual(len(heard), 8)
        self.assertFalse([message for message in after if kind_of(message) in ("frame", "events", "scene")])

    def test_figures_tell_of_sessions(self):
        with self.daemon() as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, Page(daemon.address) as page:
            with Moving(connection) as moving:
                moving.session.set_gains([rustle.Gain(-6), rustle.Gain(3, kind=rustle.SoundKind.FRICTION)])
                figures = page.until(lambda message: kind_of(message) == "figures" and message["sessions"] and
                                     message["sessions"][0]["rms_db"] is not None and message["latency_ms"]["p99"] is not None, what="sound")
                heard = [message for message in page.listen_for(2.1) if kind_of(message) == "figures"]
        session = figures["sessions"][0]
        self.assertEqual((session["clock"], session["sheets"], session["sample_rate"], session["channels"], session["ended"]),
                         ("live", 1, 48000, 2, False))
        self.assertEqual(session["gains_db"], {"master": -6, "friction": 3})
        self.assertGreater(session["peak_db"], session["rms_db"])
        self.assertEqual(session["frames"]["dropped"], {})
        self.assertGreater(session["frames"]["analysed"], 0)
        self.assertEqual((figures["load_level"], figures["load_level_name"], figures["viewers"]), (0, "full quality", 1))
        self.assertLessEqual(figures["latency_ms"]["p50"], figures["latency_ms"]["p99"])
        self.assertGreater(figures["cpu_share"], 0)
        self.assertIn(len(heard), range(5, 11))

    def test_nobody_looks_and_nothing_is_taken(self):
        with self.daemon() as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, Moving(connection) as moving:
            wait_until(lambda: moving.session.statistics().frames_analysed > 60, 20, "frames are not analysed")
            self.assertEqual(self.page_figures(daemon), dict(viewers=0, viewers_refused=0, frames_taken=0, messages_lost=0))
            with Page(daemon.address) as page:  # who looks at figures only has nothing taken either
                page.until("figures")
                self.assertEqual(self.page_figures(daemon), dict(viewers=1, viewers_refused=0, frames_taken=0, messages_lost=0))
                page.send("watch", session=moving.id)
                page.until("frame")
                self.assertGreater(self.page_figures(daemon)["frames_taken"], 0)
            wait_until(lambda: self.page_figures(daemon)["viewers"] == 0, 10, "the viewer does not leave")
            wait_until(lambda: self.page_figures(daemon) == self.page_figures(daemon), 10, "frames are still taken")
            taken = self.page_figures(daemon)["frames_taken"]
            analysed = moving.session.statistics().frames_analysed
            wait_until(lambda: moving.session.statistics().frames_analysed > analysed + 60, 20, "frames are not analysed")
            self.assertEqual(self.page_figures(daemon)["frames_taken"], taken)


class Heard(PageTest):
    def test_a_viewer_hears_what_a_listener_hears(self):
        with self.daemon() as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, Page(daemon.address) as page:
            with Moving(connection, reader=True) as moving:
                page.send("listen", session=moving.id)
                page.until(lambda message: kind_of(message) == "pcm" and message[1] > 96000, what="two seconds of sound")
                moving.left.set()
                moving.thread.join()
                moving.session.end()
                expected = moving.reader.read_all(30)
                page.listen_for(0.5)
        heard = page.of_kind("pcm")
        first = heard[0][1]
        for before, after in zip(heard, heard[1:]):
            self.assertEqual(before[1] + len(before[2]), after[1])
        samples = np.concatenate([message[2] for message in heard])
        self.assertGreater(rms_dbfs(samples), -60)
        begin = first - expected.first_sample
        self.assertGreaterEqual(begin, 0)
        np.testing.assert_array_equal(samples, expected.samples[begin:begin + len(samples)])
        self.assertEqual(begin + len(samples), len(expected.samples))

    def test_gains_and_the_listener_change_the_sound_and_are_recorded(self):
        with self.daemon("--recordings", self.folder / "takes", "--record-all") as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, \
                Page(daemon.address) as page:
            with Moving(connection, reader=True) as moving:
                page.send("watch", session=moving.id)
                page.send("listen", session=moving.id)

                def level(seconds=1.0):
                    page.listen_for(0.5)  # the playout delay
                    return rms_dbfs(np.concatenate([message[2] for message in page.listen_for(seconds) if kind_of(message) == "pcm"]))
                page.until("pcm")
                page.send("listener", session=moving.id, position=[0.2, -1, 0.5])
                page.until(lambda message: kind_of(message) == "scene" and message["listener"]["position"] == [0.2, -1, 0.5],
                           what="the listener's new place")
                near = level()
                page.send("gain", session=moving.id, kind="master", db=-20)
                quiet = level()
                page.until(lambda message: kind_of(message) == "figures" and message["sessions"][0]["gains_db"]["master"] == -20, what="the gain")
                page.send("gain", session=moving.id, kind="master", db=0)
                page.send("listener", session=moving.id, position=[0.2, -8, 4])
                page.until(lambda message: kind_of(message) == "scene" and message["listener"]["position"] == [0.2, -8, 4], what="the listener")
                far = level()
                page.send("gain", session=moving.id, kind="friction", db=None)
                page.send("gain", session=moving.id, kind="crumpling", db=None)
                page.send("gain", session=moving.id, kind="tearing", db=None)
                silent = level()
                moving.left.set()
                moving.thread.join()
                moving.session.end()
                sound = moving.reader.read_all(30)
            self.assertEqual([notice for notice in page.of_kind("notice") if notice["level"] != "info"], [])
        self.assertAlmostEqual(quiet - near, -20, delta=3)
        self.assertLess(far, near - 10)
        self.assertLess(silent, -120)
        # The recording holds what was changed: it gives the same samples.
        take, = (self.folder / "takes").iterdir()
        run_rustle("render", take, "-o", self.folder / "again.wav")
        again = read_wav(self.folder / "again.wav")[1].astype(np.float32)
        np.testing.assert_array_equal(again[sound.first_sample:], sound.samples)

    def test_a_recording_that_begins_later_knows_where_the_listener_is(self):
        with self.daemon("--recordings", self.folder / "takes") as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, \
                Page(daemon.address) as page:
            with Moving(connection) as moving:
                page.send("watch", session=moving.id)
                page.send("listen", session=moving.id)
                page.until("pcm")
                near = rms_dbfs(np.concatenate([message[2] for message in page.listen_for(2) if kind_of(message) == "pcm"]))
                page.send("listener", session=moving.id, position=[0.2, -15, 5])
                page.until(lambda message: kind_of(message) == "scene" and message["listener"]["position"] == [0.2, -15, 5], what="the listener")
                page.listen_for(0.5)
                moving.session.start_recording("take")
                heard = np.concatenate([message[2] for message in page.listen_for(2.5) if kind_of(message) == "pcm"])
                moving.session.stop_recording()
        run_rustle("render", self.folder / "takes/take.mcap", "-o", self.folder / "again.wav")
        again = read_wav(self.folder / "again.wav")[1]
        self.assertAlmostEqual(rms_dbfs(again[48000:]), rms_dbfs(heard[48000:]), delta=3)
        self.assertLess(rms_dbfs(heard), near - 10)


class Rights(PageTest):
    def refused(self, daemon, **how):
        with self.assertRaises(Refused) as refused:
            Page(daemon.address, **how)
        return refused.exception

    def test_pages_of_others_and_other_names_are_refused(self):
        with self.daemon("--http-name", "rustle.example.org") as daemon:
            port = daemon.address.split(":")[1]
            for origin in ("http://evil.example", f"http://evil.example:{port}", f"http://127.0.0.1:{int(port) ^ 1}", "null", "file://"):
                refused = self.refused(daemon, origin=origin)
                self.assertEqual(refused.status, 403, origin)
                self.assertIn("Origin", refused.body)
            # A name that was made to lead here: the browser believes it talks to the attacker's own machine.
            refused = self.refused(daemon, host=f"evil.example:{port}")
            self.assertEqual(refused.status, 403)
            self.assertIn("--http-name", refused.body)
            for path in ("/", "/figures", "/metrics"):
                self.assertEqual(self.get(daemon, path, {"Host": "evil.example"})[0], 403)
            self.assertEqual(self.refused(daemon, protocol="other").status, 400)
            self.assertEqual(self.get(daemon, "/live")[0], 426)
            for host in (f"localhost:{port}", "localhost:8080", "rustle.example.org", "127.0.0.1"):
                with Page(daemon.address, host=host) as page:
                    page.until("hello")
            with Page(daemon.address, host="rustle.example.org", origin="https://rustle.example.org") as page:  # through a TLS proxy
                page.until("hello")

    def test_mistakes_are_answered_and_change_nothing(self):
        with self.daemon() as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, Page(daemon.address) as page:
            with rustle.Session.attach(connection, options(LIVE)) as session:
                ours = dict(session=session.id)
                mistakes = [("{", "JSON"), ("[]", "JSON"), ("{}", "type"), ('{"type": 3}', "type"), ('{"type": "shout"}', "watch, listen"),
                            (dict(type="watch", session=7), "session"), (dict(type="watch", session="no"), "no session"),
                            (dict(type="watch", frames_per_second=31, **ours), "1 to 30"), (dict(type="watch", frames_per_second=0, **ours), "1 to 30"),
                            (dict(type="listen", session="no"), "no session"), (dict(type="gain", kind="master", db=1), "session"),
                            (dict(type="gain", kind="all", db=1, **ours), "kind"), (dict(type="gain", kind="master", db=25, **ours), "24"),
                            (dict(type="gain", kind="master", db="1", **ours), "db"), (dict(type="gain", kind="master", **ours), "db"),
                            (dict(type="gain", kind="master", db=1, session="no"), "no session"),
                            (dict(type="listener", position=[1, 2], **ours), "three numbers"),
                            (dict(type="listener", position=[1, 2, 1e6], **ours), "three numbers"),
                            (dict(type="listener", position=[1, 2, None], **ours), "three numbers"),
                            (dict(type="listener", position=[1, 2, 3], session="no"), "no session"), (dict(type="key", secret="short"), "40"),
                            (dict(type="key", secret="x" * 40), "asks nobody")]
                for mistake, told in mistakes:
                    page.send_raw((mistake if isinstance(mistake, str) else json.dumps(mistake)).encode())
                    notice = page.until("notice")
                    self.assertEqual(notice["level"], "error", mistake)
                    self.assertIn(told, notice["text"], mistake)
                page.send_raw(b"\0\1", opcode=2)
                self.assertIn("texts", page.until("notice")["text"])
                self.assertEqual(session.set_gains([]), [])
                page.send_raw(b"x" * 5000)
                with self.assertRaises(Closed) as closed:
                    page.until("notice")
                self.assertEqual(closed.exception.code, 1009)

    def test_so_many_may_look(self):
        with self.daemon("--max-viewers", "2") as daemon:
            with Page(daemon.address) as first, Page(daemon.address) as second:
                first.until("hello"), second.until("hello")
                refused = self.refused(daemon)
                self.assertEqual(refused.status, 503)
                self.assertIn("--max-viewers", refused.body)
                self.assertEqual(self.page_figures(daemon)["viewers_refused"], 1)

            def again():
                try:
                    Page(daemon.address).close()
                    return True
                except Refused:
                    return False
            wait_until(again, 10, "places are not given back")

    def key(self, name, *may):
        run_rustle("keys", "new", name, "--folder", self.folder / name)
        if may:
            run_rustle("keys", "allow", self.folder / name / f"{name}.key", *may, "--folder", self.folder / "server")
            (self.folder / name / "server.key").write_bytes((self.folder / "server/server.key").read_bytes())
        text = (self.folder / name / f"{name}.key_secret").read_text()
        return text.split('secret-key = "', 1)[1].split('"', 1)[0]

    def test_with_keys_the_page_is_for_reading_until_a_key_allows_more(self):
        run_rustle("keys", "new", "server", "--folder", self.folder / "server")
        alice, bob, eve = self.key("alice", "--publish"), self.key("bob", "--listen"), self.key("eve")
        root = self.key("root", "--admin")
        nothing, hears, all_of_it = (dict(listen=a, change=b) for a, b in ((False, False), (True, False), (True, True)))
        with self.daemon("--keys", self.folder / "server") as daemon:
            keys = rustle.Keys.read(self.folder / "alice")
            with rustle.Connection.connect(daemon.ends["control"], keys=keys) as connection, Moving(connection) as moving, \
                    Page(daemon.address) as page:
                hello = page.until("hello")
                self.assertEqual((hello["rights"], hello["needs_key"]), (nothing, True))

                def rights_here():
                    return page.until(lambda message: kind_of(message) == "figures" and message["sessions"])["sessions"][0]["rights"]

                page.send("watch", session=moving.id)
                page.until("frame")
                self.assertEqual(rights_here(), nothing)
                page.send("listen", session=moving.id)
                self.assertIn("permission listen", page.until("notice")["text"])
                page.send("gain", session=moving.id, kind="master", db=-3)
                self.assertIn("permission admin", page.until("notice")["text"])
                page.send("listener", session=moving.id, position=[0, -1, 1])
                self.assertIn("permission admin", page.until("notice")["text"])
                for secret, told in ((eve, "not allowed"), ("x" * 39 + "~", "no key")):
                    page.send("key", secret=secret)
                    self.assertIn(told, page.until("notice")["text"])
                self.assertEqual(page.of_kind("pcm"), [])
                self.assertEqual(moving.session.set_gains([]), [])

                page.send("key", secret=bob)
                hello = page.until("hello")
                self.assertEqual((hello["rights"], hello["needs_key"]), (hears, True))
                self.assertEqual(rights_here(), hears)
                page.send("listen", session=moving.id)
                page.until("pcm")
                page.send("gain", session=moving.id, kind="master", db=-3)
                self.assertIn("permission admin", page.until("notice")["text"])
                # Taken in no more, he hears no more.
                (self.folder / "server/allowed/bob.key").unlink()
                daemon.process.send_signal(signal.SIGHUP)
                self.assertEqual(page.until("hello")["rights"], nothing)
                page.listen_for(0.3)
                self.assertFalse([message for message in page.listen_for(0.5) if kind_of(message) == "pcm"])

                for secret in (alice, root):
                    page.send("key", secret=secret)
                    hello = page.until("hello")
                    self.assertEqual((hello["rights"], hello["needs_key"]), (all_of_it, False))
                    self.assertEqual(rights_here(), all_of_it)
                    page.send("listen", session=moving.id)
                    page.until("pcm")
                    db = -3 if secret == alice else -4
                    page.send("gain", session=moving.id, kind="master", db=db)
                    wait_until(lambda: moving.session.set_gains([]) == [rustle.Gain(db)], 5, "the gain does not change")

    def test_beyond_this_machine_only_with_keys(self):
        ends = [flag for name in ("control", "stream", "out") for flag in (f"--{name}", f"ipc://{self.folder}/{name}")]
        done = subprocess.run([BIN / "rustled", *ends, "--http", "0.0.0.0:*"], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 1)
        for told in ("--http 0.0.0.0", "--keys", "127.0.0.1", "--insecure"):
            self.assertIn(told, done.stderr)
        done = subprocess.run([BIN / "rustled", "--http-name", "http://x"], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 2)
        self.assertIn("network.http_names", done.stderr)


class Slow(PageTest):
    def test_who_does_not_read_loses_its_own_and_costs_nobody_else(self):
        class Large(Motion):
            def __init__(self):
                super().__init__()
                self.material, self.triangles = grid(0.2, 0.1, 120, 60)
        with self.daemon() as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection:
            with Moving(connection, rate_hz=30, motion=Large()) as moving:
                with Page(daemon.address) as reads, Page(daemon.address, receive_buffer=4096) as sleeps:
                    for page in (reads, sleeps):
                        page.until("hello")
                        page.send("watch", session=moving.id)
                        page.send("listen", session=moving.id)
                        page.until("frame")
                    heard = reads.listen_for(6)
                    pcm = [message for message in heard if kind_of(message) == "pcm"]
                    for before, after in zip(pcm, pcm[1:]):
                        self.assertEqual(before[1] + len(before[2]), after[1])
                    frames = [message for message in heard if kind_of(message) == "frame"]
                    self.assertGreater(len(frames), 60)
                    newest = frames[-1][2]
                    # It wakes: what it finds is what was on its way, then the newest, and sound that has a gap.
                    late = sleeps.listen_for(2)
                    times = [message[2] for message in late if kind_of(message) == "frame"]
                    self.assertGreater(times[-1], newest)
                    self.assertGreater(max(after - before for before, after in zip(times, times[1:])), 1)
                    pcm = [message for message in late if kind_of(message) == "pcm"]
                    gaps = [after[1] - before[1] - len(before[2]) for before, after in zip(pcm, pcm[1:])]
                    self.assertGreater(max(gaps), 48000)
                wait_until(lambda: self.page_figures(daemon)["messages_lost"] > 60, 10, "losses are not counted")
                self.assertEqual(moving.session.statistics().frames_dropped, {})

    def test_who_vanishes_leaves_nothing_behind(self):
        with self.daemon() as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, Moving(connection) as moving:
            files = pathlib.Path(f"/proc/{daemon.process.pid}/fd")
            wait_until(lambda: moving.session.statistics().frames_analysed > 10, 20, "frames are not analysed")
            before = len(list(files.iterdir()))
            for _ in range(20):
                page = Page(daemon.address)
                page.send("watch", session=moving.id)
                page.send("listen", session=moving.id)
                page.until("frame")
                page.socket.setsockopt(1, 13, b"\1\0\0\0\0\0\0\0")  # SO_LINGER 0: a reset instead of a goodbye
                page.close()
            wait_until(lambda: self.page_figures(daemon)["viewers"] == 0, 10, "viewers that are gone still count")
            wait_until(lambda: len(list(files.iterdir())) <= before + 1, 10, "connections stay open")

    def test_a_session_that_ends_is_told(self):
        with self.daemon() as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, Page(daemon.address) as page:
            with Moving(connection, name="first") as moving:
                page.send("watch", session=moving.id)
                page.until("frame")
            notice = page.until("notice")
            self.assertEqual((notice["level"], "first" in notice["text"]), ("info", True))
            with Moving(connection, name="first") as moving:  # the same name again
                page.send("watch", session=moving.id)
                page.until("frame")

    def test_the_daemon_ends_though_somebody_looks(self):
        with self.daemon() as daemon, rustle.Connection.connect(daemon.ends["control"]) as connection, Page(daemon.address) as page:
            with Moving(connection) as moving:
                page.send("watch", session=moving.id)
                page.send("listen", session=moving.id)
                page.until("pcm")
            daemon.process.terminate()
            self.assertEqual(daemon.process.wait(10), 0)
            with self.assertRaises(Closed):
                while True:
                    page.next(5)


if __name__ == "__main__":
    main()
