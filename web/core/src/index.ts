/** The C core of bodysense in WebAssembly: completes a human body, hands included, from partial tracking. */

import { type Core, type Memory, memoryOf } from "./memory.js";
import type { Estimate, Model, Observation, Person, Settings, State } from "./types.js";

export type * from "./types.js";

const VERSION = 1; // BS_VERSION of the header that this module mirrors
const [POINTS, JOINTS, LENGTHS] = [65, 52, 32];

// Bytes of the header's structs in 32-bit WebAssembly, of a frame's arrays in their order, and where members begin.
const SIZE = { person: 6200, observation: 40, estimate: 32, settings: 48, length: 24, mount: 64 };
const GIVEN = [4, 8 / POINTS, 24, 32, 1, 1, 8, 24].map((size) => size * POINTS);
const MADE = [24, 32 * JOINTS, 24 * POINTS, POINTS, 8 * POINTS, 8 * POINTS, 32, 24 * POINTS];
const PERSON = { restOffset: 0, deviation: 1560, height: 2080, lengths: 2096, length: 2104, mount: 2872 };
const [VALUES, FLAGS] = [8, 40]; // of bs_length and bs_mount their doubles, of bs_settings its integers
const NUMBERS = ["floor", "ease", "longestGap", "first", "longest"] as const;
const UNKNOWN = [NaN, NaN, NaN, NaN];

type Opened = ReturnType<typeof opened>;

/**
 * Open a model.
 *
 * `weights` is the content of completion.safetensors. `wasm` is the content of core.wasm or its module; if omitted it
 * is loaded from this package. Throws an Error with the core's message for other files.
 */
export async function openModel(weights: Uint8Array, wasm?: BufferSource | WebAssembly.Module): Promise<Model> {
  const code = wasm ?? (await packagedCore());
  const module = code instanceof WebAssembly.Module ? code : await WebAssembly.compile(code);
  const model = opened(memoryOf((await WebAssembly.instantiate(module)).exports as unknown as Core), weights);
  const kernel = model.memory.text(model.memory.core.bs_model_kernel!(model.at));
  return { points: model.points, kernel, start: (person = {}, settings = {}) => started(model, person, settings) };
}

async function packagedCore(): Promise<BufferSource> {
  const address = new URL("../core.wasm", import.meta.url);
  if (address.protocol === "file:") {
    const name = "node:fs/promises"; // a variable, so that bundlers for browsers ignore it
    const { readFile } = (await import(/* @vite-ignore */ name)) as typeof import("node:fs/promises");
    return new Uint8Array(await readFile(address));
  }
  const answer = await fetch(address);
  if (!answer.ok) throw new Error(`${address.href}: HTTP status ${answer.status}; give core.wasm as the argument wasm`);
  return answer.arrayBuffer();
}

/** A model, and addresses of a step's inputs and outputs. */
function opened(memory: Memory, weights: Uint8Array) {
  const { core, take, integers } = memory;
  const version = core.bs_version!();
  if (version !== VERSION)
    throw new Error(`core.wasm has version ${version}, wanted ${VERSION}; use this package's file`);
  const points = Array.from({ length: POINTS }, (_, point) => memory.text(core.bs_point_name!(point)));
  const [pointer, file] = [take(4), take(weights.length)];
  memory.bytes(file, weights.length).set(weights);
  const size = core.bs_model_size!(file, weights.length);
  const at = take(size);
  memory.check(core.bs_model_open!(file, weights.length, at, size, pointer), "weights");
  memory.giveBack(file, weights.length);
  const [person, observation] = [take(SIZE.person), take(SIZE.observation)];
  const [estimate, chosen] = [take(SIZE.estimate), take(SIZE.settings)];
  const [given, made] = [GIVEN.map(take), MADE.map(take)];
  integers(observation, 10).set([1, 0, ...given]);
  integers(estimate, 8).set(made);
  const scratchSize = core.bs_scratch_size!(at, 1);
  const scratch = [take(scratchSize), scratchSize] as const;
  const index = (name: string): number => {
    const place = points.indexOf(name);
    if (place < 0) throw new Error(`unknown point "${name}"; give one of ${points.join(", ")}`);
    return place;
  };
  return { memory, at, points, pointer, person, observation, estimate, chosen, given, made, scratch, index };
}

