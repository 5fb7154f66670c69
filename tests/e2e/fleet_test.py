#!/usr/bin/python3
"""rustled as one of a fleet: what it tells the Agones sidecar through its life, the manifests, and sessions that find a place."""
import contextlib
import copy
import json
import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import unittest
import urllib.request

import jsonschema
import numpy as np
import yaml

from agones import Allocator, Sidecar, free_ports
from support import BIN, BUILD, SOURCE, RustleTest, bent, curvature_of, daemon, grid, main, wait_until
from support import rustle as run_rustle

sys.path.insert(0, str(BUILD / "python"))
import rustle

logging.getLogger("rustle").setLevel(logging.CRITICAL)

LIVE, SIMULATION = rustle.Clock.LIVE, rustle.Clock.SIMULATION
MATERIAL, TRIANGLES = grid(0.2, 0.1, 8, 4)
CURVATURE = curvature_of(0.2, 0.1)


def at(t):
    """A sheet that is bent to and fro, eight flaps a second."""
    return bent(MATERIAL, CURVATURE * np.sin(2 * np.pi * 4 * t)).astype(np.float32)


def options(clock=LIVE, **more):
    return rustle.SessionOptions(**{"name": "sheet", "clock": clock, "sheets": [rustle.SheetOptions(1)], **more})


class Player:
    """A live session that plays in step with the clock, and hears itself."""

    def __init__(self, session, fps=60):
        self.session, self.fps = session, fps
        self.reader = session.listen()
        session.add_topology(1, TRIANGLES, material_coordinates=MATERIAL)
        self.begun, self.frames = time.monotonic(), 0
        self.heard = []  # (time, loudest sample, samples missing, whether another daemon sent it)

    def play(self, seconds):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.session.frame(1, 1, self.frames / self.fps, at(self.frames / self.fps))
            self.frames += 1
            self.hear()
            time.sleep(max(0.0, self.begun + self.frames / self.fps - time.monotonic()))

    def hear(self):
        while (block := self.reader.next(0)) is not None:
            if not block.end:
                self.heard.append((time.monotonic(), float(np.abs(block.samples).max(initial=0)), block.missing_samples, block.restarted))


class FleetTest(RustleTest):
    @contextlib.contextmanager
    def daemon(self, sidecar, *more, name="daemon", **how):
        folder = self.folder / name
        folder.mkdir()
        with daemon(folder, "--device", "none", "--sidecar", f"127.0.0.1:{sidecar.port}", *more, **how) as ends:
            yield ends

    def waits(self, condition, complaint, seconds=60):
        """That something comes at all; a busy machine may take its time."""
        wait_until(condition, seconds, complaint)


