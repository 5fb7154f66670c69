"""One capture's render: `rustle render` in a folder of its own, then renamed into place, then the result."""
import glob
import json
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import tempfile
import time

from plan import DONE, FAILED, INCOMPLETE, Mistake, needs_render, version_of, written_whole

FROM_OUTSIDE = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGXCPU)


def reason_of(said):
    """What `rustle` complained of, in a line."""
    lines = [line.strip() for line in said.splitlines() if line.strip() and not line.startswith("Run with --help")]
    return "; ".join(line[len("rustle: "):] if line.startswith("rustle: ") else line for line in lines[-3:])


def run_rustle(plan, number, folder):
    """(result without key and files, names of what it wrote into `folder` by option)."""
    names = {option: os.path.basename(path) for option, path in plan.outputs(number).items()}
    written = [word for option, name in names.items() for word in (option, os.path.join(folder, name))]
    began = time.monotonic()
    # In memory, so that a full disk is complained of.
    with open(os.memfd_create("told"), "w+b") as told, open(os.memfd_create("said"), "w+b") as said:
        process = subprocess.Popen([plan.program, "render", plan.capture(number), *plan.options, *written, "--json"], stdout=told, stderr=said,
                                   stdin=subprocess.DEVNULL, cwd=plan.cwd)
        try:
            _, status, usage = os.wait4(process.pid, 0)
        except BaseException:
            process.kill()
            process.wait()
            raise
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        told.seek(0)
        complaint, summary = reason_of(said.read().decode(errors="replace")), told.read()
    result = {"capture": plan.captures[number - 1], "host": socket.gethostname(), "elapsed_s": time.monotonic() - began,
              "processor_s": usage.ru_utime + usage.ru_stime, "memory_mb": usage.ru_maxrss / 1024}
    try:
        rendered = json.loads(summary) if process.returncode in (0, 1) else None
    except ValueError:
        rendered = None
    if rendered is None:
        status = process.returncode
        ended = f"ended by {signal.Signals(-status).name}" if status < 0 else f"rustle render ends with status {status}"
        if -status in FROM_OUTSIDE:
            ended += ": too little memory, a limit, or somebody's will"
        # Neither who killed it nor wrong usage (no such sound pack here) says anything of the capture: to be tried again.
        return {"state": FAILED, "reason": "; ".join(filter(None, (complaint, ended if status < 0 or not complaint else ""))),
                "retry": -status in FROM_OUTSIDE or status == 2, **result}, {}
    del rendered["output"]
    incomplete = process.returncode != 0
    return {"state": INCOMPLETE if incomplete else DONE, "reason": "; ".join(rendered["left_out"]) or complaint if incomplete else "", "retry": False,
            **result, "render": rendered}, names


def render(plan, number):
    """Renders a capture whose lock is held, and keeps the result. OSError: nothing can be written."""
    result_file = plan.result_file(number)
    place = result_file.parent
    place.mkdir(parents=True, exist_ok=True)
    prefix = f".{result_file.stem}.part-"
    for left in place.glob(f"{glob.escape(prefix)}*"):  # by a run that was killed
        if "." not in left.name[len(prefix):]:  # else of a capture whose name goes on
            shutil.rmtree(left, ignore_errors=True)
    key = plan.key(number)
    folder = tempfile.mkdtemp(prefix=prefix, dir=place)
    try:
        result, names = run_rustle(plan, number, folder)
        result_file.unlink(missing_ok=True)  # from here on it speaks of no files
        files = {}
        for option, path in plan.outputs(number).items():
            if option in names:
                os.replace(os.path.join(folder, names[option]), path)
                files[os.path.relpath(path, plan.out / "renders")] = os.path.getsize(path)
            else:
                pathlib.Path(path).unlink(missing_ok=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    result.update(key=key, files=files)
    with written_whole(result_file) as file:
        json.dump(result, file)
    return result


def check_version(plan):
    found = version_of(plan.program)
    if found != plan.version:
        raise Mistake(f"{plan.program} is {found}, the plan was made with {plan.version}; `plan` again to render all with {found}")


def render_these(plan, numbers, locks, retry, wait, tell):
    """Renders those of the captures that need it. What another run holds comes last, or with `wait` false not at all. `tell` is given
    each number, its result, and whether it was rendered."""
    later = []
    for waits, these in ((False, numbers), (True, later)):
        for number in these:
            name = plan.name(number)
            if not locks.take(name, waits):
                if wait:
                    later.append(number)
                continue
            try:
                result = plan.result(number)
                needed = needs_render(result, retry) and os.path.exists(plan.capture(number))
                if needed:
                    result = render(plan, number)
            finally:
                locks.give(name)
            tell(number, result, needed)
