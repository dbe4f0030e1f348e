"""A study: its key is blind and balanced, answers are refused if they do not match, votes are recovered, pages work."""

from __future__ import annotations

import functools
import html
import json
import math
import re
import shutil
import subprocess
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy import stats

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.pictures.camera import Lens
from bodysense_lab.study.analysis import (
    COMPARISONS,
    CONDITIONS,
    Condition,
    StudyKey,
    draw_key,
    preference,
    preferences,
    read_all_votes,
    read_key,
    read_votes,
    study_numbers,
    write_key,
    write_simulated_answers,
)
from bodysense_lab.study.scenes import SceneMotion, build_study, complete_clip, cut_scenes

NODE = shutil.which("node")
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PAGE = files("bodysense_lab.study").joinpath("page.html").read_text(encoding="utf-8")


def key_of(scenes: int, seed: int = 0) -> StudyKey:
    return draw_key([f"scene {k}" for k in range(scenes)], np.random.default_rng(seed))


def simulated(folder: Path, key: StudyKey, raters: int, seed: int = 0, **quality: float) -> np.ndarray:
    folder.mkdir()
    whole: dict[Condition, float] = {one: quality.get(one, 0.0) for one in CONDITIONS}
    write_simulated_answers(folder, key, raters, whole, np.random.default_rng(seed))
    return read_all_votes(sorted(folder.iterdir()), key)


def test_names_do_not_reveal_conditions(tmp_path: Path) -> None:
    key = key_of(60)
    assert len({clip for clips in key.scenes.values() for clip in clips}) == 180
    assert key_of(60) == key and key_of(60, seed=1).study != key.study
    places = Counter((place, one) for clips in key.scenes.values() for place, one in enumerate(clips.values()))
    assert len(places) == 9 and min(places.values()) > 8, "every condition has every position in the ring"
    write_key(tmp_path / "key.json", key)
    assert read_key(tmp_path / "key.json") == key


@pytest.mark.parametrize("seed", range(2))
def test_preferences_equal_those_of_scipy(seed: int) -> None:
    values = np.random.default_rng(seed).choice([-1.0, 0.0, 1.0], 12, p=[0.2, 0.3, 0.5])
    ours = preference(values)
    assert (ours.t, ours.p) == pytest.approx(stats.ttest_1samp(values, 0), rel=1e-12)
    assert (ours.mean, ours.n) == (values.mean(), 12) and ours.standard_error == pytest.approx(stats.sem(values))
    agree, nobody, one = preference(np.ones(9)), preference(np.zeros(9)), preference(np.array([-1.0]))
    assert (agree.mean, agree.standard_error, agree.t, agree.p) == (1, 0, math.inf, 0)
    assert (nobody.mean, nobody.p) == (0, 1) and math.isnan(nobody.t) and one.mean == -1 and math.isnan(one.p)


def test_simulated_preference_is_recovered(tmp_path: Path) -> None:
    key = key_of(4)
    cast = simulated(tmp_path / "a", key, 150, truth=0.7, ours=0.5)
    found = preferences(key, cast)
    for rows in found.values():
        for one, mean in zip(rows, (0.2, 0.5, 0.7), strict=True):
            assert abs(one.mean - mean) < 3.5 * one.standard_error
    np.testing.assert_array_equal(simulated(tmp_path / "b", key, 150, truth=0.7, ours=0.5), cast)
    assert (cast == 0).mean() == pytest.approx(0.2 * np.mean([0.8, 0.5, 0.3]), abs=0.03)
    # Over all scenes, as in the paper, a value is a rater's mean over scenes.
    assert found["(all)"][1].p == pytest.approx(stats.ttest_1samp(cast[:, :, 1].mean(axis=1), 0)[1])
    numbers = study_numbers(found)
    assert (numbers["raters"], numbers["scenes"]) == (150, 4)
    assert numbers["scene 2_ours_over_baseline_p"] == found["scene 2"][1].p
    everyone = study_numbers(preferences(key, simulated(tmp_path / "c", key, 3, truth=1.0)))
    assert everyone["truth_over_baseline_mean"] == 1 and "truth_over_baseline_t" not in everyone, "infinite"
    with pytest.raises(BodysenseError, match="quality of truth and baseline: mean votes"):
        simulated(tmp_path / "d", key, 1, truth=0.8, baseline=-0.5)


