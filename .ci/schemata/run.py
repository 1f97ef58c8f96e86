"""Test programs, run with one mutant on, within limits of processor time: the machine may be busy with other things."""

import json
import os
import re
import resource
import select
import shutil
import signal
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

MEMORY = 12 << 30
# Tests that are short are run by one process, up to this many seconds of processor time.
TOGETHER = 1.5
# Without progress for so long, a process waits for something that never comes.
STUCK = 90.0
BEGUN = re.compile(r"^test (\S+)(?: - should panic)? \.\.\. (ok|FAILED|ignored)?", re.M)


@dataclass(frozen=True)
class Program:
    """A test program: the unit tests of a crate, or one of `tests/`."""

    crate: str
    name: str
    executable: str
    folder: str

    def label(self):
        return f"{self.crate}/{self.name}"


def processor_time(pid):
    """Seconds that a process has used."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except (OSError, IndexError):
        return 0.0
    return sum(int(f) for f in fields[11:15]) / os.sysconf("SC_CLK_TCK")


def run(program, tests, variables, limit):
    """Runs tests until one fails: `(name of the failed test or "", how, processor seconds)`."""

    def limits():
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit) + 1, int(limit) + 3))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    scratch = tempfile.mkdtemp(prefix="dapple-mutant-")
    variables = os.environ | {"RAYON_NUM_THREADS": "1", "TMPDIR": scratch, "CARGO_MANIFEST_DIR": program.folder} | variables
    child = subprocess.Popen(
        [program.executable, "--exact", "--test-threads", "1", *tests], cwd=program.folder, env=variables, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True, preexec_fn=limits,
    )
    output, failed, how, used, since = "", "", "", 0.0, time.monotonic()
    while True:
        if select.select([child.stdout], [], [], 2.0)[0]:
            piece = os.read(child.stdout.fileno(), 65536)
            if not piece:
                break
            output += piece.decode(errors="replace")
            failed = next((m[1] for m in BEGUN.finditer(output) if m[2] == "FAILED"), "")
            if failed:
                how = "failed"
                break
        now = processor_time(child.pid)
        if now > used + 0.01:
            used, since = now, time.monotonic()
        elif time.monotonic() - since > STUCK:
            how = "stuck"
            break
    try:
        if how:
            os.killpg(child.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = status
    child.stdout.close()
    try:
        os.killpg(child.pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        pass
    shutil.rmtree(scratch, ignore_errors=True)
    if not how and status != 0:
        how = "time" if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL) else "ended"
    if how and not failed:
        unfinished = [m[1] for m in BEGUN.finditer(output) if m[2] is None]
        failed = unfinished[-1] if unfinished else tests[0]
    return failed, how, usage.ru_utime + usage.ru_stime


def listed(program):
    """The tests of a program that are not ignored."""

    def names(*arguments):
        command = [program.executable, "--list", "--format", "terse", *arguments]
        lines = subprocess.run(command, cwd=program.folder, capture_output=True, text=True).stdout.splitlines()
        return [line.removesuffix(": test") for line in lines if line.endswith(": test")]

    ignored = set(names("--ignored"))
    return [n for n in names() if n not in ignored]


def baseline(program, test, longest, variables):
    """Processor time of a test without mutants, and the mutants it reaches; none if it fails or takes too long."""
    with tempfile.NamedTemporaryFile(prefix="dapple-seen-") as file:
        failed, how, used = run(program, [test], variables | {"DAPPLE_MUTANT_SEEN": file.name}, longest)
        seen = sorted({int(line) for line in Path(file.name).read_text().split()})
    return {"seconds": round(used, 3), "seen": seen, "failed": how}


def groups(tests):
    """`(program, test, seconds)`, quickest first, put together where they are short and of one program."""
    tests = sorted(tests, key=lambda t: t[2])
    while tests:
        program, chosen, total = tests[0][0], [], 0.0
        rest = []
        for t in tests:
            if t[0] == program and (not chosen or total + t[2] <= TOGETHER):
                chosen.append(t)
                total += t[2]
            else:
                rest.append(t)
        yield program, [t[1] for t in chosen], total
        tests = rest


class State:
    """What is known already, in a file, so that a run can be stopped and resumed."""

    def __init__(self, path):
        self.path = Path(path)
        self.data = json.loads(self.path.read_text()) if self.path.exists() else {}

    def save(self):
        new = self.path.with_suffix(".new")
        new.write_text(json.dumps(self.data, ensure_ascii=False, indent=0))
        new.replace(self.path)
