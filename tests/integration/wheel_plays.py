"""What an installed `comrad` must do where nothing but Python, pip and its wheels is: wheel_test.sh starts it in a separate root.

    python3 wheel_plays.py
"""

import contextlib
import io
import os
import pathlib
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import unittest

import comrad
import numpy as np
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test

PACKAGE = pathlib.Path(comrad.__file__).parent
FASTEST_OF = 10
FIRST_FRAME = """
import time
import comrad
begin = time.process_time()
env = comrad.parallel_env("stag_hunt_arena")
env.reset(seed=1)
print(time.process_time() - begin)
"""


def run(script, **environment):
    """A separate Python; its last line, whether it ended well or badly."""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, env={**os.environ, **environment})
    lines = (done.stdout + done.stderr).strip().splitlines()
    return lines[-1] if lines else ""


class Wheel(unittest.TestCase):
    def test_it_is_installed_and_needs_only_glibc(self):
        self.assertNotIn("site-packages/../", str(PACKAGE))
        self.assertEqual(len(comrad.scenarios()), 13)
        env = comrad.parallel_env("lava_pit")
        env.reset(seed=1)
        env.close()
        mapped = set(re.findall(r"/(?:lib|usr)\S*\.so\S*", pathlib.Path("/proc/self/maps").read_text(encoding="utf-8")))
        for name in ("GL", "EGL", "OSMesa", "opencv", "png", "spdlog", "fmt", "tomlplusplus", "xxhash", "torch", "ddsc"):
            self.assertEqual([one for one in mapped if f"/lib{name}" in one], [])
        self.assertTrue(os.environ["COMRAD_IWAD"].endswith("comrad_freedoom/freedoom2.wad"))

    def test_pettingzoos_own_tests(self):
        with contextlib.redirect_stdout(io.StringIO()):
            for scenario in ("lava_pit", "coop_puzzle"):
                parallel_api_test(comrad.parallel_env(scenario), num_cycles=60)
                api_test(comrad.env(scenario), num_cycles=60)
                parallel_seed_test(lambda name=scenario: comrad.parallel_env(name), num_cycles=30)

    def test_an_episode_of_each_scenario(self):
        for scenario in comrad.scenarios():
            with self.subTest(scenario):
                env = comrad.parallel_env(scenario)
                env.reset(seed=1)
                rng = np.random.default_rng(1)
                steps, seen = 0, set()
                while env.agents:
                    observations, _, _, _, infos = env.step({agent: rng.integers(env.action_space(agent).nvec) for agent in env.agents})
                    seen.add(observations["agent_0"].tobytes()) if steps < 50 and "agent_0" in observations else None
                    steps += 1
                self.assertGreater(len(seen), 5, "pictures do not change")
                self.assertIn("score", infos["agent_0"])
                self.assertLessEqual(steps, comrad.describe(scenario)["limit_tics"] // 4 + 1)
                env.close()

    def test_it_is_imported_and_draws_quickly(self):
        times = {"import gymnasium, numpy, pettingzoo": [], "import comrad": []}
        frames = []
        for _ in range(FASTEST_OF):
            for script, of_script in times.items():
                before = resource.getrusage(resource.RUSAGE_CHILDREN)
                subprocess.run([sys.executable, "-c", script], check=True)
                after = resource.getrusage(resource.RUSAGE_CHILDREN)
                of_script.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
            frames.append(float(run(FIRST_FRAME)))
        needed, whole = (min(of_script) for of_script in times.values())
        print(f"least of {FASTEST_OF}, processor time with Python's start: import comrad {whole:.3f} s, of what it needs {needed:.3f} s; first frame {min(frames):.3f} s")
        self.assertLess(whole, 0.3)
        self.assertLess(min(frames), 0.2)

    def test_what_the_machine_lacks_is_one_line(self):
        reset = "import comrad; comrad.parallel_env('lava_pit').reset(seed=1); print('fine', flush=True)"
        self.assertRegex(run(reset, COMRAD_IWAD="/nowhere/freedoom2.wad"), r"^FileNotFoundError: no freedoom2\.wad found in .*pip install comrad-freedoom")
        self.assertEqual(run(reset, HOME="/proc/nowhere"), "fine")
        shows = "import comrad; comrad.parallel_env('lava_pit', render_mode='human').reset(seed=1)"
        self.assertRegex(run(shows), r'^RuntimeError: render_mode "human" needs a display \(.*\); use render_mode "rgb_array" here$')
        self.assertEqual(
            run(f"import comrad, os\nchild = os.fork()\nif child == 0:\n    {reset}\n    os._exit(0)\nassert os.waitpid(child, 0)[1] == 0"), "fine"
        )
        forked = "import comrad, os\nenv = comrad.parallel_env('lava_pit')\nenv.reset(seed=1)\nif os.fork() == 0:\n    env.reset()\nos.wait()"
        self.assertRegex(run(forked), r"^ValueError: .*make new ones after a fork")
        with tempfile.TemporaryDirectory() as folder:
            copy = pathlib.Path(folder) / "comrad"
            shutil.copytree(PACKAGE, copy)
            engine = next(copy.glob("_engine*.so"))
            newest = max(re.findall(rb"GLIBC_2\.(\d\d)\0", engine.read_bytes()), key=int)
            engine.write_bytes(engine.read_bytes().replace(b"GLIBC_2.%s\0" % newest, b"GLIBC_9.99\0"))
            self.assertRegex(run("import comrad", PYTHONPATH=folder), r"^ImportError: comrad's engine needs glibc 9\.\d+ or newer, this system has 2\.\d+; ")
            engine.unlink()
            self.assertRegex(run("import comrad", PYTHONPATH=folder), r"^ImportError: comrad's engine is not compiled for this Python; ")
        from comrad import missing

        failure = ImportError("/x/_engine.abi3.so: cannot open shared object file")
        for machine, words in ((("aarch64", "glibc", "2.36"), "x86-64 processors, this machine is aarch64"), (("x86_64", "", ""), "with glibc")):
            missing.what_this_machine_is = lambda machine=machine: machine
            self.assertIn(words, str(missing.explained(failure)))
        for platform in ("musllinux_1_2_x86_64", "manylinux_2_39_aarch64", "manylinux_2_17_x86_64"):
            done = subprocess.run(
                [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--no-index", "--find-links", "/wheels", "--only-binary", ":all:"]
                + ["--platform", platform, "--dest", tempfile.gettempdir(), "comrad"],
                capture_output=True, text=True, check=False,
            )  # fmt: skip
            self.assertRegex(done.stderr, "No matching distribution found for comrad", platform)


if __name__ == "__main__":
    unittest.main()
