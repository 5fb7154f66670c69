#!/usr/bin/python3
"""Batches: deploy/batch/batch.py renders a folder of captures once, whatever interrupts it, and reports what became of each.
The Slurm of tests/slurm/run.sh is used where it is installed."""
import contextlib
import html.parser
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import unittest
import urllib.parse

import numpy as np

from support import BIN, SOURCE, STORED_CAPTURE, RustleTest, main, read_events, read_wav, rms_dbfs, wait_until
from support import rustle as run_rustle

COMMAND = SOURCE / "deploy/batch/batch.py"
SLURM = ("munged", "slurmctld", "slurmd", "sbatch", "sinfo")
# Notes each render in the file `log`, and halts at held.mcap while there is a file `hold`.
PROGRAM = """#!/bin/bash
if [ "$1" = render ] && [ -f "$2" ]; then
  echo "$2" >> {folder}/log
  case "$2" in */held.mcap) if [ -e {folder}/hold ]; then exec sleep 60; fi ;; esac
fi
exec {rustle} "$@"
"""


class BatchTest(RustleTest):
    def setUp(self):
        super().setUp()
        self.captures, self.out, self.log = self.folder / "captures", self.folder / "out", self.folder / "log"
        self.program = self.folder / "rustle"
        self.program.write_text(PROGRAM.format(folder=self.folder, rustle=(BIN / "rustle").resolve()))
        self.program.chmod(0o755)
        self.environment = dict(os.environ)

    def fill(self, *names):
        for name in names:
            path = self.captures / name
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(STORED_CAPTURE, path)

    def cut(self, name, size):
        (self.captures / name).write_bytes(STORED_CAPTURE.read_bytes()[:size])

    def arguments(self, *arguments):
        return [sys.executable, COMMAND, *map(str, arguments)]

    def batch(self, *arguments, status=0):
        done = subprocess.run(self.arguments(*arguments), capture_output=True, text=True, timeout=120, env=self.environment, cwd=self.folder)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        return done

    def plan(self, *arguments, status=0):
        return self.batch("plan", self.captures, self.out, "--program", self.program, *arguments, status=status)

    def rendered(self):
        """Names of the captures that were rendered since this was asked last, in order of name."""
        names = sorted(os.path.relpath(line, self.captures) for line in self.log.read_text().splitlines()) if self.log.exists() else []
        self.log.unlink(missing_ok=True)
        return names

    def report(self):
        return json.loads((self.out / "report.json").read_text())

    def no_parts(self):
        self.assertEqual([path for path in self.out.rglob(".*")], [])


