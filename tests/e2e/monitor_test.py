#!/usr/bin/python3
"""What a running daemon tells over HTTP: figures that add up, health that turns when it should, frames from receipt to sound."""
import contextlib
import ctypes
import http.client
import json
import math
import os
import pathlib
import re
import signal
import subprocess
import sys
import time

import numpy as np

from support import BIN, BUILD, SOURCE, RustleTest, daemon, main, rustle as run_rustle
from python_sdk_test import LIVE, SIMULATION, Motion, options

sys.path.insert(0, str(BUILD / "python"))
import rustle

DASHBOARD = SOURCE / "deploy/grafana/rustle.json"


class Watched:
    """A daemon that serves HTTP on a port of its own."""

    def __init__(self, folder, *more):
        self.log = folder / "log"
        self.stack = contextlib.ExitStack()
        self.ends = self.stack.enter_context(daemon(folder, "--http", "127.0.0.1:*", "--log-format", "json", *more, log=self.log))
        self.process = self.ends["process"]
        self.address = None
        if not await_true(self.told_address, 60):
            self.stack.close()
            raise AssertionError("the daemon does not tell its HTTP address")

    def told_address(self):
        for line in self.lines():
            if found := re.match(r"http (127\.0\.0\.1:\d+): ", line["message"]):
                self.address = found[1]
        return self.address

    def lines(self):
        return [json.loads(line) for line in self.log.read_text().splitlines()]

    def get(self, path):
        """(status, content type, body)"""
        connection = http.client.HTTPConnection(self.address, timeout=20)
        try:
            connection.request("GET", path)
            response = connection.getresponse()
            return response.status, response.getheader("Content-Type"), response.read().decode()
        finally:
            connection.close()

    def metrics(self):
        status, kind, text = self.get("/metrics")
        assert status == 200 and kind.startswith("text/plain; version=0.0.4"), (status, kind)
        return parse_metrics(text)

    def health(self):
        status, _, body = self.get("/healthz")
        told = json.loads(body)
        assert (status == 200) == told["healthy"] == (not told["problems"]), body
        return told

    def trace(self, session, **query):
        more = "".join(f"&{key}={value}" for key, value in query.items())
        status, _, body = self.get(f"/trace?session={session}{more}")
        assert status == 200, body
        return json.loads(body)["frames"]

    def __enter__(self):
        return self

    def __exit__(self, *why):
        return self.stack.__exit__(*why)


NAME = r"[a-zA-Z_:][a-zA-Z0-9_:]*"
LABEL = r'([a-zA-Z_][a-zA-Z0-9_]*)="((?:[^"\\\n]|\\["\\n])*)"'
SAMPLE = re.compile(rf"({NAME})(?:\{{((?:{LABEL})(?:,{LABEL})*)\}})? ([-+0-9.eE]+|[+-]Inf|NaN)")


def parse_metrics(text):
    """{(name, labels): value}; fails where the text is not the Prometheus text format 0.0.4 to the letter."""
    assert text.endswith("\n")
    types, helps, samples, family = {}, set(), {}, None
    for line in text.splitlines():
        if line.startswith("# HELP "):
            _, _, name, words = line.split(" ", 3)
            assert re.fullmatch(NAME, name) and name not in helps and words, line
            helps.add(name)
        elif line.startswith("# TYPE "):
            _, _, name, kind = line.split(" ")
            assert name in helps and name not in types and kind in ("counter", "gauge", "histogram"), line
            assert kind != "counter" or name.endswith("_total"), f"{line}: counters end in _total"
            types[name], family = kind, name
        else:
            match = SAMPLE.fullmatch(line)
            assert match, line
            name, labels = match[1], tuple(re.findall(LABEL, match[2] or ""))
            ends = ("_bucket", "_sum", "_count") if types[family] == "histogram" else ("",)
            assert name in [family + end for end in ends], f"{line}: not of the family {family}"
            assert len({key for key, _ in labels}) == len(labels) and (name, labels) not in samples, line
            samples[name, labels] = float(match.groups()[-1])
    for name, kind in types.items():
        if kind == "histogram":
            check_histogram(name, samples)
    return samples