class Life(FleetTest):
    def test_ready_once_bound_and_alive_until_shutdown(self):
        sidecar = Sidecar()
        with sidecar, contextlib.ExitStack() as stack:
            sidecar.looks["POST /ready"] = lambda: all((self.folder / "daemon" / end).exists() for end in ("control", "stream", "out"))
            ends = stack.enter_context(self.daemon(sidecar, "--max-sessions", "7"))
            self.waits(lambda: sidecar.count("POST /ready"), "it is never ready")
            self.assertEqual(sidecar.seen, [True])
            self.assertEqual(sidecar.counters["sessions"], {"count": 0, "capacity": 7})
            begun, beats = time.monotonic(), sidecar.count("POST /health")
            time.sleep(6.2)
            self.assertIn(sidecar.count("POST /health") - beats, (2, 3, 4), "it says that it lives every two seconds")
            ends["process"].send_signal(signal.SIGTERM)
            ends["process"].wait(5)
            self.assertEqual(ends["process"].returncode, 0)
            self.assertEqual(sidecar.asked[-1][1], "POST /shutdown")
            self.assertEqual((sidecar.count("POST /shutdown"), sidecar.count("POST /ready")), (1, 1))
            self.assertLess(begun, sidecar.asked[-1][0])

    def test_nothing_is_said_where_there_is_no_fleet(self):
        sidecar = Sidecar()
        with sidecar:
            for said in ("off", "auto"):
                with daemon(self.folder, "--device", "none", "--sidecar", said):
                    time.sleep(0.5)
            self.assertEqual(sidecar.asked, [])

    def test_agones_variable_names_the_sidecar(self):
        os.environ["AGONES_SDK_HTTP_PORT"] = "no port"
        self.addCleanup(os.environ.pop, "AGONES_SDK_HTTP_PORT", None)
        refused = subprocess.run([BIN / "rustled", "--control", f"ipc://{self.folder}/c", "--stream", f"ipc://{self.folder}/s", "--out",
                                  f"ipc://{self.folder}/o", "--http", "off", "--device", "none"], capture_output=True, text=True, timeout=20)
        self.assertEqual(refused.returncode, 1)
        self.assertIn("AGONES_SDK_HTTP_PORT", refused.stderr)
        with Sidecar() as sidecar:
            os.environ["AGONES_SDK_HTTP_PORT"] = str(sidecar.port)
            with daemon(self.folder, "--device", "none"):
                self.waits(lambda: sidecar.state == "Ready", "it is never ready")

    def test_doctor_looks_for_the_sidecar(self):
        def told(**environment):
            done = subprocess.run([BIN / "rustle", "doctor", "--json"], capture_output=True, text=True, timeout=60,
                                  env={**os.environ, "RUSTLED_CONFIG": "", **environment})
            return {check["name"]: check for check in json.loads(done.stdout)["checks"]}.get("fleet")
        self.assertIsNone(told())
        with Sidecar() as sidecar:
            found = told(AGONES_SDK_HTTP_PORT=str(sidecar.port))
        self.assertEqual((found["grade"], found["found"]), ("granted", "rustle-x7 is Scheduled"))
        gone = told(AGONES_SDK_HTTP_PORT=str(sidecar.port))
        self.assertEqual(gone["grade"], "limited")
        self.assertIn(str(sidecar.port), gone["found"])

    def test_counter_follows_sessions_however_they_leave(self):
        with Sidecar() as sidecar, self.daemon(sidecar) as ends:
            with rustle.Connection.connect(ends["control"]) as connection:
                first = rustle.Session.attach(connection, options())
                self.waits(lambda: sidecar.sessions == 1, "the first is not counted")
                self.waits(lambda: sidecar.state == "Allocated", "a daemon with a session could be taken away")
                second = rustle.Session.attach(connection, options())
                self.waits(lambda: sidecar.sessions == 2, "the second is not counted")
                first.detach()
                second.detach(discard=True)
                self.waits(lambda: sidecar.sessions == 0, "those that left are still counted")
            program = ("import sys, os; sys.path.insert(0, sys.argv[1]); import rustle\n"
                       "c = rustle.Connection.connect(sys.argv[2]); s = rustle.Session.attach(c, rustle.SessionOptions(name='x'))\n"
                       "print('there', flush=True); os.kill(os.getpid(), 9)")
            crashed = subprocess.run([sys.executable, "-c", program, BUILD / "python", ends["control"]], capture_output=True, text=True, timeout=20)
            self.assertEqual((crashed.stdout, crashed.returncode), ("there\n", -signal.SIGKILL), crashed.stderr)
            self.waits(lambda: sidecar.sessions == 1, "the crashed client's is not counted while it may come back")
            self.waits(lambda: sidecar.sessions == 0, "the crashed client's is counted for ever")
            self.waits(lambda: sidecar.state == "Ready", "it is not given back when all have gone")

    def test_counter_is_true_again_when_a_sidecar_comes_back(self):
        sidecar = Sidecar()
        with self.daemon(sidecar, log=self.folder / "log") as ends, contextlib.closing(sidecar):
            self.waits(lambda: "no sidecar" in (self.folder / "log").read_text(), "it does not look for its sidecar")
            time.sleep(0.5)
            sidecar.come()
            self.waits(lambda: sidecar.state == "Ready", "a sidecar that starts after the daemon is not found")
            sidecar.vanish()
            with rustle.Connection.connect(ends["control"]) as connection:
                kept = [rustle.Session.attach(connection, options()) for _ in range(3)]
                kept.pop().detach(discard=True)
                time.sleep(1.5)
                sidecar.counters["sessions"]["count"] = 77  # whatever it believed before
                sidecar.come()
                self.waits(lambda: sidecar.sessions == 2, "the count is not mended")
                self.waits(lambda: sidecar.state == "Allocated", "its state is not mended")
                self.assertEqual(sidecar.count("POST /ready"), 1)
                # An allocation that nobody made use of is taken back.
                sidecar.counters["sessions"]["count"] = 3
                self.waits(lambda: sidecar.sessions == 2, "a place that nobody took stays taken")
                for session in kept:
                    session.detach(discard=True)
            ends["process"].terminate()
            ends["process"].wait(8)
        told = (self.folder / "log").read_text()
        self.assertIn("no sidecar at 127.0.0.1", told)
        self.assertEqual(told.count("; it is looked for again and again"), 2)  # once each time that it was away

    def test_refusals_keep_nothing_waiting(self):
        with Sidecar(counters=()) as sidecar, self.daemon(sidecar, log=self.folder / "log"):
            self.waits(lambda: sidecar.state == "Ready", "without a counter it is never ready")
            self.waits(lambda: sidecar.count("PATCH /v1beta1/counters/sessions") == 2, "what was refused is not asked again")
            sidecar.status = 500
            time.sleep(2)
            sidecar.status = None
            before = sidecar.count("POST /health")
            self.waits(lambda: sidecar.count("POST /health") > before, "it says no longer that it lives")
            self.assertIn("spec.counters.sessions", (self.folder / "log").read_text())

    def test_a_sidecar_that_hangs_holds_nothing_up(self):
        sidecar = Sidecar()
        sidecar.delay_s = 20
        with sidecar, self.daemon(sidecar) as ends, rustle.Connection.connect(ends["control"]) as connection:
            begun = time.monotonic()
            session = rustle.Session.attach(connection, options())
            self.assertLess(time.monotonic() - begun, 1)
            player = Player(session)
            player.play(3)
            statistics = session.detach()
            player.hear()
            self.assertGreater(max(loud for _, loud, _, _ in player.heard), 0.001)
            self.assertEqual(player.reader.missing_samples, 0)
            self.assertEqual((statistics.pcm_gaps, statistics.deadline_misses), (0, 0))
            begun = time.monotonic()
            ends["process"].terminate()
            ends["process"].wait(6)
            self.assertLess(time.monotonic() - begun, 5)

    def test_a_daemon_that_hangs_says_not_that_it_lives(self):
        with Sidecar() as sidecar, self.daemon(sidecar) as ends:
            self.waits(lambda: sidecar.count("POST /health") >= 2, "it says not that it lives")
            ends["process"].send_signal(signal.SIGSTOP)
            time.sleep(0.2)
            before = len(sidecar.asked)
            time.sleep(3)
            self.assertEqual(len(sidecar.asked), before)
            ends["process"].send_signal(signal.SIGCONT)
            beats = sidecar.count("POST /health")
            self.waits(lambda: sidecar.count("POST /health") > beats, "it says not that it lives again")

    def test_sigterm_drains_before_the_shutdown(self):
        with Sidecar() as sidecar, self.daemon(sidecar) as ends, rustle.Connection.connect(ends["control"]) as connection:
            session = rustle.Session.attach(connection, options(SIMULATION))
            self.waits(lambda: sidecar.state == "Allocated", "a daemon with a session could be taken away")
            ended = {}
            sidecar.looks["POST /shutdown"] = lambda: ended.setdefault("asked", time.monotonic())
            with session.listen() as reader:
                session.add_topology(1, TRIANGLES, material_coordinates=MATERIAL)
                for k in range(120):
                    session.frame(1, 1, k / 60, at(k / 60))
                session.drain()
                ends["process"].terminate()
                sound = reader.read_all(10)
                ended["heard"] = time.monotonic()
            ends["process"].wait(6)
            self.assertGreater(len(sound.samples), 1.9 * 48000, "what was sent is not rendered")
            self.assertEqual(sidecar.state, "Shutdown")
            self.assertEqual(sidecar.count("POST /ready"), 1, "a daemon that ends is offered again")
            self.assertEqual(sidecar.asked[-1][1], "POST /shutdown")

    def test_figures_tell_of_the_fleet(self):
        port = free_ports(1)[0]
        with Sidecar(ports={"control": 7101, "stream": 7102, "out": 7103}) as sidecar, self.daemon(sidecar, "--http", f"127.0.0.1:{port}"):
            self.waits(lambda: sidecar.count("POST /health") and sidecar.state == "Ready", "it is never ready")

            def ask(path):
                return urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=5).read().decode()
            fleet = json.loads(ask("/figures"))["fleet"]
            self.assertEqual((fleet["sidecar_up"], fleet["game_server"], fleet["state"], fleet["address"]), (True, "rustle-x7", "Ready", "203.0.113.4"))
            self.assertEqual(fleet["ports"], {"control": 7101, "stream": 7102, "out": 7103})
            self.assertEqual(fleet["requests"]["ready"], {"done": 1})
            metrics = ask("/metrics")
            self.assertIn("rustle_fleet_sidecar_up 1", metrics)
            self.assertIn('rustle_fleet_state{game_server="rustle-x7",state="Ready"} 1', metrics)
            self.assertIn('rustle_fleet_requests_total{request="ready",outcome="done"} 1', metrics)
            sidecar.vanish()
            self.waits(lambda: "rustle_fleet_sidecar_up 0" in ask("/metrics"), "a sidecar that has gone is told to be there")