function started(opened: Opened, person: Person, own: Partial<Settings>): State {
  const { memory, pointer } = opened;
  const { core, doubles, integers } = memory;
  const size = core.bs_state_size!(opened.at);
  let known = person;
  writePerson(opened, person);
  let at = memory.take(size);
  const close = (): void => {
    if (at) memory.giveBack(at, size);
    at = 0;
  };
  const result = core.bs_state_start!(opened.at, opened.person, at, size, pointer);
  if (result) close();
  memory.check(result, "person");
  const state = (): number => {
    if (!at) throw new Error("state: it was closed; start a new one");
    return at;
  };
  return {
    step(frame, { holdFeet = true, infer = true, ...settings } = own) {
      integers(pointer, 1)[0] = state();
      writeFrame(opened, frame);
      const { observation, estimate, chosen, scratch } = opened;
      core.bs_default_settings!(chosen);
      doubles(chosen, 5).set(NUMBERS.map((name, k) => settings[name] ?? doubles(chosen, 5)[k]!));
      integers(chosen + FLAGS, 2).set([Number(holdFeet), Number(infer)]);
      memory.check(core.bs_step!(opened.at, chosen, 1, observation, pointer, estimate, ...scratch, 0), "frame");
      return readEstimate(opened);
    },
    person() {
      core.bs_state_person!(state(), opened.person);
      return readPerson(opened, known);
    },
    update(more) {
      writePerson(opened, more);
      memory.check(core.bs_state_update_person!(opened.at, state(), opened.person), "person");
      known = more;
    },
    contradictsHeight: () => core.bs_state_contradicts_height!(state()) === 1,
    close,
  };
}

function writeFrame({ memory, observation, given, index }: Opened, { time, points }: Observation): void {
  if (points.length > POINTS) throw new Error(`frame: ${points.length} points; give at most ${POINTS}`);
  const [point, times, positions, rotations, placed, turned, accuracies, accelerations] = given as number[];
  memory.integers(observation, 2)[1] = points.length;
  memory.doubles(times!, 1)[0] = time;
  points.forEach(({ name, position, rotation, accuracy, acceleration }, k) => {
    memory.integers(point!, POINTS)[k] = index(name);
    memory.bytes(placed!, POINTS)[k] = Number(!!position);
    memory.bytes(turned!, POINTS)[k] = Number(!!rotation);
    memory.doubles(accuracies!, POINTS)[k] = accuracy ?? NaN;
    memory.put(positions! + 24 * k, 3, position ?? UNKNOWN.slice(1), `${name}: position`);
    memory.put(rotations! + 32 * k, 4, rotation ?? UNKNOWN, `${name}: rotation`);
    memory.put(accelerations! + 24 * k, 3, acceleration ?? UNKNOWN.slice(1), `${name}: acceleration`);
  });
}

function readEstimate({ memory, made }: Opened): Estimate {
  const copy = (k: number): Float64Array => memory.doubles(made[k]!, MADE[k]! / 8).slice();
  const measured = memory.bytes(made[3]!, POINTS).slice();
  const [rootPosition, rotation, points, confidence, bound, contact, restOffset] = [0, 1, 2, 4, 5, 6, 7].map(copy);
  return { rootPosition, rotation, points, measured, confidence, bound, contact, restOffset } as Estimate;
}

/** Write a person into the core's memory. */
function writePerson({ memory, at: model, person: at, index }: Opened, person: Person): void {
  const { lengths = [], mounts = [], restOffset, deviation = new Float64Array(POINTS) } = person;
  if (lengths.length > LENGTHS) throw new Error(`person: ${lengths.length} lengths; give at most ${LENGTHS}`);
  memory.bytes(at, SIZE.person).fill(0);
  memory.doubles(at + PERSON.height, 2).set([person.height ?? NaN, person.heightDeviation ?? 0.025]);
  memory.integers(at + PERSON.lengths, 1)[0] = lengths.length;
  lengths.forEach(({ start, end, value, deviation }, k) => {
    memory.integers(at + PERSON.length + k * SIZE.length, 2).set([index(start), index(end)]);
    memory.doubles(at + PERSON.length + k * SIZE.length + VALUES, 2).set([value, deviation]);
  });
  for (const { joint, translation, rotation, rotationOnly } of mounts) {
    if (index(joint) >= JOINTS) throw new Error(`person: a tracker on "${joint}", which is no joint; name its parent`);
    const to = at + PERSON.mount + index(joint) * SIZE.mount;
    memory.bytes(to, 2).set([1, Number(rotationOnly ?? false)]);
    memory.put(to + VALUES, 7, [...translation, ...rotation], `mount of ${joint}`);
  }
  if (restOffset) {
    memory.put(at + PERSON.restOffset, 3 * POINTS, restOffset, "restOffset");
    memory.put(at + PERSON.deviation, POINTS, deviation, "deviation");
  } else memory.check(memory.core.bs_person_likeliest!(model, at), "person");
}

/** Read the person that the core wrote, with its other known measurements. */
function readPerson({ memory, person: at, index }: Opened, known: Person): Person {
  const height = memory.doubles(at + PERSON.height, 1)[0]!;
  const mounts = (known.mounts ?? []).map((mount) => {
    const from = at + PERSON.mount + index(mount.joint) * SIZE.mount + VALUES;
    const [x, y, z] = memory.doubles(from, 3) as unknown as [number, number, number];
    return { ...mount, translation: [x, y, z] as const };
  });
  const restOffset = memory.doubles(at + PERSON.restOffset, 3 * POINTS).slice();
  const deviation = memory.doubles(at + PERSON.deviation, POINTS).slice();
  return { ...known, height: Number.isNaN(height) ? null : height, mounts, restOffset, deviation };
}