def check_histogram(name, samples):
    series = {}
    for (sample, labels), value in samples.items():
        if sample == f"{name}_bucket":
            rest = tuple(label for label in labels if label[0] != "le")
            series.setdefault(rest, []).append((float(dict(labels)["le"]), value))
    assert series, name
    for labels, buckets in series.items():
        ends, counts = zip(*buckets)
        assert list(ends) == sorted(ends) and math.isinf(ends[-1]), (name, labels)
        assert list(counts) == sorted(counts) and counts[-1] == samples[f"{name}_count", labels], (name, labels)
        counted = [here - before for here, before in zip(counts, (0, *counts))]
        least = sum(number * start for number, start in zip(counted, (0, *ends)))
        assert samples[f"{name}_sum", labels] >= 0.999999 * least, (name, labels)


def await_true(condition, seconds=20):
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.05)
    return False


class Halted:
    """One thread of a process stopped, as a debugger stops it."""

    ATTACH, DETACH = 16, 17

    def __init__(self, pid, thread_name):
        self.libc = ctypes.CDLL(None, use_errno=True)
        tasks = pathlib.Path(f"/proc/{pid}/task")
        self.threads = [int(task.name) for task in tasks.iterdir() if (task / "comm").read_text().strip() == thread_name]
        assert self.threads, f"there is no thread {thread_name}"

    def __enter__(self):
        for thread in self.threads:
            if self.libc.ptrace(self.ATTACH, thread, None, None) != 0:
                raise AssertionError(f"ptrace: {os.strerror(ctypes.get_errno())}")
            os.waitpid(thread, 0x40000000)  # __WALL

    def __exit__(self, *why):
        for thread in self.threads:
            self.libc.ptrace(self.DETACH, thread, None, None)


def play_live(session, motion, seconds):
    """Frames at 60 a second in real time, after the sheet was described."""
    start = time.monotonic()
    for k in range(round(seconds * 60)):
        time.sleep(max(0.0, start + k / 60 - time.monotonic()))
        session.frame(1, 1, k / 60, motion.at(k / 60))


