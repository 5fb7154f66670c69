"""Two networks joined by a wire of our own: packets on it can be lost, late, out of order, or not pass at all.

Each network is a namespace with one TUN device; the wire reads packets from one and writes them to the other.
"""
import contextlib
import ctypes
import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import threading
import time

CLONE_NEWNET = 0x40000000
TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
LIBC = ctypes.CDLL(None, use_errno=True)


def _check(result):
    if result != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def enter(namespace):
    """The calling thread, and what it starts, is in that network from now on."""
    _check(LIBC.setns(namespace, CLONE_NEWNET))


def _network(address):
    """A new network with a TUN device of this address: its namespace and the device."""
    _check(LIBC.unshare(CLONE_NEWNET))
    tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    fcntl.ioctl(tun, TUNSETIFF, struct.pack("16sH22x", b"wire", IFF_TUN | IFF_NO_PI))
    for command in (f"ip addr add {address}/24 dev wire", "ip link set wire up", "ip link set lo up"):
        subprocess.run(command.split(), check=True)
    return os.open("/proc/thread-self/ns/net", os.O_RDONLY | os.O_CLOEXEC), tun


class Wire:
    """`here` and `there` are the networks; addresses 10.77.0.1 and 10.77.0.2.

    loss      share of packets that do not arrive
    delay_s   every packet's, and `jitter_s` more at random: then they overtake each other
    cut       none passes
    """

    HERE, THERE = "10.77.0.1", "10.77.0.2"

    def __init__(self):
        self.loss, self.delay_s, self.jitter_s, self.cut = 0.0, 0.0, 0.0, False
        self.passed = self.lost = self.overtaken = 0
        home = os.open("/proc/thread-self/ns/net", os.O_RDONLY | os.O_CLOEXEC)
        try:
            self.here, self._here = _network(self.HERE)
            self.there, self._there = _network(self.THERE)
        finally:
            enter(home)
            os.close(home)
        self._ends = False
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    def close(self):
        self._ends = True
        self._thread.join()
        for descriptor in (self.here, self.there, self._here, self._there):
            os.close(descriptor)

    def _carry(self):
        dice, waiting, number, newest = random.Random(3), [], 0, {}
        other = {self._here: self._there, self._there: self._here}
        while not self._ends:
            until = waiting[0][0] - time.monotonic() if waiting else 0.05
            for end in select.select(list(other), [], [], max(0.0, min(0.05, until)))[0]:
                with contextlib.suppress(BlockingIOError):
                    packet = os.read(end, 65536)
                    if self.cut or dice.random() < self.loss:
                        self.lost += 1
                        continue
                    number += 1
                    heapq.heappush(waiting, (time.monotonic() + self.delay_s + dice.random() * self.jitter_s, number, other[end], packet))
            while waiting and waiting[0][0] <= time.monotonic():
                _, sent, end, packet = heapq.heappop(waiting)
                self.overtaken += sent < newest.get(end, 0)
                newest[end] = max(sent, newest.get(end, 0))
                self.passed += 1
                with contextlib.suppress(OSError):  # the device's queue is full: lost, as anywhere
                    os.write(end, packet)
