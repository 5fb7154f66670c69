#!/usr/bin/python3
"""The Debian packages, as the guide has them installed, used, removed and purged, in a fresh Debian: once as a machine that systemd
runs, once without systemd, where the service's command is started as its user.
"""
import hashlib
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(SOURCE / "tests/e2e"))
from guides_test import BLOCK, enter_own_network

GUIDE = SOURCE / "client_sdk/guides/install.md"
PACKAGES = pathlib.Path(os.environ.get("RUSTLE_PACKAGES", SOURCE / "build/debian/packages"))
KEPT = SOURCE / "build/packages"  #: the fresh Debian, as long as the packages depend on the same
BROUGHT = ("systemd-sysv", "dbus", "sudo", "curl")  #: what a machine has, and the test's own
WAIT_S = 600

#: What other packages' records of installed packages, of time and of themselves change.
NOT_OURS = re.compile(r"/(var/(lib/(apt|dpkg|systemd/(?!deb-systemd)|private$)|cache|log|tmp)|etc/(machine-id|resolv\.conf|hostname|\.updated|ld\.so\.cache"
                      r"|(passwd|group|shadow|gshadow|subuid|subgid)-)|usr/lib/locale|(proc|sys|dev|run|tmp|root)(/|$))")
#: What stays when the packages are removed: configuration, the service's being enabled, recordings.
STAYS = re.compile(r"/(etc/rustle|var/lib/rustle|etc/systemd/system/multi-user\.target\.wants/rustled\.service$|var/lib/systemd/deb-systemd-helper-enabled)")
USERS = ("/etc/passwd", "/etc/group", "/etc/shadow", "/etc/gshadow")

#: systemctl where there is no systemd: the unit's command as its user.
SYSTEMCTL = r"""#!/bin/bash
set -eu
unit=$(find /lib/systemd/system /usr/lib/systemd/system -name rustled.service | head -1)
setting() { sed -n "s/^$1=//p" "$unit"; }
case "$*" in
  *"status rustled") [ -f /tmp/rustled.pid ] || exit 0; kill -0 "$(cat /tmp/rustled.pid)" ;;
  "restart rustled")
    [ ! -f /tmp/rustled.pid ] || kill "$(cat /tmp/rustled.pid)"
    user=$(setting User)
    setsid setpriv --reuid "$user" --regid "$user" --clear-groups $(setting ExecStart) >/tmp/rustled.log 2>&1 </dev/null &
    echo $! >/tmp/rustled.pid ;;
  "stop rustled") kill "$(cat /tmp/rustled.pid)"; tail --pid="$(cat /tmp/rustled.pid)" -f /dev/null ;;
  *) exit 0 ;;
esac
"""

SNAPSHOT = r"""snapshot() {
  find / \( -path /proc -o -path /sys -o -path /dev -o -path /run -o -path /tmp -o -path /root \) -prune -o -printf '%p\n' | sort >"/root/$1.files"
  find /etc -type f -exec sha256sum {} + | sort -k 2 >"/root/$1.etc"
}
owner_of() { for process in /proc/[0-9]*; do [ "$(cat $process/comm 2>/dev/null)" != "$1" ] || stat -c %U $process; done; }
"""

#: After the ten lines: they heard something, and what the daemon recorded gives a sound as well.
HEARD = r"""python3 -c 'import numpy, runpy; sound = runpy.run_path("attach.py")["sound"]; print("heard", numpy.abs(sound.samples).max())'
recorded=$(find /var/lib/rustle/recordings -name '*.mcap' | head -1)
rustle render "$recorded" -o flag.wav
[ "$(stat -c %U "$recorded")" = rustle ]
[ "$(owner_of rustled)" = rustle ]
"""

#: The page and all that it names are served.
PAGE = r"""for asset in $(grep -oE '(src|href)="[^"#:]+"' page.html | cut -d'"' -f2 | sed 's,^\./,,; s,^/,,'); do
  curl --silent --fail "http://127.0.0.1:7393/$asset" -o asset
  [ -s asset ]
  echo "page has $asset"
done
"""


def run(*command, **options):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=WAIT_S, **options)
    if done.returncode != 0:
        raise AssertionError(f"{command}: status {done.returncode}\n{done.stdout[-4000:]}{done.stderr[-4000:]}")
    return done.stdout