def other_scene(held: dict[str, Any]) -> None:
    first, last = held["answers"][0], held["answers"][-1]
    first["left"] = last["left"]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda held: held.update(study="elsewhere"), r"answers of study 'elsewhere', but the key is of '\w{12}'"),
        (lambda held: held["answers"][0].update(left="0123"), r"not answers of this study \(KeyError\('0123, "),
        (other_scene, "not answers of this study"),
        (lambda held: held["answers"].append(held["answers"][0]), "is answered twice"),
        (lambda held: held["answers"].pop(), "1 of 6 pairs are not answered; let the rater finish"),
        (lambda held: held["answers"][0].update(choice="both"), r"not answers of this study \(KeyError\('both'\)"),
        (lambda held: held.update(answers=3), "not answers of this study"),
        (lambda held: held.update(format="x"), "its format is not 'bodysense study answers 1'"),
    ],
)
def test_answers_that_do_not_match_the_key_are_refused(
    tmp_path: Path, spoil: Callable[[dict[str, Any]], None], message: str
) -> None:
    key = key_of(2)
    simulated(tmp_path / "a", key, 1)
    (path,) = (tmp_path / "a").iterdir()
    with pytest.raises(BodysenseError, match="rater 'simulated-001' has answered in another file, too"):
        read_all_votes([path, path], key)
    held = json.loads(path.read_text())
    spoil(held)
    path.write_text(json.dumps(held))
    with pytest.raises(BodysenseError, match=message):
        read_votes(path, key)


@pytest.mark.parametrize(
    "change", [{"scenes": {}}, {"scenes": {"s": {"a": "truth", "b": "truth", "c": "ours"}}}, {"scenes": 3}]
)
def test_other_files_are_refused_as_keys(tmp_path: Path, change: dict[str, Any]) -> None:
    write_key(tmp_path / "key.json", key_of(2))
    held = json.loads((tmp_path / "key.json").read_text())
    (tmp_path / "key.json").write_text(json.dumps(held | change))
    with pytest.raises(BodysenseError, match="not every scene has an animation each of truth, ours, baseline"):
        read_key(tmp_path / "key.json")


def test_conditions_are_truth_and_two_completions(waving_clip: Clip, small_network: Path) -> None:
    clip = replace(waving_clip, pose=waving_clip.pose[:60])
    motion = complete_clip(clip, small_network)
    position = {name: np.asarray(forward_kinematics(pose)[0]) for name, pose in motion.pose.items()}
    skeleton = clip.pose.skeleton
    np.testing.assert_array_equal(position["truth"], np.asarray(forward_kinematics(clip.pose)[0]))
    assert motion.error("truth") == 0 and min(motion.error("ours"), motion.error("baseline")) > 0
    for name in ("ours", "baseline"):
        bones = np.linalg.norm(position[name][:, 1:] - position[name][:, list(skeleton.parents[1:])], axis=-1)
        np.testing.assert_allclose(bones, np.tile(skeleton.bone_length[1:], (60, 1)), atol=1e-6)
        # All methods track the head equally, so that it does not reveal the method.
        head = skeleton.index("head")
        assert np.linalg.norm(position[name][:, head] - position["truth"][:, head], axis=-1).max() < 0.15
    scenes = cut_scenes(motion, 0.7)
    assert [(scene.name, len(scene.hidden)) for scene in scenes] == [(f"waving-{k}", 20) for k in (1, 2, 3)]
    joined = np.concatenate([scene.pose["ours"].rotation for scene in scenes])
    np.testing.assert_array_equal(joined, motion.pose["ours"].rotation)
    with pytest.raises(BodysenseError, match=r"waving-1: 0\.33 s cannot be judged"):
        cut_scenes(replace(scenes[0], hidden=scenes[0].hidden[:10]), 6.0)


@pytest.fixture
def scene(waving_clip: Clip) -> SceneMotion:
    """Return a scene whose conditions are pieces of one motion."""
    pose: dict[Condition, Pose] = {name: waving_clip.pose[8 * k : 8 * k + 8] for k, name in enumerate(CONDITIONS)}
    return SceneMotion("waving", pose, np.ones((8, 14), dtype=bool))


def test_served_files_do_not_reveal_the_key(tmp_path: Path, scene: SceneMotion) -> None:
    done: list[int] = []
    scenes, out = [scene, replace(scene, name="</script>")], tmp_path / "study"
    key = build_study(out, scenes, np.random.default_rng(0), 1, done.append, Lens(width=24, height=30))
    assert done == [1] * 6 and read_key(out / "key.json") == key and list(key.scenes) == ["waving", "</script>"]
    served = sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())
    clips = sorted(f"site/clips/{clip}.webp" for clips in key.scenes.values() for clip in clips)
    assert served == ["key.json", *clips, "site/index.html"]
    for name in clips:
        with Image.open(out / name) as image:
            assert image.size == (24, 30)
    page = (out / "site" / "index.html").read_text()
    (data,) = re.findall(r'<script id="study" type="application/json">(.*?)</script>', page)
    assert json.loads(data) == {"study": key.study, "scenes": [list(clips) for clips in key.scenes.values()]}
    assert not re.search(r"truth|baseline|waving|https?://|@import", page)
    with pytest.raises(BodysenseError, match="study exists; name a new folder, so that no study loses its"):
        build_study(out, scenes, np.random.default_rng(0), 1, done.append)


