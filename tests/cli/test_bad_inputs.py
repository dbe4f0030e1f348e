"""A table of wrong arguments: each is refused in one line that names it, with status 2, no traceback, and no file."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh

from ..conftest import Refused

# The command, and what its line says. FOLDER has motion.bvh, text.txt, deep.json, nose.json, a folder and a site.
BAD = {
    # commands
    "": "give one of bench, calibrate",
    "dance": "dance: unknown command; see bodysense --help",
    "tack motion.bvh": "tack: unknown command; did you mean track?",
    "data": "data: give one of info, joints",
    "data inf motion.bvh": "inf: unknown command; did you mean info?",
    "evaluate": "evaluate: give one of amass-p1, completion",
    "bench stp": "stp: unknown command; did you mean step?",
    "track": "PATH and --out are missing; see bodysense track --help",
    "track motion.bvh": "--out is missing; see bodysense track --help",
    "convert motion.bvh": "--out is missing",
    "simulate -o out.npz": "PATH is missing",
    "evaluate completion": "--data is missing; see bodysense evaluate completion --help",
    "--tyro-print-completion tcsh": "--tyro-print-completion tcsh: completion is for bash and zsh",
    # options
    "track motion.bvh -o out.bvh --heigth 1.7": "--heigth: unknown option; did you mean --height?",
    "track motion.bvh -o out.bvh --divice head": "--divice: unknown option; did you mean --device?",
    "track motion.bvh -o out.bvh extra.bvh": "extra.bvh: unknown argument; see bodysense track --help",
    "track motion.bvh -o out.bvh text.txt": "-o out.bvh: 2 files are written to a folder; give its name",
    "simulate motion.bvh -o out.npz extra.bvh": "extra.bvh: unknown argument; see bodysense simulate --help",
    "track motion.bvh -o out.bvh --jobs 2": "motion.bvh: one file; --jobs: for several files or a folder, leave it out",
    "track motion.bvh extra.bvh -o out --jobs 0": "--jobs 0: give a whole number, 1 to 1024",
    "track motion.bvh text.txt -o out --save-person me.json": "--save-person me.json: for one file",
    "track motion.bvh -o out.bvh --no-noise yes": "yes: unknown argument",
    "track motion.bvh -o out.bvh --height": "--height: the value is missing; give a number in metres, such as 1.75",
    "track motion.bvh -o": "--out: the value is missing; give a file or folder",
    "serve --prot 80": "--prot: unknown option; did you mean --port?",
    # values of options
    "track motion.bvh -o out.bvh --height 1,75": "--height 1,75: give a number in metres, such as 1.75",
    "track motion.bvh -o out.bvh --height=tall": "--height tall: give a number in metres, such as 1.75",
    "track motion.bvh -o out.bvh --height 175": "--height 175: people are 1 to 2.3 m high",
    "papers generate -o out.bvh --height 3": "--height 3: people are 1 to 2.3 m high",
    "track motion.bvh -o out.bvh --device kinect": "--device kinect: give one of dip_six, four_point, gloves",
    "track motion.bvh -o out.bvh --device None": "--device None: give one of dip_six, four_point, gloves, gloves_imu",
    "track motion.bvh -o out.bvh --up w": "--up w: give one of -x, -y, -z, x, y, z",
    "track motion.bvh -o out.bvh --seed 1.5": "--seed 1.5: give a whole number",
    "track motion.bvh -o out.bvh --floor low": "--floor low: give a number in metres",
    "track motion.bvh -o out.bvh --floor nan": "floor nan m; give the floor's height in metres",
    "track motion.bvh -o out.bvh --device headset_camera --floor 5": "m below the floor",
    "track motion.bvh -o out.bvh --device head --person me.json --height 1.7": (
        "holds the wearer's height; leave one of both out"
    ),
    "track motion.bvh -o out.bvh --device head --model missing.safetensors": "no such model file",
    "track motion.bvh -o out.bvh --unit cubit": "--unit cubit: give m, cm",
    "track motion.bvh -o out.bvh --unit nan": "--unit nan: give m, cm",
    "track motion.bvh -o out.bvh --figure 0": "--figure 0: bodies are counted from 1",
    "track motion.bvh -o out.bvh --figure 9": "figure",
    "track motion.bvh -o out.bvh --rig lego": "lego",
    "track motion.bvh -o out.bvh --missing tail": "no such joint",
    "track motion.bvh -o out.bvh --missing head:9-3": "head:9-3",
    "track motion.bvh -o out.bvh --missing=": "missing '': an item is empty",
    "track motion.bvh -o out.bvh --device=": '--device "": give one of dip_six, four_point, gloves',
    "conform motion.bvh --floor nan": "--floor nan: give the floor's height in metres",
    "conform motion.bvh --watch vmc": "motion.bvh: --watch is for a server",
    "calibrate http://127.0.0.1:1/ --wait 0": "http://127.0.0.1:1/: Connection refused; is `bodysense serve` running?",
    "serve --port 0 --up z --height 1.7": "--up is for a replayed motion; give it with --replay",
    "serve --port 0 --host 999.1.1.1": "--host 999.1.1.1: no such host",
    "serve --port 0 --slimevr --slimevr-host 192.0.2.1": "--slimevr-host 192.0.2.1: no address of this machine",
    "serve --port 0 --vmc-in 0 --device-names nose.json": "nose.json: 'nose' (for 'LHR-1') is not a device",
    "track motion.bvh -o out.bvh --missing head:5-9999": "9999",
    "track motion.bvh -o out.bvh --joints text.txt": "text.txt",
    "track motion.bvh -o out.bvh --joints missing.json": "missing.json",
    "track motion.bvh -o out.bvh --seconds 2": "motion.bvh: not a video; --seconds: for videos, leave it out",
    "convert motion.bvh -o out.bvh --rate nan": "--rate nan: give frames a second, such as 30",
    "convert motion.bvh -o out.bvh --rate fast": "--rate fast: give a number",
    "simulate motion.bvh -o out.npz --marker-set mine": "--marker-set mine: for --device gloves",
    "serve --port 0 --origin localhost:5173": "--origin localhost:5173: an origin has a scheme, a host and no path",
    "serve --port 0 --origin http://localhost:5173/": "--origin http://localhost:5173/: an origin has a scheme",
    "serve --port 0 --token short": "--token: give at least 8 characters",
    "serve --port 0 --token secret/99+==x": "--token: give at least 8 characters of A-Z, a-z, 0-9 and -._~",
    "serve --port 0 --vmt-hands": "--vmt-hands: for --vmt; give that, too",
    "serve --port 0 --solarxr-port 9000": "--solarxr-port: for --solarxr",
    "serve --port 0 --vrchat-trackers hip": "--vrchat-trackers: for --vrchat or --vrchat-out",
    "serve --port 0 --smpl-model missing.npz": "--smpl-model missing.npz: no such file",
    "serve --port 0 --smpl-model bytes.npz": "--smpl-model is for a replayed motion; give it with --replay",
    "serve --port x": "--port x: give a whole number",
    "serve --port 70000": "--port 70000: give a whole number, 0 to 65535",
    "serve --port 0 --sessions 0": "--sessions 0: give a whole number, 1 to 10000",
    "serve --port 0 --smoothing nan": "--smoothing nan: give seconds, 0 to 0.5",
    "serve --port 0 --floor nan": "floor nan m",
    "serve --port 0 --vmc-out here": "--vmc-out here: give HOST:PORT",
    "serve --port 0 --vrchat-trackers tail": "'tail' is not a tracker of VRChat; give a list of hip",
    "calibrate --wait nan": "--wait nan: give 0 to 600 seconds",
    "calibrate --watch kinect": "--watch kinect: give one of slimevr, solarxr, vmc, vmt, vrchat",
    "convert motion.bvh -o out.bvh --rate 1e-9": "--rate 1e-09: give frames a second, 0.1 to 10000",
    "simulate motion.bvh -o out.bvh": "out.bvh: signals of headset_camera are written as .npz, .jsonl; give a name",
    "simulate missing.bvh -o out.npz --device gloves --marker-set mine": "mine: no marker set",
    "data info motion.bvh --picture out.txt": "out.txt: a picture is a PNG; give a name that ends in .png",
    "data prepare folder -o out.zarr --smpl-model missing.npz": "--smpl-model missing.npz: no such file",
    "track motion.bvh -o out.bvh --smpl-model missing.npz": "--smpl-model missing.npz: no such file",
    "track motion.bvh -o out.bvh --smpl-model bytes.npz": "--smpl-model is for AMASS and SMPL files",
    "evaluate completion --data folder --model text.txt": "text.txt",
    "evaluate completion --data folder --sheet out.jpg": "out.jpg: a picture is written as .png",
    "train completion --data missing -o out.safetensors": "--data missing: no such folder",
    "train arms --data missing -o out.onnx": "--data missing: no such folder",
    "train hmd-vae --data folder -o out.pt --split-file missing.txt": "--split-file missing.txt: no such file",
    # inputs
    "track missing.bvh -o out.bvh": "missing.bvh: no such file",
    "track folder -o out.bvh": "folder",
    "track text.txt -o out.bvh": "text.txt",
    "track bytes.c3d -o out.bvh": "bytes.c3d",
    "track bytes.trc -o out.bvh": "bytes.trc",
    "track bytes.csv -o out.bvh": "bytes.csv",
    "track bytes.jsonl -o out.bvh": "bytes.jsonl",
    "convert bytes.npy -o out.bvh": "bytes.npy",
    "data info missing": "missing: no such folder",
    "data info bytes.bvh": "bytes.bvh",
    "data joints text.txt": "text.txt",
    "track motion.bvh -o out.bvh --device head --person missing.json": "missing.json",
    "track motion.bvh -o out.bvh --device head --person deep.json": "deep.json is not JSON",
    "track motion.bvh -o out.bvh --device head --person text.txt": "text.txt is not JSON",
    "track motion.bvh -o out.bvh --device head --person folder": "folder cannot be read",
    "serve --port 0 --person missing.json": "missing.json",
    "serve --port 0 --device-names text.txt --vmt": "text.txt is not JSON",
    "serve --port 0 --certificate text.txt --key text.txt": "text.txt",
    "serve --port 0 --replay text.txt": "--replay text.txt",
    # weights, before the motion is completed
    "track motion.bvh -o out.bvh --device head --model text.txt": "text.txt",
    "track motion.bvh -o out.bvh --device head --model folder": "folder",
    "papers fingers motion.bvh -o out.bvh --network bytes.npz": "bytes.npz",
    "papers sample motion.bvh -o out.bvh --device three_point --network text.txt": "text.txt",
    "papers generate -o out.bvh --network text.txt": "text.txt",
    # outputs, before any work
    "track motion.bvh -o /proc/out.bvh": "/proc/out.bvh cannot be written",
    "convert motion.bvh -o /proc/out.glb": "/proc/out.glb cannot be written",
    "simulate motion.bvh -o /proc/out.npz": "/proc/out.npz cannot be written",
    "papers generate -o /proc/out.png": "/proc/out.png cannot be written",
    "demo motion.bvh -o /proc": "/proc/demo.png cannot be written",
    "demo motion.bvh -o /proc/demo": "/proc/demo: no folder can be made there",
    "demo motion.bvh -o text.txt": "text.txt",
    "track motion.bvh -o out.bvh --json /proc/a.json": "/proc/a.json cannot be written",
    "track motion.bvh -o out.bvh --save-person no/me.json": "the folder no does not exist",
    "track motion.bvh -o out": "out: the output has no ending; give a name that ends in .bvh",
    "track https://example.org/motion.bvh -o out.bvh": "https://example.org/motion.bvh: an address, and",
    "track motion.bvh --unit mm -o out.bvh": "people are 1 to 2.3 m; leave --unit mm out, or give another",
    "track motion.bvh -o out.xyz": "ends in '.xyz'; give a name that ends in .bvh",
    "track motion.bvh -o motion.bvh": "both read and written",
    "convert motion.bvh -o folder": "folder",
    "convert folder -o out": "folder: a folder without files that are read (.bvh, ",
    "track folder -o out": "folder: a folder without files that are read (.bvh, ",
    "track motion.bvh -o out.bvh --json out.bvh": "out.bvh: written by -o and by --json; give each a name of its own",
    "track motion.bvh --out=out.bvh --json ./out.bvh --overwrite": "./out.bvh: written by --out and by --json",
    "conform motion.bvh --html out.html --json out.html": "out.html: written by --html and by --json",
    "page -o site": "--out site: its index.html is another page's; give another folder",
    "convert motion.bvh -o out.bvh --json folder": "folder is a folder",
    "serve --port 0 --allow-record /proc": "--allow-record /proc: nothing can be written there",
    "serve --port 0 --shared text.txt": "--shared text.txt: give the address of a Valkey or Redis",
    "serve --port 0 --save-person /proc/me.json": "/proc/me.json cannot be written",
    "page /proc/page": "--out is missing, and /proc/page is unknown; see bodysense page --help",
    "page --out /proc/page": "/proc/page",
}
# Values outside a range, and the options that have it: the first is given all values, each other one the first value.
_TRACK, _SERVE = "track motion.bvh -o out.bvh", "serve --port 0"
OUTSIDE = {
    ("0", "-1", "1.5", "1e9", "99999999999", "many"): (
        "papers sample motion.bvh -o out.bvh --device three_point --count",
        "papers generate -o out.bvh --count",
        f"{_SERVE} --sessions",
        f"{_SERVE} --workers",
        "data prepare folder --out out.zarr --workers",
        "evaluate completion --data out.zarr --limit",
        "evaluate completion --data out.zarr --jobs",
        "train completion --data out.zarr --out out.safetensors --limit",
        "train completion --data out.zarr --out out.safetensors --threads",
        "bench live --sessions",
        "bench live --workers",
        "bench step --frames",
    ),
    ("-1", "4294967296", "1.5", "any"): (
        f"{_TRACK} --device head --noise --seed",
        "simulate motion.bvh -o out.npz --noise --seed",
        "papers generate -o out.bvh --seed",
    ),
    ("0", "-30", "nan", "inf", "1e9", "1e-9", "fast"): (
        "convert motion.bvh -o out.bvh --rate",
        "convert motion.bvh -o out.bvh --file-rate",
        "data prepare folder --out out.zarr --rate",
        "simulate motion.bvh -o out.npz --rate",
    ),
    ("0", "-1.7", "0.99", "2.31", "175", "nan", "inf", "1,75"): (
        f"{_TRACK} --height",
        "convert motion.bvh -o out.bvh --height",
        "demo motion.bvh -o demo --height",
        f"{_SERVE} --height",
    ),
    ("-1", "65536", "1e4", "http"): (
        "serve --port",
        f"{_SERVE} --vmc-in",
        f"{_SERVE} --markers-in",
        f"{_SERVE} --solarxr --solarxr-port",
    ),
}
BAD |= {
    f"{command} {value}": f"{command.split()[-1]} "
    for values, commands in OUTSIDE.items()
    for k, command in enumerate(commands)
    for value in (values[:1] if k else values)
}
# Files of other things, by every command that reads them: the line names the file.
_READERS = ("track {} -o out.bvh", "convert {} -o out.glb", "simulate {} -o out.npz", "data joints {}")
_DAMAGED = ("bvh", "npz", "glb", "vrma")
BAD |= {read.format(f"bytes.{end}"): f"bytes.{end}" for read in _READERS for end in _DAMAGED}
NEEDS_LAB = ("evaluate", "bench", "train")
NEEDS_LIVE = ("serve", "calibrate", "page")
NEEDS_CONFORM = ("conform",)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory, short_clip: Clip) -> Path:
    """A folder of files that all commands share: commands that are refused change none."""
    folder = tmp_path_factory.mktemp("inputs")
    write_bvh(folder / "motion.bvh", short_clip)
    (folder / "text.txt").write_text("hello")
    (folder / "deep.json").write_text("[" * 100_000)
    (folder / "folder").mkdir()
    (folder / "site").mkdir()
    (folder / "site" / "index.html").write_text("hello")
    (folder / "nose.json").write_text('{"LHR-1": "nose"}')
    for ending in ("bvh", "npz", "npy", "glb", "vrma", "c3d", "trc", "csv", "jsonl"):
        (folder / f"bytes.{ending}").write_bytes(bytes(range(256)) * 8)
    return folder


@pytest.fixture
def folder(inputs: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(inputs)
    return inputs


def files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


FIRST = sorted({command.partition(" ")[0] for command in BAD})


@pytest.mark.parametrize("first", FIRST)
def test_bad_inputs_give_one_line_and_no_file(folder: Path, refused: Refused, first: str) -> None:
    if first in (*NEEDS_LAB, "", "dance", "tack", "data"):
        pytest.importorskip("bodysense_lab", reason="needs packages/lab")
    if first in (*NEEDS_LIVE, "", "dance", "tack"):
        pytest.importorskip("uvicorn", reason="needs packages/live")
    if first in NEEDS_CONFORM:
        pytest.importorskip("bodysense_conform", reason="needs packages/conform")
    commands = [command for command in BAD if command.partition(" ")[0] == first]
    if sys.platform != "linux":  # no user can write to /proc
        commands = [command for command in commands if "/proc" not in command]
    before = files(folder)
    for command in commands:
        line = refused(*command.split())
        assert BAD[command] in line, command
        assert "Traceback" not in line and "Errno" not in line, command
        assert files(folder) == before, command


EMPTY = {
    "demo -o": "--out",
    "page --out": "--out",
    "serve --port 0 --allow-record": "--allow-record",
    "convert motion.bvh -o": "--out",
    "data info": "PATH",
}


@pytest.mark.parametrize("command", EMPTY)
def test_an_empty_path_is_not_the_current_folder(folder: Path, refused: Refused, command: str) -> None:
    if command.split(maxsplit=1)[0] in NEEDS_LIVE:
        pytest.importorskip("uvicorn", reason="needs packages/live")
    before = files(folder)
    assert f'{EMPTY[command]} "": give a file or folder' in refused(*command.split(), "")
    assert files(folder) == before


def test_motion_is_described_and_a_missing_folder_refused_without_pytorch(folder: Path) -> None:
    """PyTorch takes 0.2 GB and seconds."""
    pytest.importorskip("bodysense_lab", reason="needs packages/lab")
    trainings = ("train completion -o out.safetensors --data missing", "train arms -o a.onnx --data missing")
    script = "import sys; from bodysense.cli import main\n"
    script += "print(*(main(command.split()) for command in sys.argv[1:]), 'torch' in sys.modules)"
    run = [sys.executable, "-c", script, "data info motion.bvh", *trainings]
    done = subprocess.run(run, capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout.splitlines()[-1:] == ["0 2 2 False"], done.stdout + done.stderr
    assert done.stderr.count("--data missing: no such folder") == 2


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_gives_one_line(folder: Path) -> None:
    """Also where the output stream itself is full."""
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "bodysense", "data", "joints", "motion.bvh"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=120,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr.splitlines()[:1] == [
        "bodysense: the disk is full; free some space and run the same command again"
    ]


def test_quiet_prints_nothing_but_warnings_and_errors(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Refused
) -> None:
    from bodysense.cli import main
    from bodysense.cli.quiet import quietly

    out = tmp_path / "out.json"
    assert main(["convert", "motion.bvh", "-o", str(tmp_path / "out.glb"), "--quiet", "--json", str(out)]) == 0
    captured = capsys.readouterr()
    assert (
        captured.out == ""
        and captured.err.startswith("WARNING: limbs are held still")
        and captured.err.count("\n") == 1
    )
    assert '"frames": 20' in out.read_text()
    with quietly(True):
        print("wrote a file")
        print("WARNING: the arms are guessed")
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err == "WARNING: the arms are guessed\n"
    assert "missing.bvh" in refused("track", "missing.bvh", "-o", "b.bvh", "--quiet")
