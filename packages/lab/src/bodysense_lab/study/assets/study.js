// The pages of a study: pairs of animations, one after the other, in an order of each rater's own.
// No condition is known here: animations have opaque names, and the key to them is not served.
"use strict";

// An endless row of whole numbers below 2³² that follows from a text: FNV-1a of its UTF-8 bytes, then Mulberry32.
// bodysense.lab.study.study.numbers is its twin.
function numbers(text) {
  let state = 0x811c9dc5;
  for (const byte of new TextEncoder().encode(text)) state = Math.imul(state ^ byte, 0x01000193);
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let mixed = Math.imul(state ^ (state >>> 15), state | 1);
    mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61);
    return (mixed ^ (mixed >>> 14)) >>> 0;
  };
}

function below(next, limit) {
  return Math.floor((next() * limit) / 2 ** 32);
}

function shuffled(list, next) {
  const result = [...list];
  for (let last = result.length - 1; last > 0; last--) {
    const other = below(next, last + 1);
    [result[last], result[other]] = [result[other], result[last]];
  }
  return result;
}

// Every pair of every scene, [left, right], in a rater's order. A scene's three animations form a ring; each pair is
// shown in the ring's direction in one half of the scenes and against it in the other, so that every animation is once
// on the left and once on the right, and every kind of pair as often one way as the other.
function pairsFor(study, rater) {
  const next = numbers(`${study.study}:${rater}`);
  const scenes = study.scenes.length;
  const half = Math.floor(scenes / 2) + (scenes % 2 ? below(next, 2) : 0);
  const turned = new Set(shuffled([...study.scenes.keys()], next).slice(0, half));
  const pairs = study.scenes.flatMap((ring, scene) =>
    ring.map((clip, place) => {
      const pair = [clip, ring[(place + 1) % ring.length]];
      return turned.has(scene) ? pair.reverse() : pair;
    }),
  );
  return shuffled(pairs, next);
}

function answersFile(study, state) {
  const pairs = pairsFor(study, state.rater);
  const answers = state.choices.map((choice, k) => ({ left: pairs[k][0], right: pairs[k][1], choice }));
  return { format: "bodysense study answers 1", study: study.study, rater: state.rater, answers };
}

function page() {
  const find = (id) => document.getElementById(id);
  const study = JSON.parse(find("study").textContent);
  const place = `bodysense-study-${study.study}`;
  const choiceButtons = [...document.querySelectorAll("[data-choice]")];
  const files = new Map(); // animation → promise of its file
  let state = null; // { rater, choices }
  let pairs = [];
  let showing = 0; // counts what was put on the stage, so that what comes late is dropped
  let ready = false; // both animations play

  function recall() {
    try {
      return JSON.parse(localStorage.getItem(place));
    } catch {
      return null;
    }
  }

  function keep() {
    try {
      if (state) localStorage.setItem(place, JSON.stringify(state));
      else localStorage.removeItem(place);
    } catch {
      find("problem").textContent = "This browser keeps nothing: do not close or reload the page before the end.";
    }
  }

  function load(clip) {
    if (!files.has(clip)) {
      const file = fetch(`clips/${clip}.webp`).then((reply) => {
        if (!reply.ok) throw new Error(`status ${reply.status}`);
        return reply.blob();
      });
      file.catch(() => files.delete(clip)); // the next try asks again
      files.set(clip, file);
    }
    return files.get(clip);
  }

  // A picture that starts at its first frame: browsers play the same address on from where it is, so it gets a new one.
  async function fresh(clip, side) {
    const image = new Image();
    const address =
      location.protocol === "file:" ? `clips/${clip}.webp?${showing}${side}` : URL.createObjectURL(await load(clip));
    image.alt = "";
    image.src = address;
    await image.decode();
    return image;
  }

  async function play() {
    const mine = ++showing;
    ready = false;
    choiceButtons.forEach((button) => (button.disabled = true));
    try {
      const [left, right] = pairs[state.choices.length];
      const images = await Promise.all([fresh(left, "l"), fresh(right, "r")]);
      if (mine !== showing) return;
      for (const [side, image] of [["left", images[0]], ["right", images[1]]]) {
        for (const old of find(side).children) URL.revokeObjectURL(old.src);
        find(side).replaceChildren(image); // both in one turn, so that they start together
      }
      find("problem").textContent = "";
    } catch (error) {
      if (mine !== showing) return;
      find("problem").textContent = `An animation could not be loaded (${error.message}). Press Replay to try again.`;
      return;
    }
    ready = true;
    choiceButtons.forEach((button) => (button.disabled = false));
    const following = pairs[state.choices.length + 1];
    if (following && location.protocol !== "file:") following.forEach((clip) => load(clip).catch(() => {}));
  }

  function show() {
    const done = state ? state.choices.length : 0;
    const section = !state ? "welcome" : done < pairs.length ? "pair" : "end";
    for (const id of ["welcome", "pair", "end"]) find(id).hidden = id !== section;
    if (section === "pair") {
      find("place").textContent = `Pair ${done + 1} of ${pairs.length}`;
      find("progress").max = pairs.length;
      find("progress").value = done;
      find("undo").disabled = done === 0;
      for (const side of ["left", "right"]) find(side).replaceChildren();
      play();
    } else if (section === "end") {
      const text = JSON.stringify(answersFile(study, state), null, 1) + "\n";
      URL.revokeObjectURL(find("save").href);
      find("save").href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
      find("save").download = `answers-${state.rater}.json`;
    }
  }

  function begin(rater, choices) {
    state = { rater, choices };
    pairs = pairsFor(study, rater);
    keep();
    show();
  }

  function choose(choice) {
    if (!ready) return;
    state.choices.push(choice);
    ready = false;
    keep();
    show();
  }

  function undo() {
    if (!state.choices.length) return;
    state.choices.pop();
    keep();
    show();
  }

  function welcome() {
    state = null;
    const drawn = crypto.getRandomValues(new Uint32Array(1))[0].toString(36);
    find("rater").value = new URLSearchParams(location.search).get("rater") ?? drawn;
    find("count").textContent = 3 * study.scenes.length;
    show();
  }

  find("begin").addEventListener("submit", (event) => {
    event.preventDefault();
    begin(find("rater").value, []);
  });
  choiceButtons.forEach((button) => button.addEventListener("click", () => choose(button.dataset.choice)));
  find("replay").addEventListener("click", play);
  find("undo").addEventListener("click", undo);
  find("again").addEventListener("click", () => {
    if (!confirm("Are the answers saved? They are forgotten here now.")) return;
    state = null;
    keep();
    welcome();
  });
  document.addEventListener("keydown", (event) => {
    if (find("pair").hidden || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
    const act = {
      ArrowLeft: () => choose("left"),
      ArrowRight: () => choose("right"),
      ArrowDown: () => choose("none"),
      r: play,
      u: undo,
    }[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });

  const kept = recall();
  if (kept) begin(kept.rater, kept.choices);
  else welcome();
}

if (typeof document !== "undefined") page();
else module.exports = { numbers, below, shuffled, pairsFor, answersFile };
