"""What a batch is to render, and what of it is done.

A batch is a folder OUT:
  plan.json                     the captures in their order, and how they are rendered
  renders/NAME.wav, .jsonl      a capture's sound and events (.html: its page); NAME is its path below the captures' folder
  renders/NAME.json             its result, written last: without it, or with another key, the capture is rendered (again)
  report.json, report.html      the merged report
"""
import contextlib
import dataclasses
import fcntl
import hashlib
import json
import os
import pathlib
import subprocess
import tempfile
import zlib

DONE, INCOMPLETE, FAILED, WAITING = "done", "incomplete", "failed", "waiting"
SET_BY_BATCH = ("-o", "--output", "--events", "--report", "--stems", "--emitters", "--json", "-h", "--help")


class Mistake(Exception):
    """What a user can mend; the message says how."""


@contextlib.contextmanager
def written_whole(path):
    """A text file that takes its name once it is whole, whoever else writes it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with open(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            yield file
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise


def version_of(program):
    try:
        done = subprocess.run([program, "--version"], capture_output=True, text=True, timeout=60)
    except OSError as error:
        raise Mistake(f"{program}: cannot be run ({error.strerror}); name the program with `plan --program`") from None
    if done.returncode != 0:
        raise Mistake(f"{program} --version fails: {done.stderr.strip()}; name another program with `plan --program`")
    return done.stdout.strip()


def captures_below(folder, but_not):
    """Paths of all captures below the folder, relative to it, in the order of their names."""
    found = []
    for here, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".") and pathlib.Path(here, name) != but_not]
        found += [os.path.relpath(os.path.join(here, name), folder) for name in files if name.endswith(".mcap") and not name.startswith(".")]
    return sorted(found)


def check_options(program, options, cwd):
    """Mistake when `rustle render` does not take these options."""
    for option in options:
        if option.split("=")[0] in SET_BY_BATCH:
            raise Mistake(f"{option}: what is written where is the batch's affair; leave it out (`plan --pages` writes a page for each capture)")
    nowhere = "no such capture.mcap"
    done = subprocess.run([program, "render", *options, "-o", "no such folder/sound.wav", nowhere], capture_output=True, text=True, cwd=cwd)
    if nowhere not in done.stderr:
        raise Mistake(f"rustle render does not take {' '.join(options)}: {done.stderr.splitlines()[0] if done.stderr else 'no word why'}; "
                      "`rustle render --help` lists its options")


@dataclasses.dataclass(frozen=True)
class Plan:
    out: pathlib.Path
    folder: str  # of the captures
    captures: list  # paths below it; a capture's number counts them from 1
    options: list  # of `rustle render`
    pages: bool  # whether each capture gets an HTML report of its own
    program: str
    version: str
    cwd: str  # what relative paths in the options start from
    generation: int  # counts the times when all was to be rendered anew

    @staticmethod
    def load(out):
        out = pathlib.Path(out).absolute()
        try:
            told = json.loads((out / "plan.json").read_text())
        except FileNotFoundError:
            raise Mistake(f"{out} has no plan; make one with `plan CAPTURES {out}`") from None
        return Plan(out=out, **told)

    def save(self):
        told = dataclasses.asdict(self)
        del told["out"]
        with written_whole(self.out / "plan.json") as file:
            json.dump(told, file, indent=1)

    def name(self, number):
        return self.captures[number - 1][:-len(".mcap")]

    def capture(self, number):
        return os.path.join(self.folder, self.captures[number - 1])

    def outputs(self, number):
        """The files of a render by the option of `rustle render` that names them."""
        base = os.path.join(self.out, "renders", self.name(number))
        return {"-o": base + ".wav", "--events": base + ".jsonl", **({"--report": base + ".html"} if self.pages else {})}

    def result_file(self, number):
        return self.out / "renders" / (self.name(number) + ".json")

    def key(self, number):
        """Tells this render from one of another capture, with other options or by another version. OSError without the capture."""
        def state(path):
            found = os.stat(path)
            return [found.st_size, found.st_mtime_ns]

        files = [os.path.join(self.cwd, option.split("=")[-1]) for option in self.options]
        told = [state(self.capture(number)), self.options, [state(path) for path in files if os.path.isfile(path)], self.pages, self.version,
                self.generation]
        return hashlib.sha256(json.dumps(told).encode()).hexdigest()

    def result(self, number):
        """The capture's result as it now stands: a dict whose "state" is one of the four."""
        waiting = {"state": WAITING, "reason": "not rendered yet"}
        try:
            key = self.key(number)
        except FileNotFoundError:
            return {"state": FAILED, "reason": "the capture is gone; plan again", "retry": True}
        except OSError as error:
            return {"state": FAILED, "reason": f"the capture cannot be reached ({error.strerror})", "retry": True}
        try:
            told = json.loads(self.result_file(number).read_text())
        except (OSError, ValueError):
            return waiting
        if told["key"] != key:
            return waiting
        for file, size in told["files"].items():
            path = self.out / "renders" / file
            if not path.is_file() or path.stat().st_size != size:
                return waiting
        return told

    def pending(self, retry=False):
        """Numbers that a run has to render. `retry`: also what went wrong and probably would again."""
        return [number for number in range(1, len(self.captures) + 1) if needs_render(self.result(number), retry)]


def needs_render(result, retry):
    return result["state"] == WAITING or (result["state"] in (FAILED, INCOMPLETE) and (retry or result["retry"]))


class Locks:
    """One lock for each capture: a byte of the file OUT/locks. They end with the process, and hold across machines where the
    file system's do. A render that is not locked out is only double work: files take their names whole."""

    def __init__(self, out):
        self.file = open(out / "locks", "a+b")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.file.close()

    def take(self, name, wait):
        """False: another holds it."""
        try:
            fcntl.lockf(self.file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB), 1, zlib.crc32(os.fsencode(name)) >> 1)
        except (BlockingIOError, PermissionError):
            return False
        return True

    def give(self, name):
        fcntl.lockf(self.file, fcntl.LOCK_UN, 1, zlib.crc32(os.fsencode(name)) >> 1)

    def take_all(self):
        """False: a render is going on."""
        try:
            fcntl.lockf(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB, 0, 0)
        except (BlockingIOError, PermissionError):
            return False
        return True


def make_plan(folder, out, program, options, pages, anew):
    """Writes OUT/plan.json; returns the plan."""
    folder, out = pathlib.Path(folder).absolute(), pathlib.Path(out).absolute()
    if not folder.is_dir():
        raise Mistake(f"{folder} is not a folder; name the one that holds the captures")
    captures = captures_below(folder, out)
    if not captures:
        raise Mistake(f"{folder} holds no captures (*.mcap); make some with `rustle import` or `rustle record`")
    generation = 0
    if (out / "plan.json").exists():
        before = Plan.load(out)
        if before.folder != str(folder):
            raise Mistake(f"{out} holds the renders of {before.folder}; name another folder to write to")
        generation = before.generation
    plan = Plan(out, str(folder), captures, options, pages, str(program), version_of(program), os.getcwd(), generation + bool(anew))
    check_options(program, options, plan.cwd)
    try:
        out.mkdir(parents=True, exist_ok=True)
        with Locks(out) as locks:
            if not locks.take_all():
                raise Mistake(f"captures of {out} are being rendered; wait for them, or stop that run first")
            plan.save()
    except OSError as error:
        raise Mistake(f"{out}: cannot be written ({error.strerror})") from None
    return plan