class Figures(RustleTest):
    def test_metrics_are_the_sums_of_what_the_sdk_is_told(self):
        motion, told = Motion(), {}
        with Watched(self.folder) as watched, rustle.Connection.connect(watched.ends["control"]) as connection:
            with rustle.Session.attach(connection, options(name="gone")) as session, session.listen() as reader:
                motion.play(session, 0.5)
                reader.read_all()
                told["gone"] = session.detach()
            session = rustle.Session.attach(connection, options(name="here"))
            with session.listen() as reader:
                motion.play(session, 0.7)
                reader.read_all()
                told["here"] = connection.statistics("here")
                metrics = watched.metrics()
            everyone = told.values()
            total = lambda name: sum(getattr(each, name) for each in everyone)
            for metric, name in (("frames_received", "frames_received"), ("frames_analysed", "frames_analysed"),
                                 ("messages_received", "messages_received"), ("samples_due", "samples_due"),
                                 ("samples_sent", "samples_sent"), ("pcm_gaps", "pcm_gaps"), ("input_gaps", "input_gaps"),
                                 ("voices_stolen", "voices_stolen"), ("sequence_gaps", "sequence_gaps")):
                self.assertEqual(metrics[f"rustle_{metric}_total", ()], total(name), metric)
            for kind, name in (("crumpling", "crumpling_events"), ("friction", "friction_episodes")):
                self.assertGreater(total(name), 0)
                self.assertEqual(metrics["rustle_events_total", (("kind", kind),)], total(name))
            self.assertEqual(total("frames_received"), 30 + 42)
            self.assertEqual(metrics["rustle_sessions_total", ()], 2)
            self.assertEqual(metrics["rustle_sessions", (("clock", "simulation"),)], 1)
            self.assertEqual(metrics["rustle_session_frames_received_total", (("session", "here"),)], 42)
            self.assertNotIn(("rustle_session_frames_received_total", (("session", "gone"),)), metrics)
            for stage in ("decode", "wait", "analysis", "hand_over"):
                self.assertEqual(metrics["rustle_stage_seconds_count", (("stage", stage),)], total("frames_received"), stage)
            self.assertEqual(metrics["rustle_frame_to_sound_seconds_count", ()], 0)  # live sessions only
            again = watched.metrics()
            for key, value in metrics.items():
                if key[0].endswith(("_total", "_count", "_bucket")):
                    self.assertGreaterEqual(again[key], value, key)
            session.detach()

    def test_drops_are_counted_by_cause_and_frames_add_up(self):
        motion = Motion()
        with Watched(self.folder) as watched, rustle.Connection.connect(watched.ends["control"]) as connection:
            with rustle.Session.attach(connection, options(LIVE, name="burst", playout_delay_s=0.04)) as session:
                session.add_topology(1, motion.triangles, material_coordinates=motion.material)
                for k in range(60):  # at once: more than may wait
                    session.frame(1, 1, k / 60, motion.at(k / 60))
                session.frame(1, 1, 59 / 60, motion.at(59 / 60))  # a time that has been: refused before it is analysed
                self.assertTrue(await_true(lambda: connection.statistics("burst").frames_received == 61))
                self.assertTrue(await_true(lambda: watched.metrics()["rustle_frames_waiting", ()] == 0))
                metrics, figures = watched.metrics(), connection.statistics("burst")
                drops = {dict(labels)["cause"]: value for (name, labels), value in metrics.items()
                         if name == "rustle_frames_dropped_total"}
                self.assertEqual(drops, figures.frames_dropped)
                self.assertEqual(drops["time_order"], 1)
                self.assertEqual(metrics["rustle_frames_received_total", ()],
                                 metrics["rustle_frames_analysed_total", ()] + sum(drops.values()))
                traced = {frame["frame"]: frame for frame in watched.trace("burst", newest=1024)}
                self.assertEqual(sorted(traced), list(range(1, 61)))  # what could be read
                self.assertEqual(sum(frame["dropped"] == "backlog" for frame in traced.values()), drops["backlog"])

    def test_dashboard_names_metrics_that_exist(self):
        motion = Motion()
        with Watched(self.folder) as watched, rustle.Connection.connect(watched.ends["control"]) as connection:
            with rustle.Session.attach(connection, options(LIVE, playout_delay_s=0.04)) as session:
                motion.play(session, 0.2)
                session.frame(1, 1, 0.1, motion.at(0.1))
                self.assertTrue(await_true(lambda: any(name.endswith("dropped_total") for name, _ in watched.metrics())))
                told = {name for name, _ in watched.metrics()}
        dashboard = json.loads(DASHBOARD.read_text())
        queries = [target["expr"] for panel in dashboard["panels"] for target in panel.get("targets", [])]
        queries += [variable["query"] for variable in dashboard["templating"]["list"] if variable["type"] == "query"]
        self.assertGreater(len(queries), 10)
        named = {name for query in queries for name in re.findall(r"\b(?:rustle|process)_[a-z_]+", query)}
        self.assertEqual(named - told, set())
        self.assertEqual(len({panel["id"] for panel in dashboard["panels"]}), len(dashboard["panels"]))
        for panel in dashboard["panels"]:
            self.assertTrue(panel["title"])
            for target in panel.get("targets", []):
                self.assertEqual(target["datasource"]["uid"], "${datasource}")

    def test_other_paths_and_methods(self):
        with Watched(self.folder) as watched:
            self.assertEqual(watched.get("/nothing")[0], 404)
            self.assertEqual(watched.get("/trace")[0], 400)
            self.assertEqual(watched.get("/trace?session=nobody")[0], 404)
            self.assertEqual(watched.get("/trace?session=nobody&frame=x")[0], 400)
            self.assertEqual(watched.get("/trace?session=nobody&colour=1")[0], 400)
            self.assertEqual(watched.get("/healthz")[0], 200)

    def test_address(self):
        with Watched(self.folder) as watched:
            other = self.folder / "other"
            other.mkdir()
            ends = [part for name in ("control", "stream", "out") for part in (f"--{name}", f"ipc://{other}/{name}")]
            done = subprocess.run([BIN / "rustled", *ends, "--http", watched.address], capture_output=True, text=True, timeout=20)
            self.assertEqual(done.returncode, 1)
            self.assertRegex(done.stderr, rf"rustled: --http {watched.address}: .*; give another")
        done = subprocess.run([BIN / "rustled", "--http", "nonsense"], capture_output=True, text=True, timeout=20)
        self.assertEqual(done.returncode, 2)
        self.assertIn("network.http", done.stderr)


