"""Faults of captures: cut, flipped, their writer killed, their disk failing."""
import subprocess

from running import BUILD, STORED_CAPTURE
from table import QUICK, fault, often


def captures(what, number):
    done = subprocess.run([BUILD / "tests/fault_captures", what, str(number)], capture_output=True, text=True, timeout=3600)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.strip()


@fault("a capture is cut at every byte", "every record of every whole chunk before, no wrong one")
def capture_cut():
    return captures("cuts", STORED_CAPTURE)


@fault("a capture is flipped at every bit", "told; every record of every whole chunk before, no wrong one")
def capture_flipped():
    return captures("some-flips" if QUICK else "flips", often(60, 12))


@fault("the writer is killed while it records", "no acknowledged record lost, none invented")
def capture_killed():
    return captures("kills", often(1000, 50))


@fault("a write or sync fails while it records", "told, no false acknowledgement, no sync tried again")
def capture_failed():
    return captures("errors", often(400, 100))
