#!/usr/bin/env python3
"""The wheel of the Python package: made in isolation, it holds what it needs and no more, and works in an empty environment.

    wheel_test.py BUILD_FOLDER [unittest arguments]

Compiles the engine (minutes) in BUILD_FOLDER. Ends with 77 where pip cannot get what the wheel is made with.
"""

import base64
import email
import hashlib
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import venv
import zipfile

HOME = pathlib.Path(__file__).resolve().parents[4]
PACKAGE = HOME / "sim_workers" / "python" / "comrad"
MAY_HOLD = (  # and nothing else
    r"comrad/\w+\.pyi?",
    r"comrad/py\.typed",
    r"comrad/_engine\.abi3\.so",
    r"comrad/data/scenarios/[\w/]+\.(toml|acs|decorate|wad|cfg)",
    r"comrad/licenses/[\w+.-]+\.txt",
    r"comrad-[\d.]+\.data/scripts/comrad",
    r"comrad-[\d.]+\.dist-info/(METADATA|RECORD|WHEEL|licenses/LICENSE)",
)
MOST_BYTES = 15_000_000
OF_GLIBC = r"(libc|libm|libgcc_s|ld-linux-x86-64)\.so\.\d+"
PLAYS = """
import sys
import comrad
env = comrad.parallel_env("stag_hunt_arena", observations=("labels",))
env.reset(seed=1)
env.step({agent: env.action_space(agent).sample() for agent in env.agents})
env.close()
env = comrad.gym_env("mine", folder=sys.argv[1], size=(64, 48))
env.reset(seed=1)
env.close()
assert len(comrad.scenarios()) == 13, comrad.scenarios()
try:
    comrad.load_policy("nowhere")
    raise SystemExit("torch is in this environment")
except ImportError as error:
    assert "pip install torch" in str(error), error
with open("/proc/self/maps", encoding="utf-8") as file:
    loaded = file.read()
for name in ("torch", "ddsc", "c10", "OSMesa", "GL.so", "EGL"):
    assert f"lib{name}" not in loaded, name
print(comrad.__file__)
"""


def clean_environment():
    return {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "COMRAD_HOME", "COMRAD_VIZDOOM_PATH")}


def run(*command, timeout=1800, **options):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=timeout, env=clean_environment(), **options)


def skip(reason):
    print(f"[  SKIPPED ] 1 test, wheel of the Python package: {reason}")
    sys.exit(77)


def make_wheel(build, out):
    """The wheel, by `pip wheel` with pip's own isolated environment."""
    venv.create(out / "maker", with_pip=True)
    python = out / "maker" / "bin" / "python"
    got = run(python, "-m", "pip", "download", "--no-deps", "--dest", out / "got", "scikit-build-core>=0.10", timeout=120)
    if got.returncode != 0:
        skip(f"pip cannot get scikit-build-core: {(got.stderr or got.stdout).strip().splitlines()[-1]}")
    done = run(python, "-m", "pip", "wheel", "--no-deps", f"--config-settings=build-dir={build}", "--wheel-dir", out / "wheels", HOME)
    if done.returncode != 0:
        raise AssertionError((done.stdout + done.stderr)[-4000:])
    wheels = list((out / "wheels").iterdir())
    assert len(wheels) == 1, wheels
    return wheels[0]