def field(package, name):
    return run("dpkg-deb", "-f", package, name).strip()


def packages():
    found = sorted(PACKAGES.glob("*.deb"))
    if not found:
        raise AssertionError(f"{PACKAGES} has no packages; make them with deploy/debian/build.sh")
    return {field(package, "Package"): package for package in found}


def dependencies():
    """Names of other packages that ours depend on, of alternatives the first."""
    ours = packages()
    named = [re.match(r"[\w.+-]+", each.strip())[0] for package in ours.values() for each in field(package, "Depends").split(",") if each.strip()]
    return sorted(set(named) - set(ours))


def fresh_debian(*more):
    """An archive of a Debian with these packages more, made once."""
    KEPT.mkdir(parents=True, exist_ok=True)
    name = hashlib.sha256(" ".join(more).encode()).hexdigest()[:12]
    archive = KEPT / f"debian-{name}.tar"
    if not archive.exists():
        run("mmdebstrap", "--quiet", "--variant=apt", "--aptopt=Acquire::Languages \"none\"", "--aptopt=APT::Install-Recommends \"false\"",
            f"--include={','.join(more)}" if more else "--verbose", "bookworm", archive.with_suffix(".part.tar"))
        archive.with_suffix(".part.tar").rename(archive)
    return archive


def blocks():
    """The guide's steps: (language, file, body), with what is for the fresh Debian only."""
    return [block for block in BLOCK.findall(GUIDE.read_text()) if block[0] == "debian" or (block[0] == "python" and block[1])]


def script():
    """The guide's steps as one script, with looks at the file system between them."""
    lines = ["set -eux", "export HOME=/root DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8 PAGER=cat SYSTEMD_PAGER=cat", "cd /root", SNAPSHOT, "snapshot fresh"]
    for language, file, body in blocks():
        if file:
            lines.append(f"cat >{file} <<'END'\n{body}END")
            continue
        lines.append(body)
        if "attach.py" in body:
            lines += [HEARD, PAGE]
        if "apt install" in body:
            lines += ["systemd-analyze verify --man=no rustled.service", "snapshot installed"]
        if "apt remove" in body:
            lines += ['[ -z "$(owner_of rustled)" ]', "snapshot removed"]
        if "apt purge" in body:
            lines.append("snapshot purged")
    return "\n".join(lines) + "\necho every step done\n"


