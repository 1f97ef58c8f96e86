"""A copy of the workspace with mutants behind switches, and the compiler's word on which of them compile."""

import hashlib
import json
import os
import re
import subprocess
from collections import defaultdict
from pathlib import Path

SWITCH = "mutant-switch"
MANIFEST = '[package]\nname = "mutant-switch"\nversion = "0.1.0"\nedition = "2024"\nlicense = "MIT OR Apache-2.0"\n'
CODE = '''//! The mutant that `DAPPLE_MUTANT` names is on. With `DAPPLE_MUTANT_SEEN=FILE` none is, and the numbers of those reached go to FILE.
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
static mut ACTIVE: u32 = 0;
static SEEN: [AtomicBool; 16384] = [const { AtomicBool::new(false) }; 16384];
#[cold]
#[inline(never)]
fn seen(id: u32) -> bool {
    SEEN[id as usize].store(true, Relaxed);
    false
}
#[inline(always)]
pub fn on(id: u32) -> bool {
    // SAFETY: written before `main` alone.
    let active = unsafe { ACTIVE };
    active == id || active == u32::MAX && seen(id)
}
extern "C" fn start() {
    if let Ok(id) = std::env::var("DAPPLE_MUTANT") {
        unsafe { ACTIVE = id.parse().expect("a number") };
    } else if std::env::var_os("DAPPLE_MUTANT_SEEN").is_some() {
        unsafe { ACTIVE = u32::MAX };
        unsafe { atexit(finish) };
    }
}
extern "C" fn finish() {
    let Some(path) = std::env::var_os("DAPPLE_MUTANT_SEEN") else { return };
    let ids = (0..SEEN.len()).filter(|i| SEEN[*i].load(Relaxed)).map(|i| format!("{i}\\n"));
    if let Ok(mut file) = std::fs::OpenOptions::new().create(true).append(true).open(path) {
        let _ = file.write_all(ids.collect::<String>().as_bytes());
    }
}
unsafe extern "C" {
    fn atexit(call: extern "C" fn()) -> i32;
}
#[used]
#[unsafe(link_section = ".init_array")]
static START: extern "C" fn() = start;
'''


def environment():
    """Cargo's, for a build that is made once."""
    return os.environ | {
        "CARGO_INCREMENTAL": "0", "CARGO_PROFILE_DEV_DEBUG": "false", "CARGO_PROFILE_DEV_CODEGEN_UNITS": "64",
        "CARGO_TERM_COLOR": "never",
    }


def planted(source, sites):
    """A file's text with its mutants `(number, site)`, and what each of them inserted: `(start, end, number, is_mutated)`."""
    inserted = []

    def rendered(start, end, sites, at):
        """`source[start..end]` with the sites inside; `at` is where it will lie in the output."""
        out, position = b"", start
        sites = sorted(sites, key=lambda s: (s[1].start, -s[1].end))
        while sites:
            outer = sites[0][1]
            same = [s for s in sites if (s[1].start, s[1].end, s[1].form) == (outer.start, outer.end, outer.form)]
            inner = [s for s in sites if s not in same and s[1].start >= outer.start and s[1].end <= outer.end and outer.start < outer.end]
            sites = [s for s in sites if s not in same and s not in inner]
            out += source[position:outer.start]
            begin = at + len(out)
            if outer.form == "expression":
                out += b"("
            for number, site in same:
                condition = f"::mutant_switch::on({number})"
                head, tail = {
                    "expression": (f"if {condition} {{ ", " } else "),
                    "statement": (f"if !{condition} {{ ", ""),
                    "body": (f" if {condition} {{ ", " }"),
                }[site.form]
                out += head.encode()
                mutated = at + len(out)
                out += site.code.encode()
                inserted.append((mutated, at + len(out), number, True))
                out += tail.encode()
            if outer.form == "expression":
                out += b"{ "
            out += rendered(outer.start, outer.end, inner, at + len(out))
            out += {"expression": b" })", "statement": b" }", "body": b""}[outer.form]
            inserted.extend((begin, at + len(out), number, False) for number, _ in same)
            position = outer.end
        return out + source[position:end]

    return rendered(0, len(source), sites, 0), inserted


