/** Plain objects for inputs and outputs. World frame, +Y up, metres, seconds; quaternions w, x, y, z. */

export type Vector = readonly [number, number, number];
export type Quaternion = readonly [number, number, number, number];

/** A tracked point: a name of `Model.points`, and its position, rotation or both. */
export interface Point {
  readonly name: string;
  readonly position?: Vector | null; // m
  readonly rotation?: Quaternion | null; // world ← joint
  readonly accuracy?: number; // m, expected error of the position; required with one
  readonly acceleration?: Vector | null; // m/s², without gravity
}

export interface Observation {
  readonly time: number; // s, increasing
  readonly points: readonly Point[];
}

/** A completed body. Arrays are flat. */
export interface Estimate {
  readonly rootPosition: Float64Array; // (3) m
  readonly rotation: Float64Array; // (52 × 4) parent ← joint; the root's is world ← root
  readonly points: Float64Array; // (65 × 3) m
  readonly measured: Uint8Array; // (65) 1 if a position was tracked
  readonly confidence: Float64Array; // (65) m, expected error
  readonly bound: Float64Array; // (65) m, nine of ten errors are smaller
  readonly contact: Float64Array; // (4) probability that left ankle, right ankle, left ball and right ball touch the floor
  readonly restOffset: Float64Array; // (65 × 3) m, the proportions in use
}

export interface Settings {
  readonly floor: number; // m, height of the floor; 0
  readonly ease: number; // s in which the body reaches a point that is seen again; default 0.25; 0: at once
  readonly longestGap: number; // s without frames after which the motion restarts; default 1
  readonly first: number; // s, interval of a first frame; 1/30
  readonly longest: number; // s, a longer interval that is no gap counts as this; 0.1
  readonly holdFeet: boolean; // hold standing feet, and keep feet above the floor; default true
  readonly infer: boolean; // infer unknown proportions and mountings of trackers; default true
}

/** A known distance (m, with its standard deviation) between two points of the T-pose. */
export type Length = Readonly<{ start: string; end: string; value: number; deviation: number }>;

/** Mounting of a tracker: T_joint_tracker. For an inertial sensor (`rotationOnly`) only the rotation is known. */
export type Mount = Readonly<{ joint: string; translation: Vector; rotation: Quaternion; rotationOnly?: boolean }>;

/** A person's known measurements. An empty object is the likeliest adult. */
export interface Person {
  readonly height?: number | null; // m, floor to crown
  readonly heightDeviation?: number; // m, standard deviation; 0.025
  readonly lengths?: readonly Length[];
  readonly mounts?: readonly Mount[];
  readonly restOffset?: ArrayLike<number>; // (65 × 3) m, from the parent in the T-pose; the likeliest if omitted
  readonly deviation?: ArrayLike<number>; // (65) m, standard deviation of bones; 0 if only offsets are given
}

/** The weights, opened. A model and its states belong to one thread. */
export interface Model {
  readonly points: readonly string[]; // names, in the order of an estimate's arrays
  readonly kernel: string; // name of the matrix kernel in use
  /** The state before the first frame of a person. */
  start(person?: Person, settings?: Partial<Settings>): State;
}

/** Everything that one person's next frame depends on. */
export interface State {
  /** Complete the next frame; `settings` default to those of the start. Throws the core's message as an Error. */
  step(observation: Observation, settings?: Partial<Settings>): Estimate;
  /** The current estimate of the person. */
  person(): Person;
  /** Update the person and keep the evidence. */
  update(person: Person): void;
  /** Whether the head was higher for 2 s than the known height allows; the height is inferred since. */
  contradictsHeight(): boolean;
  /** Give its memory back to the model. */
  close(): void;
}
