"""Pages of a study: their script draws the orders that Python draws, and they work in a browser."""

from __future__ import annotations

import functools
import html
import json
import re
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bodysense_lab.study.scenes import FILES, write_study_page
from bodysense_lab.study.study import StudyKey, draw_key, numbers, pairs_for, read_answers

SCRIPT = Path(str(files("bodysense_lab.study"))) / "assets" / "study.js"
RATERS = ["1", "r2", "p-07", "Ä🙂", "x" * 32]
NODE = shutil.which("node")
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


def key_of(scenes: int) -> StudyKey:
    return draw_key([f"scene{k}" for k in range(scenes)], np.random.default_rng(scenes))


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_the_script_and_python_draw_equal_orders() -> None:
    keys = [key_of(scenes) for scenes in (1, 2, 5, 8)]
    studies = [{"study": key.study, "scenes": [scene.ring for scene in key.scenes]} for key in keys]
    code = """
      const page = require(process.argv[1]);
      const { studies, raters } = JSON.parse(process.argv[2]);
      const next = page.numbers("böse 🙂");
      const state = { rater: raters[0], choices: ["left", "none", "right"] };
      console.log(JSON.stringify({
        numbers: Array.from({ length: 100 }, next),
        pairs: studies.map((study) => raters.map((rater) => page.pairsFor(study, rater))),
        file: page.answersFile(studies[0], state),
      }));
    """
    given = json.dumps({"studies": studies, "raters": RATERS})
    assert NODE is not None
    done = subprocess.run([NODE, "-e", code, str(SCRIPT), given], capture_output=True, text=True, check=True)
    drawn_by_page = json.loads(done.stdout)
    drawn = numbers("böse 🙂")
    assert drawn_by_page["numbers"] == [next(drawn) for _ in range(100)]
    for key, of_study in zip(keys, drawn_by_page["pairs"], strict=True):
        for rater, pairs in zip(RATERS, of_study, strict=True):
            assert [tuple(pair) for pair in pairs] == pairs_for(key, rater)
    rows = [(row["left"], row["right"], row["choice"]) for row in drawn_by_page["file"]["answers"]]
    wanted = zip(pairs_for(keys[0], "1"), ("left", "none", "right"), strict=True)
    assert rows == [(left, right, choice) for (left, right), choice in wanted]


def test_the_page_contains_only_opaque_names(tmp_path: Path) -> None:
    key = key_of(2)
    clips = write_study_page(tmp_path, "</script>", [scene.ring for scene in key.scenes])
    assert clips == tmp_path / "clips" and clips.is_dir()
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == sorted(FILES)
    page = (tmp_path / "index.html").read_text()
    (data,) = re.findall(r'<script id="study" type="application/json">(.*?)</script>', page)
    assert json.loads(data) == {"study": "</script>", "scenes": [list(scene.ring) for scene in key.scenes]}
    for name in FILES:
        text = (tmp_path / name).read_text()
        assert not re.search(r"https?://|//cdn|@import", text), "nothing is fetched from other hosts"


DRIVER = """
(async () => {
  const find = (id) => document.getElementById(id);
  const press = (key) => document.dispatchEvent(new KeyboardEvent("keydown", { key }));
  const playing = () => new Promise((done) => {
    const timer = setInterval(() => {
      if (!document.querySelector("[data-choice]").disabled) done(clearInterval(timer));
    }, 5);
  });
  const log = JSON.parse(sessionStorage.getItem("log") ?? "[]");
  if (!find("welcome").hidden) {
    log.push(`begins with ${find("count").textContent} pairs`);
    find("rater").value = "r1";
    document.querySelector("#begin button").click();
  }
  while (find("end").hidden) {
    press("ArrowLeft"); // before anything plays: must not count
    await playing();
    const k = find("progress").value;
    log.push(`${find("place").textContent}: ${[...document.querySelectorAll("img")].map((i) => i.naturalWidth)}`);
    if (k === 1 && log.length < 4) {
      document.querySelector("#replay").click();
      press("ArrowLeft"); // while it loads again
      continue;
    }
    if (k === 2 && !sessionStorage.getItem("log")) {
      sessionStorage.setItem("log", JSON.stringify(log));
      location.reload();
      return;
    }
    if (k === 4 && !sessionStorage.getItem("undone")) {
      sessionStorage.setItem("undone", "yes");
      press("u");
      continue;
    }
    if (k % 2) press(["ArrowLeft", "ArrowRight", "ArrowDown"][k % 3]);
    else document.querySelectorAll("[data-choice]")[[0, 2, 1][k % 3]].click();
  }
  const text = await (await fetch(find("save").href)).text();
  const kept = Object.keys(localStorage).length;
  window.confirm = () => true;
  find("again").click();
  log.push(`${find("problem").textContent}${kept} ${Object.keys(localStorage).length} ${!find("welcome").hidden}`);
  const result = document.createElement("pre");
  result.textContent = JSON.stringify({ text, log, name: find("save").download });
  document.body.replaceChildren(result);
})();
"""


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_the_pages_work_in_a_browser(tmp_path: Path) -> None:
    """Answers by keys and buttons, with a reload and a withdrawn answer; answers that are too early do not count."""
    key, site = key_of(2), tmp_path / "site"
    site.mkdir()
    clips = write_study_page(site, key.study, [scene.ring for scene in key.scenes])
    for k, clip in enumerate(key.scene_of):
        pictures = [Image.new("RGB", (36, 45), (40 * k, 99, shade)) for shade in (0, 90, 180)]
        pictures[0].save(clips / f"{clip}.webp", save_all=True, append_images=pictures[1:], duration=33, loop=0)
    page = (site / "index.html").read_text()
    (site / "index.html").write_text(page.replace("</body>", f"<script>{DRIVER}</script></body>"))
    with served(site) as address:
        assert BROWSER is not None
        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=20000", "--dump-dom"]
        done = subprocess.run(
            [BROWSER, *flags, f"--user-data-dir={tmp_path / 'profile'}", address],
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        )
    (printed,) = re.findall(r"<pre>(.*)</pre>", done.stdout, re.DOTALL)
    result = json.loads(html.unescape(printed))
    (tmp_path / "answers.json").write_text(result["text"])
    answers = read_answers(tmp_path / "answers.json", key)
    wanted = [("left", "right", "none")[k % 3] for k in range(6)]
    assert answers.given == tuple((*pair, choice) for pair, choice in zip(pairs_for(key, "r1"), wanted, strict=True))
    assert result["name"] == "answers-r1.json"
    places = [1, 2, 2, 3, 3, 4, 5, 4, 5, 6]  # replayed, reloaded, withdrawn
    assert result["log"][0] == "begins with 6 pairs" and result["log"][-1] == "1 0 true"
    assert result["log"][1:-1] == [f"Pair {place} of 6: 36,36" for place in places]


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve a folder by HTTP while the block runs."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder))) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/index.html"
        finally:
            server.shutdown()
            thread.join()