class Health(RustleTest):
    def test_unwell_while_the_network_thread_stands_still(self):
        with Watched(self.folder) as watched:
            self.assertTrue(watched.health()["healthy"])
            with Halted(watched.process.pid, "rustled"):
                told = watched.health()
                self.assertFalse(told["healthy"])
                self.assertIn("network thread", told["problems"][0])
                self.assertEqual(watched.get("/metrics")[0], 503)
            self.assertTrue(await_true(lambda: watched.health()["healthy"]))

    def test_unwell_while_rendering_or_analysis_stand_still(self):
        motion = Motion()
        with Watched(self.folder) as watched, rustle.Connection.connect(watched.ends["control"]) as connection:
            with rustle.Session.attach(connection, options(LIVE, name="flag")) as session:
                session.add_topology(1, motion.triangles, material_coordinates=motion.material)
                self.assertTrue(watched.health()["healthy"])
                with Halted(watched.process.pid, "rustle-render"):
                    self.assertTrue(await_true(lambda: not watched.health()["healthy"]))
                    self.assertRegex(watched.health()["problems"][0], "flag.*not rendered")
                self.assertTrue(await_true(lambda: watched.health()["healthy"]))
                missed = {dict(labels)["cause"]: value for (name, labels), value in watched.metrics().items()
                          if name == "rustle_deadlines_missed_total"}
                self.assertGreater(sum(missed.values()), 100)  # half a second of blocks
                with Halted(watched.process.pid, "rustle-analyse"), Halted(watched.process.pid, "rustle-short"):
                    session.frame(1, 1, 0, motion.at(0))
                    self.assertTrue(await_true(lambda: not watched.health()["healthy"]))
                    self.assertRegex(watched.health()["problems"][0], "flag.*waited for analysis")
                self.assertTrue(await_true(lambda: watched.health()["healthy"]))


class Traces(RustleTest):
    def assert_same_frame(self, told, before):
        """The system's time of a frame is told anew each time, from how long ago it came."""
        self.assertEqual(len(told), 1)
        self.assertAlmostEqual(told[0]["received_unix_s"], before[0]["received_unix_s"], delta=0.02)
        self.assertEqual({**told[0], "received_unix_s": 0}, {**before[0], "received_unix_s": 0})

    def test_any_frame_from_receipt_to_its_first_sample(self):
        motion = Motion()
        with Watched(self.folder) as watched, rustle.Connection.connect(watched.ends["control"]) as connection:
            with rustle.Session.attach(connection, options(LIVE, name="a flag", playout_delay_s=0.1)) as session:
                reader = session.listen(rustle.ListenOptions(blocks=1))
                session.add_topology(1, motion.triangles, material_coordinates=motion.material)
                began = time.time()
                play_live(session, motion, 1)
                self.assertTrue(await_true(lambda: watched.trace("a%20flag")[-1]["sent_ms"] is not None))
                frames = watched.trace("a%20flag", newest=1024)
                figures = connection.statistics("a flag")
                self.assertEqual([frame["frame"] for frame in frames], list(range(1, 61)))
                heard = [frame for frame in frames if frame["dropped"] is None]
                self.assertEqual(len(heard), figures.frames_analysed)
                for frame in heard:
                    stations = [0] + [frame[f"{name}_ms"] for name in ("decoded", "begun", "analysed", "accepted", "sent")]
                    self.assertEqual(stations, sorted(stations), frame)
                    self.assertEqual(frame["playout_delay_ms"], 100)
                    self.assertAlmostEqual(frame["sent_ms"] - 100, frame["beyond_delay_ms"], delta=1e-6)
                    self.assertGreater(frame["sent_ms"], 50)
                    self.assertLess(abs(frame["received_unix_s"] - began), 60)
                self.assertEqual(sorted(frame["first_sample"] for frame in heard), [frame["first_sample"] for frame in heard])
                metrics = watched.metrics()
                self.assertEqual(metrics["rustle_frame_to_sound_seconds_count", ()], len(heard))
                one = watched.trace("a%20flag", frame=30)
                self.assertEqual([frame["frame"] for frame in one], [30])
                self.assert_same_frame(watched.trace("a%20flag", sequence=one[0]["sequence"]), one)

                told = json.loads(run_rustle("trace", "a flag", "--http", watched.address, "--frame", 30, "--json").stdout)
                self.assert_same_frame(told["frames"], one)
                table = run_rustle("trace", "a flag", "--http", watched.address, "--newest", 3).stdout.splitlines()
                self.assertEqual([line.split()[0] for line in table], ["frame", "58", "59", "60"])
                self.assertIn("no such frame", run_rustle("trace", "a flag", "--http", watched.address, "--frame", 99, status=1).stderr)
                self.assertIn('no session "x"', run_rustle("trace", "x", "--http", watched.address, status=1).stderr)
                reader.close()

    def test_top(self):
        motion = Motion()
        with Watched(self.folder) as watched, rustle.Connection.connect(watched.ends["control"]) as connection:
            with rustle.Session.attach(connection, options(name="flag")) as session:
                motion.play(session, 0.5)
                self.assertTrue(await_true(lambda: connection.statistics("flag").frames_analysed == 30))
                told = json.loads(run_rustle("top", "--http", watched.address, "--once", "--json").stdout)
                figures = connection.statistics("flag")
                [flag] = told["sessions"]
                for name in ("frames_received", "frames_analysed", "frames_dropped", "crumpling_events", "deadline_misses"):
                    self.assertEqual(flag[name], getattr(figures, name), name)
                self.assertEqual(told["totals"]["frames_received"], 30)
                screen = run_rustle("top", "--http", watched.address, "--once", "--interval", 0.2).stdout
                self.assertRegex(screen, r"rustled \S+, up .*1 of 256 sessions")
                self.assertRegex(screen, r"(?m)^flag +(simulation|ended) ")
        done = run_rustle("top", "--http", watched.address, "--once", status=1)
        self.assertIn("start rustled", done.stderr)