def forward(listening, port):
    """What connects to the node's port reaches the pod's."""
    def carry(source, sink):
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                sink.sendall(data)
        with contextlib.suppress(OSError):
            sink.shutdown(socket.SHUT_WR)

    def accept():
        with contextlib.suppress(OSError):
            while True:
                outside, _ = listening.accept()
                inside = socket.create_connection(("127.0.0.1", port))
                for pair in ((outside, inside), (inside, outside)):
                    threading.Thread(target=carry, args=pair, daemon=True).start()
    threading.Thread(target=accept, daemon=True).start()


class Ports(FleetTest):
    def test_clients_are_sent_to_the_nodes_ports(self):
        inside = dict(zip(("control", "stream", "out"), free_ports(3)))
        node = {}
        for name, port in inside.items():
            listening = socket.create_server(("127.0.0.2", 0))
            self.addCleanup(listening.close)
            node[name] = listening.getsockname()[1]
            forward(listening, port)
        with Sidecar(ports=node) as sidecar:
            sidecar.node = "127.0.0.2"
            ends = [f"--{name}=tcp://0.0.0.0:{port}" for name, port in inside.items()]
            process = subprocess.Popen([BIN / "rustled", *ends, "--insecure", "--http", "off", "--device", "none", "--sidecar",
                                        f"127.0.0.1:{sidecar.port}"], stderr=subprocess.DEVNULL)
            self.addCleanup(process.wait, 10)
            self.addCleanup(process.terminate)
            self.waits(lambda: sidecar.state == "Ready", "it is never ready")
            with rustle.Connection.connect(f"tcp://127.0.0.2:{node['control']}") as connection:
                self.assertEqual(connection.server.stream_endpoint, f"tcp://0.0.0.0:{node['stream']}")
                self.assertEqual(connection.server.out_endpoint, f"tcp://0.0.0.0:{node['out']}")
                session = rustle.Session.attach(connection, options(SIMULATION))
                with session.listen() as reader:
                    session.add_topology(1, TRIANGLES, material_coordinates=MATERIAL)
                    for k in range(60):
                        session.frame(1, 1, k / 60, at(k / 60))
                    session.end()
                    self.assertGreater(np.abs(reader.read_all(20).samples).max(), 0.001)
                session.detach()