class Batch(BatchTest):
    def test_a_folder_is_rendered_once(self):
        odd = "below/it's \"a\" $x & é <b>.mcap"
        self.fill("a.mcap", "b.mcap", "c.mcap", odd)
        self.cut("nothing.mcap", 800)
        self.cut("half.mcap", 40000)
        every = sorted(["a.mcap", "b.mcap", "c.mcap", odd, "nothing.mcap", "half.mcap"])
        self.plan()
        first = self.batch("run", self.out, status=1)
        self.assertEqual(self.rendered(), every)
        for said in ("nothing.mcap: failed", "cut at byte 800", "half.mcap: incomplete", "6 captures: 4 done, 1 incomplete, 1 failed", "--retry"):
            self.assertIn(said, first.stdout + first.stderr)
        self.no_parts()

        run_rustle("render", STORED_CAPTURE, "-o", self.folder / "alone.wav")
        alone = read_wav(self.folder / "alone.wav")[1]
        report, totals = self.report(), self.report()["totals"]
        self.assertEqual([row["capture"] for row in report["captures"]], every)
        sounds, events = [], []
        for row in report["captures"]:
            if row["state"] == "failed":
                continue
            sounds.append(read_wav(self.out / row["sound"])[1])
            np.testing.assert_array_equal(sounds[-1], alone)
            events += read_events(self.out / row["event_list"])
            self.assertGreater(row["elapsed_s"], 0)
        self.assertEqual(len(sounds), 5)
        self.assertEqual(sum(totals["events"].values()), len(events))
        self.assertEqual(totals["events"]["friction"], 5)
        self.assertAlmostEqual(totals["sound_s"], sum(map(len, sounds)) / 48000)
        self.assertAlmostEqual(totals["rms_dbfs"], rms_dbfs(np.concatenate(sounds)), delta=0.01)
        self.assertAlmostEqual(totals["peak_dbfs"], 20 * np.log10(np.abs(alone).max()), delta=0.01)
        self.assertAlmostEqual(totals["elapsed_s"], sum(row["elapsed_s"] for row in report["captures"]))
        self.assertEqual([row["capture"] for row in report["failures"]], ["half.mcap", "nothing.mcap"])
        self.page_is_whole(every)

        stamps = {path: path.stat().st_mtime_ns for path in (self.out / "renders").rglob("*")}
        self.assertIn("nothing to do", self.batch("run", self.out, status=1).stdout)
        self.plan()
        self.batch("run", self.out, "--engine", "pool", status=1)
        self.assertEqual(self.rendered(), [])
        self.assertEqual({path: path.stat().st_mtime_ns for path in (self.out / "renders").rglob("*")}, stamps)

        # Mended, changed, lost, come and gone.
        self.fill("half.mcap", "new.mcap")
        os.utime(self.captures / "a.mcap", (1, 1))
        (self.out / "renders/b.wav").unlink()
        (self.captures / "c.mcap").unlink()
        self.assertIn("c.mcap: failed: the capture is gone; plan again", self.batch("run", self.out, status=1).stderr)
        self.plan()
        self.batch("run", self.out, status=1)
        self.assertEqual(self.rendered(), ["a.mcap", "b.mcap", "half.mcap", "new.mcap"])
        self.batch("run", self.out, "--retry", status=1)
        self.assertEqual(self.rendered(), ["nothing.mcap"])

    def page_is_whole(self, captures):
        """Every element is closed, every file that is linked is there, every capture is named."""
        open_elements, links, texts = [], [], []

        class Page(html.parser.HTMLParser):
            def handle_starttag(self, tag, attributes):
                if tag != "meta":
                    open_elements.append(tag)
                links.extend(value for name, value in attributes if name == "href")

            def handle_endtag(self, tag):
                assert open_elements.pop() == tag, tag

            def handle_data(self, data):
                texts.append(data)

        page = Page()
        page.feed((self.out / "report.html").read_text())
        page.close()
        self.assertEqual(open_elements, [])
        self.assertEqual(len(links), 10)
        for link in links:
            self.assertTrue((self.out / urllib.parse.unquote(link)).is_file(), link)
        self.assertLess(set(captures), set(texts))

    def test_options_are_of_the_plan(self):
        self.fill("a.mcap")
        self.plan("--pages", "--", "--channels", "mono", "--gain-db", "6")
        self.batch("run", self.out)
        row = self.report()["captures"][0]
        self.assertEqual(read_wav(self.out / row["sound"])[1].shape[1], 1)
        self.assertIn("</svg>", (self.out / row["page"]).read_text())
        self.assertEqual(self.rendered(), ["a.mcap"])
        self.plan("--", "--channels", "mono")
        self.batch("run", self.out)
        self.assertEqual(self.rendered(), ["a.mcap"])
        self.plan("--anew", "--", "--channels", "mono")
        self.batch("run", self.out)
        self.assertEqual(self.rendered(), ["a.mcap"])
        self.plan("--", "--channels", "mono")
        self.batch("run", self.out)
        self.assertEqual(self.rendered(), [])
        self.assertEqual(self.report()["failures"], [])

    def test_interrupted_it_goes_on(self):
        self.fill("a.mcap", "held.mcap", "z.mcap")
        self.plan()
        results = self.out / "renders"
        for engine, endings in (("pool", (signal.SIGTERM, signal.SIGKILL)), ("parallel", (signal.SIGTERM,) if shutil.which("parallel") else ())):
            for ending in endings:
                with self.subTest(engine=engine, ending=ending.name):
                    shutil.rmtree(results, ignore_errors=True)
                    (self.folder / "hold").touch()
                    running = subprocess.Popen(self.arguments("run", self.out, "--jobs", 2, "--engine", engine), env=self.environment,
                                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
                    wait_until(lambda: len(list(results.glob("*.json"))) == 2 and any(results.glob(".held.part*")), 20, "two beside the held one")
                    self.assertEqual(self.batch("list", self.out, "--pending").stdout, "2\n")
                    self.assertIn("are being rendered", self.plan(status=2).stderr)
                    if ending == signal.SIGKILL:
                        subprocess.run(["pkill", "-KILL", "-s", str(running.pid)])  # all of its session, as when the machine goes off
                    else:
                        running.send_signal(ending)
                    running.wait(10)
                    if ending == signal.SIGTERM:
                        self.assertEqual(running.returncode, 128 + ending)
                        self.no_parts()
                    self.assertEqual(self.rendered(), ["a.mcap", "held.mcap", "z.mcap"])
                    (self.folder / "hold").unlink()
                    self.batch("run", self.out, "--engine", engine)
                    self.assertEqual(self.rendered(), ["held.mcap"])
                    self.no_parts()

    def test_a_killed_render_is_tried_again(self):
        self.fill("a.mcap")
        self.plan()
        whole = self.program.read_text()
        for ending, again in (("KILL", True), ("ABRT", False)):
            self.program.write_text(whole.replace("exec", f"kill -{ending} $$; exec", 1).replace("if [ -e", "if true || [ -e").replace("*/held.mcap", "*/a.mcap"))
            self.assertIn(f"a.mcap: failed: ended by SIG{ending}", self.batch("run", self.out, "--retry", status=1).stderr)
            self.assertEqual(self.batch("list", self.out, "--pending").stdout, "1\n" if again else "")
        self.program.write_text(whole)
        self.batch("run", self.out, "--retry")

    def test_two_runs_at_once_share_the_work(self):
        names = [f"{letter}.mcap" for letter in "abcde"]
        self.fill(*names)
        self.plan()
        both = [subprocess.Popen(self.arguments("run", self.out, "--jobs", 2, "--engine", "pool"), env=self.environment, stdout=subprocess.PIPE,
                                 stderr=subprocess.STDOUT, text=True) for _ in range(2)]
        for running in both:
            said = running.communicate(timeout=60)[0]
            self.assertEqual(running.returncode, 0, said)
            self.assertIn("5 captures: 5 done", said)
        self.assertEqual(self.rendered(), names)
        self.no_parts()

    def test_a_slurm_array_covers_what_is_pending(self):
        """The script, run as Slurm would run it."""
        names = [f"{letter}.mcap" for letter in "abcdefg"]
        self.fill(*names)
        self.plan()
        self.batch("one", self.out, 1, "3-4")
        self.assertEqual(self.rendered(), ["a.mcap", "c.mcap", "d.mcap"])
        slurm = self.folder / "slurm-bin"
        slurm.mkdir()
        (slurm / "scontrol").write_text("#!/bin/bash\necho 'MaxArraySize            = 5'\n")
        (slurm / "sbatch").write_text(f"""#!/bin/bash
echo "$@" >> {self.folder}/submitted
for range in $(sed -n 's/^#SBATCH --array=\\([0-9,-]*\\).*/\\1/p' "${{@: -1}}" | tr , ' '); do
  for task in $(seq ${{range%-*}} ${{range#*-}}); do SLURM_ARRAY_TASK_ID=$task bash "${{@: -1}}" >&2; done
done
echo "42;cluster"
""")
        for program in slurm.iterdir():
            program.chmod(0o755)
        self.environment["PATH"] = f"{slurm}:{self.environment['PATH']}"
        written = self.batch("slurm", self.out, "--at-once", 2).stdout
        self.assertIn("4 captures in 3 tasks of up to 2", written)
        self.assertRegex((self.out / "slurm/batch.sh").read_text(), r"(?m)^#SBATCH --array=1,3-4%2$")
        self.assertIn("say 2 at least", self.batch("slurm", self.out, "--per-task", 1, status=2).stderr)
        self.batch("slurm", self.out, "--per-task", 4, "--wait", "--", "--partition=short")
        self.assertRegex((self.folder / "submitted").read_text(), r"^--parsable --wait --partition=short /")
        self.assertIn("nothing to do", self.batch("slurm", self.out, "--submit").stdout)
        self.assertEqual(self.rendered(), ["b.mcap", "e.mcap", "f.mcap", "g.mcap"])
        self.assertEqual(self.report()["totals"]["done"], 7)

    def test_mistakes_name_the_remedy(self):
        def refused(remedy, *arguments):
            self.assertIn(remedy, self.batch(*arguments, status=2).stderr)

        self.captures.mkdir()
        refused("rustle import", "plan", self.captures, self.out, "--program", self.program)
        refused("not a folder", "plan", self.folder / "nowhere", self.out, "--program", self.program)
        self.fill("a.mcap")
        refused("no program", "plan", self.captures, self.out, "--program", self.folder / "nothing")
        self.assertIn("`rustle render --help` lists", self.plan("--", "--rate", "5", status=2).stderr)
        self.assertIn("the batch's affair", self.plan("--", "--events", "x", status=2).stderr)
        refused("plan CAPTURES", "run", self.out)
        self.plan()
        refused("numbered from 1 to 1", "one", self.out, "2")
        refused("belong to `plan`", "run", self.out, "--", "--rate", "48000")
        (self.folder / "others").mkdir()
        shutil.copyfile(STORED_CAPTURE, self.folder / "others/a.mcap")
        refused("name another folder", "plan", self.folder / "others", self.out, "--program", self.program)
        self.program.write_text("#!/bin/bash\necho rustle 9.9\n")
        refused("`plan` again", "run", self.out)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@unittest.skipUnless(all(shutil.which(name) for name in SLURM), "Slurm is not installed: tests/slurm/run.sh installs it and runs this")
class Slurm(BatchTest):
    @contextlib.contextmanager
    def slurm(self):
        """A cluster of this one machine, without systemd."""
        place, host = self.folder / "cluster", socket.gethostname().split(".")[0]
        for folder in (place / "state", place / "spool"):
            folder.mkdir(parents=True)
        place.chmod(0o755)
        self.folder.chmod(0o755)
        key, munge = place / "key", place / "munge"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        user = "root" if os.geteuid() == 0 else subprocess.check_output(["id", "-un"], text=True).strip()
        (place / "slurm.conf").write_text(f"""
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={free_port()}
SlurmdPort={free_port()}
SlurmUser={user}
SlurmdUser={user}
AuthInfo=socket={munge}
StateSaveLocation={place}/state
SlurmdSpoolDir={place}/spool
SlurmctldPidFile={place}/slurmctld.pid
SlurmdPidFile={place}/slurmd.pid
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
NodeName={host} NodeAddr=127.0.0.1 CPUs={os.cpu_count()} State=UNKNOWN
PartitionName=short Nodes=ALL Default=YES State=UP
""")
        self.environment["SLURM_CONF"] = str(place / "slurm.conf")
        started = []

        def start(*command):
            with open(place / f"{command[0]}.said", "w") as said:
                started.append(subprocess.Popen(command, stdout=said, stderr=said, stdin=subprocess.DEVNULL, env=self.environment))

        def idle():
            told = subprocess.run(["sinfo", "-h", "-o", "%t"], env=self.environment, capture_output=True, text=True).stdout
            return told.strip() == "idle"

        try:
            start("munged", "--foreground", "--force", f"--socket={munge}", f"--key-file={key}", f"--pid-file={place}/munged.pid",
                  f"--seed-file={place}/seed", f"--log-file={place}/munged.log")
            wait_until(munge.exists, 10, f"munged does not start: {(place / 'munged.said').read_text()}")
            start("slurmctld", "-D")
            start("slurmd", "-D", "-N", host)
            wait_until(idle, 30, "Slurm does not start: " + "".join((place / f"{name}.said").read_text()[-2000:] for name in ("slurmctld", "slurmd")))
            yield
        finally:
            for process in reversed(started):
                process.terminate()
            for process in started:
                try:
                    process.wait(10)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()

    def test_a_folder_is_rendered_once(self):
        names = ["a.mcap", "b b.mcap", "c.mcap"]
        self.fill(*names)
        self.cut("nothing.mcap", 800)
        self.plan()
        with self.slurm():
            self.assertIn("4 captures: 3 done, 1 failed", self.batch("slurm", self.out, "--wait", "--", "--partition=short", status=1).stdout)
            self.assertEqual(self.rendered(), sorted([*names, "nothing.mcap"]))
            self.assertIn("cut at byte 800", self.report()["failures"][0]["reason"])
            self.assertEqual(len(list((self.out / "slurm").glob("*.txt"))), 4)
            self.assertIn("nothing to do", self.batch("slurm", self.out, "--wait", status=1).stdout)
            self.assertIn("partition", self.batch("slurm", self.out, "--retry", "--submit", "--", "--partition=nosuch", status=2).stderr)
        self.assertEqual(self.rendered(), [])


if __name__ == "__main__":
    main()
