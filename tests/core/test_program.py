"""The core's own tests (core/test): properties of bodies, and one hash of a run on every kernel and platform."""

import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from filelock import FileLock

CORE = Path(__file__).parents[2] / "core"
NAMES = re.findall(r'(?:begins\(|\{)"([a-z_]+)", ', (CORE / "test" / "test.c").read_text("utf-8"))
WASI = """
import {readFileSync} from 'node:fs'; import {WASI} from 'node:wasi';
const wasi = new WASI({version: 'preview1', args: ['test', 'every_kernel']});
const {instance} = await WebAssembly.instantiate(readFileSync(process.argv[1]), wasi.getImportObject());
process.exitCode = wasi.start(instance);
"""


@pytest.fixture(scope="module")
def program(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The compiled tests, kept between runs: `make` compiles them again if a source has changed."""
    kept = getattr(request.config, "cache", None)  # none with `-p no:cacheprovider`
    build = tmp_path_factory.mktemp("core") if kept is None else kept.mkdir("core")
    with FileLock(build / "lock"):  # of runs at the same time
        subprocess.run(["make", "-s", "-C", CORE, build / "test", f"BUILD={build}"], check=True)
    return build / "test"


@pytest.mark.parametrize("name", NAMES)
def test_the_core(program: Path, name: str) -> None:
    done = subprocess.run([program, name], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and name in done.stdout, done.stdout + done.stderr


def test_a_filter_without_tests_fails(program: Path) -> None:
    assert subprocess.run([program, "nothing"], capture_output=True, check=False).returncode == 1


@pytest.mark.slow
@pytest.mark.skipif(find_spec("ziglang") is None or not shutil.which("node"), reason="needs ziglang and node")
def test_the_golden_run_in_webassembly(tmp_path: Path) -> None:
    flags = ["--target=wasm32-wasi", "-msimd128", "-std=c11", "-O2", "-ffp-contract=off", "-fno-math-errno"]
    sources = [*sorted((CORE / "src").glob("*/*.c")), CORE / "test" / "test.c"]
    module = tmp_path / "test.wasm"
    subprocess.run([sys.executable, "-m", "ziglang", "cc", *flags, *sources, "-o", module, "-lm"], check=True)
    node = ["node", "--no-warnings", "--input-type=module", "-e", WASI, module]
    done = subprocess.run(node, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "kernel simd128, 0 failures" in done.stdout, done.stdout + done.stderr