@pytest.mark.skipif(NODE is None, reason="node is not installed")
@pytest.mark.parametrize("scenes", [1, 2, 3, 8])
def test_every_pair_appears_once_and_sides_are_balanced(scenes: int) -> None:
    """As in the paper, each rater sees every technique equally often on the left and on the right."""
    key = key_of(scenes)
    functions = PAGE[PAGE.index("function shuffled") : PAGE.index("async function play")]
    given = json.dumps({"scenes": [list(clips) for clips in key.scenes.values()]})
    code = f"{functions}\nconst study = {given}; console.log(JSON.stringify(Array.from({{length: 9}}, drawPairs)))"
    assert NODE is not None
    orders = json.loads(subprocess.run([NODE, "-e", code], capture_output=True, check=True).stdout)
    condition = {clip: one for clips in key.scenes.values() for clip, one in clips.items()}
    for pairs in orders:
        assert len({key.comparison(*pair)[:2] for pair in pairs}) == len(pairs) == 3 * scenes
        for side in (0, 1):
            assert Counter(condition[pair[side]] for pair in pairs) == dict.fromkeys(CONDITIONS, scenes)
        ways = Counter((condition[left], condition[right]) for left, right in pairs)
        assert all(abs(ways[one, other] - ways[other, one]) == scenes % 2 for one, other in COMPARISONS)
    assert scenes == 1 or len({json.dumps(pairs) for pairs in orders}) > 4


DRIVER = """
(async () => {
  const find = (id) => document.getElementById(id);
  const press = (key) => document.dispatchEvent(new KeyboardEvent("keydown", { key }));
  const choice = () => document.querySelector("[data-choice]");
  const playing = async () => { while (choice().disabled) await new Promise((done) => setTimeout(done, 5)); };
  if (!find("welcome").hidden) { find("rater").value = "r1"; document.querySelector("#welcome button").click(); }
  const wanted = ["left", "none", "right"];
  while (find("end").hidden) {
    press("ArrowRight"); // before anything plays: must not count
    await playing();
    const k = parseInt(find("place").textContent.slice(5)) - 1;
    const before = sessionStorage.getItem("step");
    sessionStorage.setItem("step", `${k}`);
    if (k === 2 && before === "1") return location.reload();
    if (k === 3 && !sessionStorage.getItem("undone")) { sessionStorage.setItem("undone", "1"); press("u"); continue; }
    press({ left: "ArrowLeft", none: "ArrowDown", right: "ArrowRight" }[wanted[k % 3]]);
  }
  const result = document.createElement("pre");
  result.textContent = await (await fetch(find("save").href)).text();
  document.body.replaceChildren(result);
})();
"""


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_the_page_works_in_a_browser(tmp_path: Path, scene: SceneMotion) -> None:
    """Answers by keys, with a reload and a withdrawn answer; answers that are too early do not count."""
    scenes = [scene, replace(scene, name="other")]
    key = build_study(tmp_path / "s", scenes, np.random.default_rng(0), 1, lambda _: None, Lens(width=24, height=30))
    page = tmp_path / "s" / "site" / "index.html"
    page.write_text(page.read_text().replace("</html>", f"<script>{DRIVER}</script></html>"))
    with served(page.parent) as address:
        assert BROWSER is not None
        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=20000", "--dump-dom"]
        command = [BROWSER, *flags, f"--user-data-dir={tmp_path / 'profile'}", address]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    (printed,) = re.findall(r"<pre>(.*)</pre>", done.stdout, re.DOTALL)
    (tmp_path / "answers.json").write_text(html.unescape(printed))
    rater, cast = read_votes(tmp_path / "answers.json", key)
    choices = [row["choice"] for row in json.loads(html.unescape(printed))["answers"]]
    assert rater == "r1" and choices == ["left", "none", "right"] * 2 and (cast == 0).sum() == 2


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve a folder by HTTP while the block runs."""
    handler = functools.partial(SimpleHTTPRequestHandler, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/index.html"
        finally:
            server.shutdown()
            thread.join()