class Debian(unittest.TestCase):
    """Everything there is to see after the steps, however they were run."""

    def unpack(self, archive):
        holder = tempfile.TemporaryDirectory(dir=KEPT, ignore_cleanup_errors=True)
        self.addCleanup(holder.cleanup)
        root = pathlib.Path(holder.name) / "root"
        root.mkdir()
        run("tar", "-xf", archive, "-C", root)
        (root / "root/packages").mkdir()
        for package in packages().values():
            shutil.copy(package, root / "root/packages")
        (root / "etc/apt/apt.conf.d/90test").write_text('APT::Get::Assume-Yes "true";\nAPT::Install-Recommends "false";\nAPT::Sandbox::User "root";\n')
        return root

    def seen(self, root, when):
        files = set((root / f"root/{when}.files").read_text().splitlines())
        etc = dict(reversed(line.split("  ", 1)) for line in (root / f"root/{when}.etc").read_text().splitlines())
        return {path for path in files if not NOT_OURS.match(path)}, {path: told for path, told in etc.items() if not NOT_OURS.match(path)}

    def check(self, root, said):
        self.assertIn("every step done", said, said[-6000:])
        self.assertGreater(float(re.search(r"^heard ([\d.]+)", said, re.MULTILINE)[1]), 1e-3)
        self.assertRegex(said, r"flag\.wav: 2\.\d+ s from 120 frames.*peak -\d")
        self.assertIn("page has ", said)
        files, etc = self.seen(root, "fresh")
        installed, _ = self.seen(root, "installed")
        for path in ("/usr/bin/rustled", "/usr/bin/rustle", "/etc/rustle/rustled.toml", "/usr/share/man/man1/rustle-render.1.gz",
                     "/usr/share/bash-completion/completions/rustle", "/usr/share/rustle/packs/printer-paper/pack.json",
                     "/usr/share/rustle/page/index.html"):
            self.assertIn(path, installed)
        left, left_etc = self.seen(root, "removed")
        self.assertEqual({path for path in left - files if not STAYS.match(path)}, set())
        self.assertIn("/etc/rustle/rustled.toml", left)
        self.assertTrue([path for path in left if path.startswith("/var/lib/rustle/recordings/flag")], left - files)
        self.assertEqual(files - left, set())
        self.assertEqual({path for path in left_etc if etc.get(path) != left_etc[path]} - set(USERS), {"/etc/rustle/rustled.toml"})
        purged, purged_etc = self.seen(root, "purged")
        self.assertEqual(purged ^ files, set())
        self.assertEqual(purged_etc, etc)
        ours = tuple(f"{name}{after}" for name in packages() for after in (".", ":"))
        self.assertEqual([path.name for path in (root / "var/lib/dpkg/info").iterdir() if path.name.startswith(ours)], [])

    def test_with_systemd(self):
        root = self.unpack(fresh_debian(*BROUGHT, *dependencies()))
        (root / "root/steps.sh").write_text(script())
        (root / "etc/systemd/system/steps.service").write_text(
            "[Unit]\nAfter=dbus.service\nSuccessAction=exit-force\nFailureAction=exit-force\n[Service]\nExecStart=/bin/bash /root/steps.sh\n"
            "StandardOutput=file:/root/said\nStandardError=file:/root/said\n")
        wants = root / "etc/systemd/system/multi-user.target.wants"
        wants.mkdir(exist_ok=True)
        (wants / "steps.service").symlink_to("/etc/systemd/system/steps.service")
        booted = subprocess.run(["systemd-nspawn", "--quiet", "--directory", root, "--private-network", "--register=no", "--keep-unit", "--machine=rustle-packages",
                                 "--boot"], stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", timeout=WAIT_S)
        if not (root / "root/said").exists():
            self.skipTest("systemd does not boot in a container here: " + booted.stderr[-300:])
        said = (root / "root/said").read_text()
        self.check(root, said)
        self.assertRegex(said, r"Active: active \(running\)")

    def enter(self, root, command, network):
        """Output of a command in the root, in processes and mounts of its own."""
        def own():
            if network:
                enter_own_network()
        done = subprocess.run(["unshare", "--mount", "--pid", "--fork", "--kill-child", f"--mount-proc={root}/proc", "chroot", root, "/bin/bash", "-c", command],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, text=True, timeout=WAIT_S, preexec_fn=own)
        return done.stdout

    def test_without_systemd(self):
        root = self.unpack(fresh_debian(*BROUGHT, *dependencies()))
        (root / "root/steps.sh").write_text(script())
        systemctl = root / "usr/local/bin/systemctl"
        systemctl.write_text(SYSTEMCTL)
        systemctl.chmod(0o755)
        # Who removes packages without systemd ends the daemon.
        text = (root / "root/steps.sh").read_text().replace("sudo apt remove", "systemctl stop rustled\nsudo apt remove")
        (root / "root/steps.sh").write_text(text)
        self.check(root, self.enter(root, "bash /root/steps.sh", network=True))

    def test_apt_finds_all_that_the_packages_need(self):
        root = self.unpack(fresh_debian())
        shutil.copy("/etc/resolv.conf", root / "etc/resolv.conf")
        archives = KEPT / "archives"
        archives.mkdir(exist_ok=True)
        for kept in archives.iterdir():
            shutil.copy(kept, root / "var/cache/apt/archives")
        (root / "etc/apt/apt.conf.d/91keep").write_text('Binary::apt::APT::Keep-Downloaded-Packages "true";\n')
        said = self.enter(root, "cd /root; export DEBIAN_FRONTEND=noninteractive; apt-get update -qq; apt install ./packages/*.deb && rustled --version"
                          " && rustle pack list && python3 -c 'import rustle; print(\"imported\")' && dpkg --audit", network=False)
        for kept in (root / "var/cache/apt/archives").glob("*.deb"):
            shutil.copy(kept, archives)
        self.assertIn("printer-paper", said, said[-4000:])
        self.assertTrue(said.endswith("imported\n"), said[-4000:])


if __name__ == "__main__":
    unittest.main(verbosity=1)