class Wheel(unittest.TestCase):
    build: pathlib.Path

    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory(prefix="comrad_wheel_")
        cls.folder = pathlib.Path(cls.scratch.name)
        cls.wheel = make_wheel(cls.build, cls.folder)
        cls.archive = zipfile.ZipFile(cls.wheel)
        cls.names = [name for name in cls.archive.namelist() if not name.endswith("/")]

    @classmethod
    def tearDownClass(cls):
        cls.archive.close()
        cls.scratch.cleanup()

    def read(self, name):
        """A file of the .dist-info folder."""
        return self.archive.read(next(one for one in self.names if one.endswith(f".dist-info/{name}")))

    def test_it_holds_what_it_needs_and_no_more(self):
        self.assertEqual([name for name in self.names if not any(re.fullmatch(one, name) for one in MAY_HOLD)], [])
        wanted = {f"comrad/{file.name}" for file in PACKAGE.iterdir() if file.suffix in (".py", ".pyi") or file.name == "py.typed"}
        wanted |= {f"comrad/data/{file.relative_to(HOME)}" for file in HOME.glob("scenarios/*/scenario.toml")}
        wanted.add("comrad/report_lines.py")
        wanted |= {f"comrad/licenses/{name}.txt" for name in ("libpng", "zlib1g", "libspdlog", "libfmt", "libtomlplusplus", "nlohmann-json3", "libstdc++-12", "nanobind")
                   if name == "nanobind" or pathlib.Path(f"/usr/share/doc/{name}-dev/copyright").is_file()}
        self.assertGreater(len(wanted), 20)
        self.assertLessEqual(wanted, set(self.names))
        self.assertLess(sum(one.file_size for one in self.archive.infolist()), MOST_BYTES)

    def test_its_record_is_true(self):
        for line in self.read("RECORD").decode().splitlines():
            name, digest, _ = line.rsplit(",", 2)
            if digest:
                found = base64.urlsafe_b64encode(hashlib.sha256(self.archive.read(name)).digest()).rstrip(b"=").decode()
                self.assertEqual(digest, f"sha256={found}", name)

    def test_its_metadata_can_be_published(self):
        about = email.message_from_bytes(self.read("METADATA"))
        version = re.search(r"project\(comrad VERSION ([\d.]+)", (HOME / "CMakeLists.txt").read_text(encoding="utf-8"))[1]
        self.assertEqual((about["Name"], about["Version"], about["Requires-Python"]), ("comrad", version, ">=3.11"))
        self.assertEqual(about["Description-Content-Type"], "text/markdown")
        self.assertIn("# The Python package", about.get_payload())
        self.assertIn("MIT", self.read("licenses/LICENSE").decode())
        self.assertIn("numpy>=1.24", about.get_all("Requires-Dist"))
        self.assertIn("Root-Is-Purelib: false", self.read("WHEEL").decode())
        python = self.folder / "maker" / "bin" / "python"
        if run(python, "-m", "pip", "install", "twine", timeout=300).returncode == 0:
            checked = run(python, "-m", "twine", "check", "--strict", self.wheel)
            self.assertEqual(checked.returncode, 0, checked.stdout + checked.stderr)

    def test_it_wants_no_library_beyond_glibc(self):
        engine = self.archive.extract(next(name for name in self.names if "/_engine." in name and name.endswith(".so")), self.folder)
        wanted = re.findall(r"NEEDED\s+(\S+)", run("objdump", "-p", engine).stdout)
        self.assertIn("libc.so.6", wanted)
        self.assertEqual([name for name in wanted if not re.fullmatch(OF_GLIBC, name)], [])
        self.assertEqual(self.wheel.name.split("-")[2:4], ["cp311", "abi3"])

    def test_it_is_not_compiled_elsewhere_without_being_asked(self):
        musl = self.folder / "musl"
        musl.mkdir()
        (musl / "features.h").touch()
        for machine, words in (
            (["-DCMAKE_SYSTEM_NAME=Linux", "-DCMAKE_SYSTEM_PROCESSOR=aarch64"], "this is aarch64 with glibc; use such a machine"),
            ([f"-DCMAKE_C_FLAGS=-I{musl}"], "this is x86_64 with another C library; use such a machine"),
        ):
            done = run("cmake", "-S", HOME, "-B", self.folder / words.split()[2], "-DSKBUILD=2", *machine)
            self.assertEqual(done.returncode, 1, done.stderr)
            line = [one for one in done.stderr.splitlines() if words in one]
            self.assertRegex(line[0], "COMRAD_UNTESTED_MACHINE=ON$")

    def test_it_works_where_nothing_else_is(self):
        venv.create(self.folder / "empty", with_pip=True)
        python = self.folder / "empty" / "bin" / "python"
        installed = run(python, "-m", "pip", "install", self.wheel, timeout=600)
        self.assertEqual(installed.returncode, 0, installed.stderr[-2000:])
        (self.folder / "mine.cfg").write_text("available_buttons = { ATTACK }\n", encoding="utf-8")
        played = run(python, "-c", PLAYS, self.folder, cwd=self.folder)
        self.assertEqual(played.returncode, 0, played.stderr[-2000:])
        package = pathlib.Path(played.stdout.strip()).parent
        self.assertTrue(package.is_relative_to(self.folder / "empty"))
        for command in ([python.with_name("comrad")], [python, "-m", "comrad"]):
            trainer = run(*command, "train")
            self.assertEqual((trainer.returncode, len(trainer.stderr.splitlines())), (1, 1), trainer.stderr)
            self.assertIn("apt-get install ./comrad_*_amd64.deb", trainer.stderr)

        bare = self.folder / "bare" / "comrad"
        shutil.copytree(package, bare)
        engine = next(bare.glob("_engine*.so"))
        engine.write_bytes(engine.read_bytes().replace(b"libm.so.6", b"libm.so.X"))
        self.assertRegex(run(python, "-c", "import comrad", cwd=bare.parent).stderr, r"ImportError: comrad's engine needs libm\.so\.X, which this machine lacks")
        engine.unlink()
        self.assertRegex(run(python, "-c", "import comrad", cwd=bare.parent).stderr, "not compiled for this Python; run `pip install .`")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    Wheel.build = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main()