class Copy:
    """The copy in a folder: files are written only where they changed, so that little is compiled again."""

    def __init__(self, root, folder, jobs):
        self.root, self.folder, self.jobs = Path(root).resolve(), Path(folder).resolve(), str(jobs)
        self.inserted = {}

    def write(self, file, content):
        path = self.folder / file
        if not path.exists() or path.read_bytes() != content:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            path.chmod((self.root / file).stat().st_mode if (self.root / file).exists() else 0o644)

    def files(self):
        listed = ["git", "ls-files", "-co", "--exclude-standard"]
        files = subprocess.run(listed, cwd=self.root, check=True, capture_output=True, text=True).stdout.splitlines()
        return sorted(f for f in files if (self.root / f).is_file())

    def code(self):
        """A hash of the workspace's Rust code and manifests."""
        digest = hashlib.sha256()
        for file in self.files():
            if file.endswith((".rs", "Cargo.toml")):
                digest.update(file.encode() + (self.root / file).read_bytes())
        return digest.hexdigest()[:16]

    def plant(self, sites):
        """Writes the workspace with these mutants, `{number: site}`."""
        self.inserted, by_file = {}, defaultdict(list)
        for number, site in sites.items():
            by_file[site.file].append((number, site))
        files = self.files()
        for old in self.folder.glob("crates/*/**/*.rs"):
            if SWITCH not in old.parts and str(old.relative_to(self.folder)) not in files:
                old.unlink()
        for file in files:
            content = (self.root / file).read_bytes()
            if file in by_file:
                content, self.inserted[file] = planted(content, by_file[file])
            if re.fullmatch(r"crates/[^/]+/Cargo.toml", file):
                line = f'{SWITCH} = {{ path = "../{SWITCH}" }}'
                known = content.decode()
                if "[dependencies]\n" not in known:
                    known += "\n[dependencies]\n"
                content = known.replace("[dependencies]\n", f"[dependencies]\n{line}\n", 1).encode()
            if file != "Cargo.lock" or not (self.folder / file).exists():
                self.write(file, content)
        self.write(f"crates/{SWITCH}/Cargo.toml", MANIFEST.encode())
        self.write(f"crates/{SWITCH}/src/lib.rs", CODE.encode())

    def cargo(self, *arguments):
        """Runs cargo and yields its messages."""
        command = ["cargo", *arguments, "--offline", "--message-format=json", "-j", self.jobs]
        process = subprocess.Popen(command, cwd=self.folder, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        out, err = process.communicate()
        messages = [json.loads(line) for line in out.splitlines() if line.startswith("{")]
        return process.returncode, messages, err

    def broken(self, packages):
        """The numbers of mutants that do not compile, found in one pass of the compiler."""
        code, messages, err = self.cargo("check", "--keep-going", "--lib", *(a for p in packages for a in ("-p", p)))
        broken = set()
        for message in messages:
            if message["reason"] == "compiler-message" and message["message"]["level"].startswith("error"):
                spans = message["message"]["spans"]
                hit = set()
                for chosen in ([s for s in spans if s["is_primary"]], spans):
                    hit = hit or {n for s in chosen for n in self.at(s)}
                broken |= hit
                if spans and not hit:
                    raise SystemExit(f"an error far from any mutant:\n{message['message']['rendered']}")
        if code != 0 and not broken:
            raise SystemExit(err)
        return broken

    def at(self, span):
        """The mutants that a span of an error lies in, or that lie in it."""
        while span.get("expansion"):
            span = span["expansion"]["span"]
        inserted = self.inserted.get(span["file_name"], [])
        a, b = span["byte_start"], span["byte_end"]
        inside = [(e - s, n) for s, e, n, mutated in inserted if mutated and s <= a and b <= e]
        around = [(e - s, n) for s, e, n, _ in inserted if s <= a and b <= e]
        within = [(0, n) for s, e, n, _ in inserted if a <= s and e <= b]
        near = inside or around or within
        return {n for size, n in near if size == min(near)[0]}

    def build(self, packages, programs):
        """Compiles the test programs, and returns `(package, target, is unit, executable, folder)` of each."""
        targets = [a for p in programs for a in ("--test", p)]
        code, messages, err = self.cargo("test", "--no-run", "--lib", *targets, *(a for p in packages for a in ("-p", p)))
        if code != 0:
            errors = [m["message"]["rendered"] for m in messages if m["reason"] == "compiler-message" and m["message"]["level"] == "error"]
            raise SystemExit("\n".join(errors) or err)
        for m in messages:
            if m["reason"] == "compiler-artifact" and m["executable"] and m["profile"]["test"]:
                folder = Path(m["manifest_path"]).parent
                yield folder.name if folder != self.folder else "dapple", m["target"]["name"], "lib" in m["target"]["kind"], m["executable"], str(folder)
