#!/usr/bin/python3
"""Manual pages, completions and the service's configuration: they say what --help and --print-config say, all of it and nothing else."""
import gzip
import os
import re
import shutil
import subprocess
import unittest

from support import BIN, BUILD, RustleTest, main

MANUAL = BUILD / "manual"
SERVICE_SAYS = {"audio.device": "'none'", "recordings.folder": "'/var/lib/rustle/recordings'"}  #: other than the defaults


def run(*command, **options):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=60, **options)
    if done.returncode != 0:
        raise AssertionError(f"{command}: status {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def help_of(command):
    program, *words = command
    return run(BIN / program, *words, "--help")


def below(command):
    """Itself and every command below it, as --help names them."""
    yield command
    listed = re.search(r"^Subcommands:\n((?:  .*\n)+)", help_of(command), re.MULTILINE)
    for name in re.findall(r"^  ([a-z]\S*)", listed[1], re.MULTILINE) if listed else []:
        yield from below((*command, name))


def section(text, title):
    found = re.search(rf"^{title}:\n((?:  .*\n)+)", text, re.MULTILINE)
    return found[1] if found else ""


def flags_of(command):
    """Every name of every flag, "-o" and "--output"."""
    names = re.findall(r"^  (-\S+)", section(help_of(command), "Options"), re.MULTILINE)
    return {name for line in names for name in line.split(",")}


COMMANDS = [command for program in ("rustle", "rustled") for command in below((program,))]


def plain(roff):
    """What a reader sees of a page's source."""
    roff = re.sub(r"\\f[BIR]", "", roff)
    for escape, letter in ((r"\-", "-"), (r"\(ti", "~"), (r"\(ha", "^"), (r"\(ga", "`"), (r"\(aq", "'"), (r"\&", ""), (r"\e", "\\")):
        roff = roff.replace(escape, letter)
    return roff


def page_of(command):
    return gzip.decompress((MANUAL / "man" / command[0] / ("-".join(command) + ".1.gz")).read_bytes()).decode()


def words(text):
    return re.sub(r"\s+", " ", text)


class Pages(RustleTest):
    def test_every_command_has_a_page_and_no_page_is_of_another(self):
        self.assertGreater(len(COMMANDS), 25)
        pages = {path.name for path in (MANUAL / "man").rglob("*.1.gz")}
        self.assertEqual(pages, {"-".join(command) + ".1.gz" for command in COMMANDS})

    def test_pages_have_every_flag_of_help_and_all_that_it_says(self):
        for command in COMMANDS:
            with self.subTest(command=command):
                source, told = page_of(command), help_of(command)
                headed = "".join(re.findall(r"^\.TP\n(.*)$", source, re.MULTILINE))
                self.assertEqual(set(re.findall(r"\\fB((?:\\-)+[^\\]\S*?)\\fR", headed)), {flag.replace("-", r"\-") for flag in flags_of(command)})
                page = words(plain(source))
                for title in ("Options", "Positionals", "Subcommands"):
                    for line in section(told, title).splitlines():
                        name, *meaning = re.split(r"\s{2,}", line.removeprefix("  "), maxsplit=1)
                        if meaning:  # else it is on the next line
                            self.assertIn(words(meaning[0]).strip(), page)
                footer = told.rstrip("\n").split("\n\n")[-1]
                for line in footer.removeprefix("Example: ").splitlines() if "  " not in footer.splitlines()[0][:2] else []:
                    self.assertIn(words(line).removeprefix("Example: ").strip(), page)

    def test_the_configurations_page_has_every_setting(self):
        page = words(plain(gzip.decompress((MANUAL / "man/rustled/rustled.toml.5.gz").read_bytes()).decode()))
        for line in run(BIN / "rustled", "--config", "none", "--print-config").splitlines():
            if " = " in line:
                self.assertIn(words(line), page)

    @unittest.skipUnless(shutil.which("man"), "man is not installed")
    def test_pages_are_laid_out_without_warnings(self):
        for path in (MANUAL / "man").rglob("*.gz"):
            with self.subTest(page=path.name):
                done = subprocess.run(["man", "--warnings", "-E", "UTF-8", "-l", "-Tutf8", "-Z", path], capture_output=True, text=True, timeout=60,
                                      env={**os.environ, "MANWIDTH": "80", "LC_ALL": "C.UTF-8"})
                self.assertEqual((done.returncode, done.stderr), (0, ""))
                self.assertGreater(len(done.stdout), 500)


def completed_by_bash(line, folder):
    """What bash offers at the end of a line of words, the last of which is being typed."""
    script = 'source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); "_$1"; printf "%s\\n" "${COMPREPLY[@]}"'
    return set(run("bash", "-c", script, "bash", MANUAL / "bash" / line[0], *line, cwd=folder).split())


def completed_by_fish(line, folder):
    said = run("fish", "--no-config", "-c", f"source {MANUAL}/fish/{line[0]}.fish; complete -C '{' '.join(line)}'", cwd=folder,
               env={**os.environ, "HOME": str(folder)})
    return {offer.split("\t")[0] for offer in said.splitlines()}


#: A shell at a terminal: it is asked when its prompt is there, and has answered when it runs the next command.
ZSH = r"""
zmodload zsh/zpty; zpty shell zsh -f -i
zpty -w shell "fpath=($1 \$fpath); autoload -U compinit; compinit -u -D; LISTMAX=1000000; stty columns 300 rows 1000; PS1='asks''> '"
zpty -r -m shell said '*asks> *'
zpty -w -n shell "$2"$'\t\t\C-u'"print is''answered"$'\n'
zpty -r -m shell said '*isanswered*'
print -r -- $said
zpty -d shell
"""


def completed_by_zsh(line, folder):
    said = run("zsh", "-f", "-c", ZSH, "zsh", MANUAL / "zsh", " ".join(line), cwd=folder, env={**os.environ, "HOME": str(folder), "TERM": "xterm"})
    return set(re.findall(r"[\w-]+", re.sub(r"\x1b\[[\d;?]*[A-Za-z]", " ", said)))


class Completion(RustleTest):
    def test_bash_offers_every_command_and_flag(self):
        for command in COMMANDS:
            with self.subTest(command=command):
                self.assertEqual(completed_by_bash([*command, "-"], self.folder), flags_of(command))
                below = {other[-1] for other in COMMANDS if other[:-1] == command}
                if below:
                    self.assertEqual(completed_by_bash([*command, ""], self.folder), below)

    def asked(self, completed):
        """Questions that every shell answers alike."""
        (self.folder / "sheet.mcap").touch()
        self.assertGreaterEqual(completed(["rustle", "rep"], self.folder), {"replay"})
        self.assertGreaterEqual(completed(["rustle", "pack", "ca"], self.folder), {"calibrate"})
        self.assertGreaterEqual(completed(["rustle", "render", "--fri"], self.folder), {"--friction-fft"})
        self.assertGreaterEqual(completed(["rustle", "render", "--format", ""], self.folder), {"f32", "s16", "s24"})
        self.assertGreaterEqual(completed(["rustled", "--audio-api", ""], self.folder), {"auto", "pulse", "jack", "alsa"})
        self.assertIn("sheet", " ".join(completed(["rustle", "render", "she"], self.folder)))

    def test_bash(self):
        self.asked(completed_by_bash)
        self.assertEqual(completed_by_bash(["rustle", "render", "--format", "=", "s1"], self.folder), {"s16"})
        self.assertEqual(completed_by_bash(["rustle", "render", "--format", "="], self.folder), {"f32", "s16", "s24"})
        self.assertEqual(completed_by_bash(["rustle", "render", "sheet.mcap", "-o", ""], self.folder), {"sheet.mcap"})

    @unittest.skipUnless(shutil.which("fish"), "fish is not installed")
    def test_fish(self):
        self.asked(completed_by_fish)
        self.assertNotIn("generate", completed_by_fish(["rustle", ""], self.folder))

    @unittest.skipUnless(shutil.which("zsh"), "zsh is not installed")
    def test_zsh(self):
        self.asked(completed_by_zsh)


def settings(text):
    """{section.key: value} of what is said, in the order it is said in."""
    found, name = {}, ""
    for line in text.splitlines():
        if heading := re.fullmatch(r"\[(\w+)\]", line):
            name = heading[1]
        elif said := re.fullmatch(r"(\w+) = (.*)", line):
            found[f"{name}.{said[1]}"] = said[2]
    return found


class Configuration(RustleTest):
    def in_force(self, file):
        environment = {name: value for name, value in os.environ.items() if not name.startswith("RUSTLED_")}
        return settings(run(BIN / "rustled", "--config", file, "--print-config", env=environment))

    def test_as_it_is_it_gives_the_defaults_but_for_what_a_service_needs(self):
        file = MANUAL / "rustled.toml"
        self.assertEqual(settings(file.read_text()), SERVICE_SAYS)
        self.assertEqual(self.in_force(file), {**self.in_force("none"), **SERVICE_SAYS})

    def test_it_has_every_key_explained_with_its_default(self):
        text = (MANUAL / "rustled.toml").read_text()
        said = re.sub(r"^#(\w+ = )", r"\1", text, flags=re.MULTILINE)
        (self.folder / "all.toml").write_text(said)
        defaults = {**self.in_force("none"), **SERVICE_SAYS}
        self.assertEqual(list(settings(said).items()), list(defaults.items()))
        self.assertEqual(self.in_force(self.folder / "all.toml"), defaults)
        lines = text.splitlines()
        for before, line in zip(lines, lines[1:]):
            if re.match(r"#?\w+ = ", line):
                self.assertRegex(before, r"^# \S.{20,}--[\w-]+, RUSTLED_\w+", line)


if __name__ == "__main__":
    main()