class Manifests(unittest.TestCase):
    KINDS = {"fleet": "Fleet", "autoscaler": "FleetAutoscaler", "allocation": "GameServerAllocation"}

    def read(self, name):
        manifest = yaml.safe_load((SOURCE / f"deploy/fleet/{name}.yaml").read_text())
        schema = json.loads((SOURCE / f"tests/e2e/schemas/{name}.json").read_text())
        return manifest, jsonschema.Draft7Validator(schema)

    def test_manifests_are_what_agones_takes(self):
        self.assertEqual({path.stem for path in (SOURCE / "deploy/fleet").glob("*.yaml")}, set(self.KINDS))
        for name, kind in self.KINDS.items():
            with self.subTest(name):
                manifest, schema = self.read(name)
                schema.check_schema(schema.schema)
                self.assertEqual([error.message for error in schema.iter_errors(manifest)], [])
                self.assertEqual(manifest["kind"], kind)

    def test_schemas_refuse_what_agones_refuses(self):
        for name, path, value in (
                ("fleet", ("spec", "replicas"), "2"), ("fleet", ("spec", "template", "spec", "ports", 0, "protocol"), "SCTP"),
                ("fleet", ("spec", "template", "spec", "ports", 0, "containerPort"), 0),
                ("fleet", ("spec", "template", "spec", "counters", "sessions", "count"), -1),
                ("fleet", ("spec", "template", "spec", "counter"), {}), ("fleet", ("spec", "template", "spec", "eviction", "safe"), "Yes"),
                ("fleet", ("spec", "template", "spec", "template", "spec", "containers", 0, "volumeMount"), []),
                ("fleet", ("apiVersion",), "v1"), ("autoscaler", ("spec", "policy", "type"), "Counters"),
                ("autoscaler", ("spec", "policy", "counter", "maxCapacity"), 0), ("autoscaler", ("spec", "policy", "counter", "bufferSize"), "many"),
                ("allocation", ("spec", "selectors", 0, "gameServerState"), "ALLOCATED"), ("allocation", ("spec", "counters", "sessions", "action"), "Add"),
                ("allocation", ("spec", "selectors", 0, "counters", "sessions", "minAvailable"), "1")):
            with self.subTest(f"{name}: {path}"):
                manifest, schema = self.read(name)
                inner = changed = copy.deepcopy(manifest)
                for key in path[:-1]:
                    inner = inner[key]
                inner[path[-1]] = value
                self.assertTrue(list(schema.iter_errors(changed)))

    def test_manifests_name_the_same_things(self):
        fleet, scaler, allocation = (self.read(name)[0] for name in self.KINDS)
        server = fleet["spec"]["template"]["spec"]
        container = server["template"]["spec"]["containers"][0]
        self.assertEqual(scaler["spec"]["fleetName"], fleet["metadata"]["name"])
        self.assertEqual(scaler["spec"]["policy"]["counter"]["key"], "sessions")
        self.assertEqual(server["container"], container["name"])
        most = container["args"][container["args"].index("--max-sessions") + 1]
        self.assertEqual(server["counters"], {"sessions": {"count": 0, "capacity": int(most)}})
        for selector in allocation["spec"]["selectors"]:
            self.assertEqual(selector["matchLabels"], {"agones.dev/fleet": fleet["metadata"]["name"]})
        config = (SOURCE / "deploy/container/rustled.toml").read_text()
        for port in server["ports"]:
            self.assertIn(f"{port['name']} = 'tcp://0.0.0.0:{port['containerPort']}'", config)
        volumes = {volume["name"] for volume in server["template"]["spec"]["volumes"]}
        self.assertEqual({mount["name"] for mount in container["volumeMounts"]}, volumes)

    def test_the_manifests_command_is_one_that_rustled_takes(self):
        args = self.read("fleet")[0]["spec"]["template"]["spec"]["template"]["spec"]["containers"][0]["args"]
        printed = subprocess.run([BIN / "rustled", "--config", SOURCE / "deploy/container/rustled.toml", *args, "--print-config"],
                                 capture_output=True, text=True, timeout=20)
        self.assertEqual(printed.returncode, 0, printed.stderr)
        self.assertIn("most = 150", printed.stdout)

    def test_the_helper_asks_the_allocator_as_the_manifest_does(self):
        manifest = self.read("allocation")[0]["spec"]
        with Allocator([]) as allocator, self.assertRaises(rustle.Refused):
            rustle.fleet.Agones(allocator.url).place()
        asked = allocator.asked[0]
        self.assertEqual([each["gameServerState"] for each in asked["gameServerSelectors"]], [each["gameServerState"].upper() for each in manifest["selectors"]])
        self.assertEqual([each["matchLabels"] for each in asked["gameServerSelectors"]], [each["matchLabels"] for each in manifest["selectors"]])
        self.assertEqual(asked["priorities"], manifest["priorities"])
        self.assertEqual(asked["counters"]["sessions"], {key: value if key == "action" else str(value) for key, value in manifest["counters"]["sessions"].items()})


