#!/usr/bin/python3
"""What `cmake --install` puts below a prefix, and that strangers build and run with that and nothing else of ours."""
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import textwrap
import unittest

from support import BUILD, SOURCE, RustleTest, daemon, main, read_wav

STRANGER, MINIMAL = SOURCE / "tests/install", SOURCE / "client_sdk/examples/minimal.c"
C99 = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror")
MINGW = "x86_64-w64-mingw32-gcc"


def run(*command, **options):
    """What it printed."""
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300, **options)
    if done.returncode != 0:
        raise AssertionError(f"{command}: status {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def setting(name, otherwise=""):
    """Of the build."""
    found = re.search(rf"^{name}:\w+=(.*)$", (BUILD / "CMakeCache.txt").read_text(), re.MULTILINE)
    return found[1] if found else otherwise


LIBRARIES = setting("CMAKE_INSTALL_LIBDIR", "lib")
SANITIZE = [f"-fsanitize={setting('RUSTLE_SANITIZE')}"] if setting("RUSTLE_SANITIZE") else []


class Installed(RustleTest):
    @classmethod
    def setUpClass(cls):
        holder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(holder.cleanup)
        cls.prefix = pathlib.Path(holder.name) / "prefix"
        run("cmake", "--install", BUILD, "--prefix", cls.prefix)

    def daemon(self):
        """The installed one, with the installed packs."""
        return daemon(self.folder, program=self.prefix / "bin/rustled")

    def pkg_config(self, *arguments):
        environment = {**os.environ, "PKG_CONFIG_PATH": str(self.prefix / LIBRARIES / "pkgconfig")}
        return shlex.split(run("pkg-config", *arguments, env=environment))

    def test_programs_find_their_packs(self):
        folders = {path.name for path in (self.prefix / "share/rustle/packs").iterdir()}
        self.assertGreaterEqual(folders, {"printer-paper", "cotton"})
        listed = run(self.prefix / "bin/rustle", "pack", "list")
        self.assertIn(str(self.prefix / "share/rustle/packs"), listed + run(self.prefix / "bin/rustle", "doctor", "--json"))
        unit = (self.prefix / "lib/systemd/system/rustled.service").read_text()
        self.assertIn(f"ExecStart={setting('CMAKE_INSTALL_PREFIX')}/bin/rustled ", unit)
        for file in ("etc/rustle/rustled.toml", "lib/sysusers.d/rustle.conf", "share/man/man1/rustle-render.1.gz", "share/man/man5/rustled.toml.5.gz",
                     "share/bash-completion/completions/rustled", "share/zsh/site-functions/_rustle", "share/fish/vendor_completions.d/rustle.fish"):
            self.assertTrue((self.prefix / file).is_file(), file)

    def test_the_python_package_alone(self):
        root = self.folder / "root"
        run("cmake", "--install", BUILD, "--prefix", "/usr", "--component", "python", env={**os.environ, "DESTDIR": str(root)})
        self.assertEqual({path.relative_to(root).parts[:5] for path in root.rglob("*.py")}, {("usr", "lib", "python3", "dist-packages", "rustle")})
        with self.daemon() as ends:
            run(sys.executable, "-m", "rustle.demo", "-o", "bend.wav", "--seconds", "0.5", "--control", ends["control"], cwd=self.folder,
                env={**os.environ, "PYTHONPATH": str(root / "usr/lib/python3/dist-packages")})
        self.assertGreater(abs(read_wav(self.folder / "bend.wav")[1]).max(), 1e-3)

    def run_strangers(self, **options):
        with self.daemon() as ends:
            self.assertIn("samples, at most", run(self.folder / "stranger", ends["control"]))
            self.assertIn("120 frames", run(self.folder / "minimal", self.folder / "heard.wav", ends["control"], **options))
        self.assertGreater(abs(read_wav(self.folder / "heard.wav")[1]).max(), 1e-3)

    def test_strangers_with_cmake(self):
        flags = [f"-DCMAKE_{language}_FLAGS={' '.join(SANITIZE)}" for language in ("C", "CXX")]
        run("cmake", "-S", STRANGER, "-B", self.folder, f"-DCMAKE_PREFIX_PATH={self.prefix}", *flags)
        run("cmake", "--build", self.folder)
        self.run_strangers()

    def test_strangers_with_pkg_config(self):
        for name in ("rustle-client", "rustle-client-c"):
            self.assertEqual(self.pkg_config("--modversion", name), [setting("CMAKE_PROJECT_VERSION")])
        run("g++", "-std=c++20", *SANITIZE, STRANGER / "stranger.cpp", "-o", self.folder / "stranger", *self.pkg_config("--cflags", "--libs", "rustle-client"))
        run("gcc", *C99, *SANITIZE, MINIMAL, "-o", self.folder / "minimal", *self.pkg_config("--cflags", "--libs", "rustle-client-c"), "-lm")
        self.run_strangers(env={**os.environ, "LD_LIBRARY_PATH": str(self.prefix / LIBRARIES)})

    def test_the_c_library_shows_its_functions_only(self):
        """All that rustle.h declares, and nothing else."""
        declared = set(re.findall(r"^RUSTLE_API [^;(]*?(rustle_\w+)\(", (self.prefix / "include/rustle/rustle.h").read_text(), re.MULTILINE))
        symbols = run("nm", "-D", "--defined-only", self.prefix / LIBRARIES / "librustle_client_c.so")
        shown = {line.split()[-1].split("@")[0] for line in symbols.splitlines() if line.split()[1] != "A"}
        self.assertGreater(len(declared), 35)
        self.assertEqual(shown, declared)

    @unittest.skipIf(SANITIZE, "a sanitizer's library is not loaded late")
    def test_another_language_loads_the_c_library(self):
        """Beside a copy of the same messages, which the Python SDK has."""
        (self.folder / "foreign.py").write_text(textwrap.dedent("""
            import ctypes, sys, rustle
            class Error(ctypes.Structure):
                _fields_ = [("status", ctypes.c_int32), ("code", ctypes.c_int32), *((name, ctypes.c_char_p) for name in ("code_name", "field", "message", "remedy"))]
            library = ctypes.CDLL(sys.argv[1])
            library.rustle_last_error.restype = ctypes.POINTER(Error)
            status = library.rustle_check(None)
            error = library.rustle_last_error().contents
            print(status, error.status, error.code_name.decode(), error.field.decode(), error.remedy.decode())
            """))
        environment = {**os.environ, "PYTHONPATH": str(self.prefix / "lib/python3/dist-packages")}
        said = run(sys.executable, self.folder / "foreign.py", self.prefix / LIBRARIES / "librustle_client_c.so", env=environment)
        self.assertEqual(said, "-1 -1 invalid connection Give a pointer to something.\n")

    @unittest.skipUnless(shutil.which(MINGW), "Debian's gcc-mingw-w64-x86-64 is not installed")
    def test_the_c_client_is_built_for_windows_against_a_stub(self):
        """A library of the header's functions that do nothing: Debian has neither ZeroMQ nor protobuf for mingw."""
        header = self.prefix / "include/rustle/rustle.h"
        names = re.findall(r"^RUSTLE_API [^;(]*?(rustle_\w+)\(", header.read_text(), re.MULTILINE)
        stub = self.folder / "rustle_client_c.def"
        stub.write_text("LIBRARY rustle_client_c.dll\nEXPORTS\n" + "".join(f"  {name}\n" for name in names))
        run(MINGW.replace("gcc", "dlltool"), "-d", stub, "-l", self.folder / "librustle_client_c.dll.a")
        run(MINGW, *C99, f"-I{header.parent}", MINIMAL, "-o", self.folder / "minimal.exe", f"-L{self.folder}", "-lrustle_client_c")
        self.assertTrue((self.folder / "minimal.exe").exists())

    def test_another_version_is_not_taken(self):
        (self.folder / "CMakeLists.txt").write_text("cmake_minimum_required(VERSION 3.25)\nproject(p LANGUAGES CXX)\nfind_package(rustle 9 REQUIRED)\n")
        done = subprocess.run(["cmake", "-S", self.folder, "-B", self.folder / "build", f"-DCMAKE_PREFIX_PATH={self.prefix}"],
                              capture_output=True, text=True, timeout=120)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("version: 0.", done.stderr)


if __name__ == "__main__":
    main()
