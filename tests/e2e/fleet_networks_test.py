#!/usr/bin/python3
"""Three daemons in three networks of their own, forty sessions placed among them. One daemon is killed, or cut off: its sessions sound again
elsewhere within two seconds, and the others notice nothing.

The test runs in a network of its own too, joined to each of the three by a veth pair. Needs the right to make networks (root).
"""
import contextlib
import logging
import os
import subprocess
import sys
import time
import unittest

import numpy as np

from support import BIN, BUILD, RustleTest, bent, curvature_of, grid, main

sys.path.insert(0, str(BUILD / "python"))
import rustle

logging.getLogger("rustle").setLevel(logging.CRITICAL)

OWN_NETWORK = "RUSTLE_TEST_NETWORK"
DAEMONS, SESSIONS, FPS = 3, 40, 25
MATERIAL, TRIANGLES = grid(0.2, 0.1, 8, 4)
CURVATURE = curvature_of(0.2, 0.1)
#: A second of a sheet that is bent to and fro, three flaps a second.
SHAPES = [bent(MATERIAL, CURVATURE * np.sin(2 * np.pi * 3 * k / FPS)).astype(np.float32) for k in range(FPS)]
LOUD = 0.001


def run(command):
    subprocess.run(command.split(), check=True)


class Site:
    """A network with a daemon in it."""

    def __init__(self, number, stack, log):
        self.here, self.there = f"10.78.{number}.1", f"10.78.{number}.2"
        self.device = f"fleet{number}"
        holder = subprocess.Popen(["unshare", "--net", "sleep", "infinity"])
        stack.callback(holder.wait)
        stack.callback(holder.kill)
        inside = f"nsenter --target {holder.pid} --net"
        own = os.readlink("/proc/self/ns/net")
        deadline = time.monotonic() + 5
        while os.readlink(f"/proc/{holder.pid}/ns/net") == own and time.monotonic() < deadline:
            time.sleep(0.01)
        run(f"ip link add {self.device} type veth peer name up0 netns {holder.pid}")
        stack.callback(run, f"ip link del {self.device}")
        run(f"ip addr add {self.here}/24 dev {self.device}")
        run(f"ip link set {self.device} up")
        for command in (f"ip addr add {self.there}/24 dev up0", "ip link set up0 up", "ip link set lo up"):
            run(f"{inside} {command}")
        ends = [f"--{name}=tcp://0.0.0.0:{port}" for name, port in (("control", 7390), ("stream", 7391), ("out", 7392))]
        said = stack.enter_context(open(log, "w"))
        # nsenter becomes the daemon: what is killed is that.
        self.process = subprocess.Popen([*inside.split(), BIN / "rustled", *ends, "--insecure", "--http", "off", "--device", "none"], stderr=said)
        stack.callback(self.process.wait)
        stack.callback(self.process.kill)
        self.control = f"tcp://{self.there}:7390"

    def cut(self):
        run(f"ip link set {self.device} down")


class Player:
    """A live session that hears itself."""

    def __init__(self, places, number):
        options = rustle.SessionOptions(name=f"sheet {number}", channels=rustle.Channels.MONO, block_size=512, sheets=[rustle.SheetOptions(1)])
        self.session = rustle.fleet.attach(places, options, timeout_s=20)
        self.reader = self.session.listen(rustle.ListenOptions(format=rustle.SampleFormat.S16))
        self.session.add_topology(1, TRIANGLES, material_coordinates=MATERIAL)
        self.frames = number  # each at a moment of its own
        self.heard = []  # (time, loudest sample, from which daemon on)
        self.moves = 0

    @property
    def place(self):
        return self.session.control_endpoint

    def step(self):
        self.session.frame(1, 1, self.frames / FPS, SHAPES[self.frames % FPS])
        self.frames += 1
        while (block := self.reader.next(0)) is not None:
            self.moves += block.restarted
            self.heard.append((time.monotonic(), float(np.abs(block.samples).max(initial=0)), self.moves))


def play(players, seconds):
    begun = time.monotonic()
    for tick in range(round(seconds * FPS)):
        for player in players:
            player.step()
        time.sleep(max(0.0, begun + (tick + 1) / FPS - time.monotonic()))


@unittest.skipUnless(OWN_NETWORK in os.environ, "networks of one's own are not permitted here: run as root, with CAP_NET_ADMIN and CAP_SYS_ADMIN")
class Networks(RustleTest):
    @contextlib.contextmanager
    def playing(self):
        with contextlib.ExitStack() as stack:
            sites = [Site(number, stack, self.folder / f"log{number}") for number in range(DAEMONS)]
            places = rustle.fleet.Daemons([site.control for site in sites])
            for site in sites:
                rustle.Connection.connect(site.control, 20).close()
            players = [Player(places, number) for number in range(SESSIONS)]
            play(players, 3)
            for site in sites:
                self.assertGreaterEqual(sum(player.place == site.control for player in players), SESSIONS // (2 * DAEMONS), "they crowd at others")
            for player in players:
                self.assertGreater(max(loud for _, loud, _ in player.heard), LOUD)
            yield sites, players
            for player in players:
                player.session.detach(discard=True)

    def lose(self, how, within_s):
        with self.playing() as (sites, players):
            lost = sites[1]
            theirs = [player for player in players if player.place == lost.control]
            others = [player for player in players if player.place != lost.control]
            before = {player: player.place for player in others}
            how(lost)
            gone = time.monotonic()
            play(players, within_s + 1.5)
            silent_s = []
            for player in theirs:
                again = [at for at, loud, moves in player.heard if at > gone and moves == 1 and loud > LOUD]
                self.assertTrue(again, f"{player.session.id} is never heard again; at {player.place}")
                silent_s.append(min(again) - gone)
                self.assertEqual((player.session.reattached, player.moves), (1, 1))
                self.assertNotEqual(player.place, lost.control)
            self.assertLess(max(silent_s), within_s)
            for player in others:
                self.assertEqual((player.session.reattached, player.moves, player.reader.missing_samples), (0, 0, 0))
                self.assertEqual((player.place, player.session._link.connection().breaks), (before[player], 0))
                self.assertEqual(player.session.statistics().pcm_gaps, 0)
            print(f"{len(theirs)} sessions lost their daemon: heard again after {min(silent_s):.2f} to {max(silent_s):.2f} s", flush=True)

    def test_a_daemon_is_killed(self):
        self.lose(lambda site: site.process.kill(), 2)

    def test_a_daemon_is_cut_off(self):
        self.lose(Site.cut, 3)


if __name__ == "__main__":
    if OWN_NETWORK not in os.environ and subprocess.run(["unshare", "--net", "true"], capture_output=True).returncode == 0:
        os.environ[OWN_NETWORK] = "1"
        os.execvp("unshare", ["unshare", "--net", sys.executable, *sys.argv])
    main()