class Logs(RustleTest):
    def test_json_lines_name_their_session(self):
        motion = Motion()
        with Watched(self.folder) as watched, rustle.Connection.connect(watched.ends["control"]) as connection:
            with rustle.Session.attach(connection, options(name='a "flag"')) as session:
                motion.play(session, 0.2)
                self.assertTrue(await_true(lambda: any("ended:" in line["message"] for line in watched.lines())))
            lines = watched.lines()
            for line in lines:
                self.assertLessEqual({"time", "level", "message"}, set(line))
                self.assertRegex(line["time"], r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$")
            about = [line for line in lines if line.get("session") == 'a "flag"']
            self.assertTrue(any("attached" in line["message"] for line in about))
            self.assertTrue(any("ended:" in line["message"] for line in about))
            self.assertTrue(any("session" not in line for line in lines))


class Ending(RustleTest):
    def test_sigterm_finishes_what_was_sent(self):
        motion = Motion()
        with Watched(self.folder) as watched, rustle.Connection.connect(watched.ends["control"]) as connection:
            session = rustle.Session.attach(connection, options(name="flag"))
            live = rustle.Session.attach(connection, options(LIVE, name="live"))
            live.add_topology(1, motion.triangles, material_coordinates=motion.material)
            reader = session.listen()
            session.add_topology(1, motion.triangles, material_coordinates=motion.material)
            motion.send(session, np.arange(60) / 60)
            self.assertTrue(await_true(lambda: connection.statistics("flag").frames_received == 60))
            began = time.monotonic()
            watched.process.send_signal(signal.SIGTERM)
            heard = reader.read_all()
            self.assertEqual(watched.process.wait(20), 0)
            self.assertLess(time.monotonic() - began, 5)
            self.assertGreater(len(heard.samples) / heard.rate_hz, 0.99)  # all that was sent, and its tails
            self.assertEqual(heard.gaps, ())
            ended = {line.get("session"): line["message"] for line in watched.lines() if " ended:" in line["message"]}
            self.assertRegex(ended["flag"], r"60 frames, 0 dropped")
            self.assertIn("live", ended)


if __name__ == "__main__":
    main()
