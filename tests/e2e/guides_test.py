#!/usr/bin/python3
"""The guides of client_sdk as a reader follows them: every command is run, every file named is there.

A block ```sh is run; a block ```LANGUAGE FILE is saved as that file; a block ```debian is for tests/packages. Blocks of a guide go one after another in one shell, in a folder
that looks like the project's root. Daemons listen at their default ports, in a network of their own where the system grants one.
"""
import ctypes
import fcntl
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time

from support import BIN, BUILD, SOURCE, RustleTest, main

GUIDES = [*sorted((SOURCE / "client_sdk/guides").glob("*.md")), SOURCE / "client_sdk/blender/README.md"]
LONGEST_S = float(os.environ.get("RUSTLE_GUIDE_SECONDS", 300))  #: the five minutes from a build to one's own simulation heard
PORTS = (7390, 7391, 7392, 7393)
BLOCK = re.compile(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", re.DOTALL | re.MULTILINE)
WAIT = 'until (exec 3<>/dev/tcp/127.0.0.1/{}) 2>/dev/null; do sleep 0.1; done\n'
CLONE_NEWUSER, CLONE_NEWNET, SIOCSIFFLAGS, IFF_UP = 0x10000000, 0x40000000, 0x8914, 1


def enter_own_network():
    """A network with nothing but a loopback device; OSError where the system grants none. In a new process."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(CLONE_NEWNET) != 0 and libc.unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0:
        raise OSError(ctypes.get_errno(), "no network of its own")
    with socket.socket() as control:
        fcntl.ioctl(control, SIOCSIFFLAGS, struct.pack("16sH14x", b"lo", IFF_UP))


def grants_networks():
    child = os.fork()
    if child == 0:
        try:
            enter_own_network()
        except OSError:
            os._exit(1)
        os._exit(0)
    return os.waitpid(child, 0)[1] == 0


def in_use(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def script_of(text):
    """A guide's blocks as one bash script. A daemon that it starts is waited for."""
    lines = ["set -euo pipefail", "trap 'kill $(jobs -p) 2>/dev/null || true; wait' EXIT"]
    for language, file, body in BLOCK.findall(text):
        if file:
            lines.append(f"mkdir -p \"$(dirname '{file}')\"; cat > '{file}' <<'END_OF_BLOCK'\n{body}END_OF_BLOCK")
        elif language == "sh":
            for line in body.splitlines():
                lines.append(line)
                if re.match(r"rustled\b.*&\s*(#.*)?$", line):
                    lines += [WAIT.format(port) for port in PORTS]
    return "\n".join(lines) + "\n"


class Guides(RustleTest):
    def run_guide(self, path):
        root = self.folder / "root"
        (root / "build").mkdir(parents=True)
        for entry in SOURCE.iterdir():
            if entry.name != "build" and not entry.name.startswith("."):
                (root / entry.name).symlink_to(entry)
        (root / "build/release").symlink_to(BUILD.resolve())
        (self.folder / "bin").mkdir()
        (self.folder / "bin/python3").symlink_to(sys.executable)
        own = grants_networks()
        deadline = time.monotonic() + 60
        while not own and any(map(in_use, PORTS)):
            self.assertLess(time.monotonic(), deadline, f"another program listens at one of the ports {PORTS}")
            time.sleep(0.1)
        environment = {**os.environ, "PATH": f"{self.folder}/bin:{BIN.resolve()}:{os.environ['PATH']}", "RUSTLED_CONFIG": "", "RUSTLED_AUDIO_DEVICE": "none",
                       "PYTHONPATH": str((BUILD / "python").resolve()), "PYTHONDONTWRITEBYTECODE": "1"}
        with open(self.folder / "said", "w+") as said:
            shell = subprocess.Popen(["bash", "-c", script_of(path.read_text())], cwd=root, env=environment, stdout=said, stderr=said,
                                     process_group=0, preexec_fn=enter_own_network if own else None)
            begun = time.monotonic()
            try:
                status = shell.wait(LONGEST_S)
            except subprocess.TimeoutExpired:
                status = f"not ended after {LONGEST_S} s"
            finally:
                try:
                    os.killpg(shell.pid, signal.SIGKILL)
                except ProcessLookupError:
                    pass
                shell.wait()
            said.seek(0)
            self.assertEqual(status, 0, said.read()[-6000:])
        print(f"{path.parent.name}/{path.name}: {time.monotonic() - begun:.1f} s", flush=True)

    def test_paths_exist(self):
        """What a guide names in backticks with a slash and an ending, and what it links to, is there."""
        for guide in GUIDES:
            prose = BLOCK.sub("", guide.read_text())
            named = set(re.findall(r"`((?:proto|server|client_sdk|sound_db|tests|deploy)/[\w./-]+)`", prose))
            linked = {target.split("#")[0] for target in re.findall(r"\]\(([^)]+)\)", prose) if not target.startswith(("http", "#"))}
            for path in sorted(named):
                with self.subTest(guide=guide.name, path=path):
                    self.assertTrue((SOURCE / path).exists())
            for path in sorted(linked):
                with self.subTest(guide=guide.name, link=path):
                    self.assertTrue((guide.parent / path).exists())

    def test_every_command_is_of_a_kind_that_is_run(self):
        for guide in GUIDES:
            fences = [line for line in guide.read_text().splitlines() if line.startswith("```")]
            self.assertEqual(len(fences) % 2, 0, guide.name)
            for opening in fences[::2]:
                with self.subTest(guide=guide.name, fence=opening):
                    self.assertNotRegex(opening, r"^```(bash|shell|console)")


def test_of(guide):
    def run(self):
        self.run_guide(guide)
    return run


def add_guides():
    for guide in GUIDES:
        if script_of(guide.read_text()).count("\n") > 2:
            name = "test_" + re.sub(r"\W", "_", f"{guide.parent.name}_{guide.stem}")
            setattr(Guides, name, test_of(guide))


add_guides()

if __name__ == "__main__":
    main()