class Places(FleetTest):
    @contextlib.contextmanager
    def daemons(self, *capacities, keys=None, more=()):
        with contextlib.ExitStack() as stack:
            all_ends = []
            for k, capacity in enumerate(capacities):
                folder = self.folder / f"daemon{k}"
                folder.mkdir()
                all_ends.append(stack.enter_context(daemon(folder, "--device", "none", "--max-sessions", capacity, *more)))
            for ends in all_ends:  # they read their packs first
                rustle.Connection.connect(ends["control"], 60, keys=keys).close()
            yield all_ends

    def test_sessions_spread_and_fill_every_place(self):
        with self.daemons(4, 2) as (large, small):
            places = rustle.fleet.Daemons([large["control"], small["control"], f"ipc://{self.folder}/nobody"])
            begun = time.monotonic()
            sessions = [rustle.fleet.attach(places, options()) for _ in range(6)]
            self.assertLess(time.monotonic() - begun, 6, "a daemon that is not there holds the others up")
            for ends, count in ((large, 4), (small, 2)):
                with rustle.Connection.connect(ends["control"]) as connection:
                    self.assertEqual((connection.server.sessions, connection.server.most_sessions), (count, count))
            self.assertEqual(len({session.id for session in sessions}), 6)
            with self.assertRaises(rustle.Refused) as full:
                rustle.fleet.attach(places, options(), timeout_s=0.3)
            self.assertEqual(full.exception.code_name, "quota_exceeded")
            sessions.pop().detach(discard=True)
            sessions.append(rustle.fleet.attach(places, options()))
            for session in sessions:
                session.detach(discard=True)

    def test_what_is_wrong_is_told(self):
        with self.assertRaises(rustle.InvalidArgument):
            rustle.fleet.Daemons([])
        with self.assertRaises(rustle.InvalidArgument):
            rustle.fleet.Daemons(["sound-1"]).place()
        with self.assertRaises(rustle.Unreachable):
            rustle.fleet.attach(rustle.fleet.Daemons([f"ipc://{self.folder}/nobody"]), timeout_s=0.2)
        for status in (403, 500):
            with Allocator([]) as allocator:
                allocator.status = status
                with self.assertRaises(rustle.Unreachable) as refused:
                    rustle.fleet.Agones(allocator.url).place()
                self.assertIn(str(status), str(refused.exception))
        with self.assertRaises(rustle.Unreachable):
            rustle.fleet.Agones(f"http://127.0.0.1:{free_ports(1)[0]}").place()
        given = [{"name": "a", "state": "Ready", "address": "10.0.0.1", "ports": {"control": 1, "stream": 2}, "count": 0, "capacity": 2}]
        with Allocator(given) as allocator, self.assertRaises(rustle.Unreachable) as lacking:
            rustle.fleet.Agones(allocator.url).place()
        self.assertIn("out", str(lacking.exception))

    def test_agones_is_asked_for_one_in_use_first_and_for_a_fresh_one_after_a_failure(self):
        ports = {"control": 7390, "stream": 7391, "out": 7392}
        given = [{"name": name, "state": state, "address": address, "ports": ports, "count": count, "capacity": 3}
                 for name, state, address, count in (("used", "Allocated", "10.0.0.1", 1), ("fresh", "Ready", "2001:db8::1", 0))]
        with Allocator(given) as allocator:
            places = rustle.fleet.Agones(allocator.url)
            self.assertEqual(places.place(), rustle.Endpoints("tcp://10.0.0.1:7390", "tcp://10.0.0.1:7391", "tcp://10.0.0.1:7392"))
            self.assertEqual(places.place(["tcp://10.0.0.1:7390"]).control, "tcp://[2001:db8::1]:7390")
            given[:] = given[:1]
            with self.assertRaises(rustle.Unreachable):  # it does not know yet that this one has gone
                places.place(["tcp://10.0.0.1:7390"])

    def goes_on_elsewhere(self, how, within_s, keys=None, *more):
        with self.daemons(8, 8, keys=keys, more=more) as daemons:
            places = rustle.fleet.Daemons([ends["control"] for ends in daemons], keys=keys)
            session = rustle.fleet.attach(places, options(), keys=keys)
            player = Player(session, fps=30)
            player.session.set_gains([rustle.Gain(-6)])
            player.play(1)
            here = next(ends for ends in daemons if ends["control"] == session.control_endpoint)
            there = next(ends for ends in daemons if ends is not here)
            how(here["process"])
            gone = time.monotonic()
            player.play(within_s + 1)
            again = [time for time, loud, _, _ in player.heard if time > gone and loud > 0.001]
            moved = [time for time, _, _, restarted in player.heard if restarted]
            self.assertEqual(session.reattached, 1)
            self.assertEqual(len(moved), 1)
            loud_there = min(time for time in again if time >= moved[0])
            self.assertLess(loud_there - gone, within_s)
            with rustle.Connection.connect(there["control"], keys=keys) as connection:
                self.assertEqual([each.session_id for each in connection.list_sessions()], [session.id])
                self.assertEqual(connection.set_gains(session.id, []), [rustle.Gain(-6)])
            self.assertEqual(session.statistics().session_id, session.id)
            session.detach(discard=True)
            if here["process"].poll() is None:
                here["process"].send_signal(signal.SIGCONT)

    def test_a_session_goes_on_elsewhere_when_its_daemon_is_killed(self):
        self.goes_on_elsewhere(lambda process: process.kill(), 2)

    def test_keys_go_along(self):
        theirs, ours = self.folder / "server-keys", self.folder / "my-keys"
        run_rustle("keys", "new", "server", "--folder", theirs)
        run_rustle("keys", "new", "flag", "--folder", ours)
        run_rustle("keys", "allow", ours / "flag.key", "--publish", "--folder", theirs)
        shutil.copy(theirs / "server.key", ours)
        self.goes_on_elsewhere(lambda process: process.kill(), 2, rustle.Keys.read(ours), "--keys", theirs)

    def test_a_session_goes_on_elsewhere_when_its_daemon_hangs(self):
        self.goes_on_elsewhere(lambda process: process.send_signal(signal.SIGSTOP), 3)

    def test_a_session_goes_on_elsewhere_when_its_daemon_is_drained(self):
        self.goes_on_elsewhere(lambda process: process.terminate(), 2)

    def test_a_drained_daemons_end_is_not_the_sounds(self):
        with self.daemons(8, 8) as daemons:
            session = rustle.fleet.attach(rustle.fleet.Daemons([ends["control"] for ends in daemons]), options())
            heard, moved = [], threading.Event()

            def listen():
                for block in reader:
                    heard.append(block)
                    if block.restarted:
                        moved.set()
            with session.listen() as reader:
                listener = threading.Thread(target=listen)
                listener.start()
                session.add_topology(1, TRIANGLES, material_coordinates=MATERIAL)
                for k in range(300):
                    if k == 60:
                        next(ends for ends in daemons if ends["control"] == session.control_endpoint)["process"].terminate()
                    session.frame(1, 1, k / 60, at(k / 60))
                    time.sleep(1 / 60)
                    if moved.is_set() and k > 120:
                        break
                self.assertTrue(moved.is_set())
                self.assertTrue(listener.is_alive())
                session.end()
                listener.join(10)
                self.assertFalse(listener.is_alive(), "the sound does not end with the session")
            self.assertEqual(sum(block.restarted for block in heard), 1)
            session.detach()

    def test_a_simulation_goes_on_elsewhere(self):
        with self.daemons(8, 8) as daemons:
            session = rustle.fleet.attach(rustle.fleet.Daemons([ends["control"] for ends in daemons]), options(SIMULATION))
            with session.listen() as reader:
                session.add_topology(1, TRIANGLES, material_coordinates=MATERIAL)
                for k in range(120):
                    session.frame(1, 1, k / 60, at(k / 60))
                    if k == 60:
                        session.drain()
                        next(ends for ends in daemons if ends["control"] == session.control_endpoint)["process"].kill()
                session.end()
                session.drain()
                sound = reader.read_all(20)
            self.assertEqual(session.reattached, 1)
            self.assertGreater(np.abs(sound.samples[-48000:]).max(), 0.001)
            session.detach()


if __name__ == "__main__":
    main()
