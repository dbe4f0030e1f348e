/** Body tracking of WebXR for every browser: a polyfill of the WebXR Body Tracking module (level 1). */

import { HeadsetReader } from "./headset.js";
import { conjugate, multiply, rotate, subtract } from "./math.js";
import type { Model, Person, Point, Settings, State } from "./types.js";
import { WearerClock } from "./wearer_clock.js";
import { JOINT_NAMES, jointPoses, type JointPose } from "./xr_joints.js";

export { HeadsetReader } from "./headset.js";
export { WearerClock } from "./wearer_clock.js";

type FillPoses = (spaces: Iterable<XRSpace>, base: XRSpace, transforms: Float32Array) => boolean;

const FEATURE = "body-tracking";
const DEFAULT_HEIGHT = 1.7; // m, of the body for which a device's distance from its joint is known
const MISNAMED = /-middle-metacarpal$/; // the specification's name is "middle-phalanx-metacarpal"

/** A joint of a tracked body, for `XRFrame.getPose`. */
export interface XRBodySpace extends XRSpace {
  readonly jointName: string;
}
/** The 83 joints of a tracked body by name, in the specification's order. */
export type XRBody = ReadonlyMap<string, XRBodySpace>;

/** A frame of a session that has body tracking. */
export interface XRBodyFrame extends XRFrame {
  readonly body: XRBody | null;
}

export interface BodyTrackingOptions {
  readonly person?: Person; // the known wearer, such as { height: 1.75 }
  readonly settings?: Partial<Settings>;
  /** Further tracked points of a frame, such as trackers, in the frame of `floor`. */
  readonly points?: (frame: XRFrame, floor: XRReferenceSpace) => readonly Point[];
}

export interface BodyTracking {
  /** The current estimate of the wearer, kept across sessions. */
  person(): Person;
  /** Continue with another wearer, or with new measurements of this one. */
  update(person: Person): void;
  /** Uninstall the polyfill. Bodies of running sessions are null from then on. */
  uninstall(): void;
}

/**
 * Install `body-tracking` into this page's WebXR.
 *
 * A session that asks for the feature has it: the browser's own body if there is one, else a body that `model` completes
 * from headset, controllers or hands. Throws an Error if the browser has no WebXR.
 */
export function installBodyTracking(model: Model, options: BodyTrackingOptions = {}): BodyTracking {
  const xr = globalThis.navigator?.xr;
  if (!xr || typeof XRFrame === "undefined")
    throw new Error("this browser has no WebXR; open the page by https in a headset's browser");
  const prototype: XRFrame & { fillPoses?: FillPoses } = XRFrame.prototype;
  const { getPose, fillPoses } = prototype;
  const own = Object.getOwnPropertyDescriptor(prototype, "body");
  const requestSession = xr.requestSession.bind(xr);
  const bodies = new Map<XRSession, TrackedBody>();
  let known = options.person ?? {};

  const granted: XRSystem["requestSession"] = async (mode, init = {}) => {
    const asked = [...(init.requiredFeatures ?? []), ...(init.optionalFeatures ?? [])].includes(FEATURE);
    if (!asked || mode === "inline") return requestSession(mode, init);
    const [required, optional] = [init.requiredFeatures, init.optionalFeatures].map((features) =>
      (features ?? []).filter((feature) => feature !== FEATURE),
    );
    const optionalFeatures = [...optional!, "local-floor", FEATURE];
    const session = await requestSession(mode, { ...init, requiredFeatures: required!, optionalFeatures });
    if (session.enabledFeatures?.includes(FEATURE)) return session;
    const begun = async () =>
      new TrackedBody(model, known, options, session, await session.requestReferenceSpace("local-floor"), getPose);
    const body = await begun().catch(async (error: unknown) => {
      await session.end();
      throw error;
    });
    bodies.set(session, body);
    session.addEventListener("end", () => {
      if (bodies.delete(session)) known = body.close();
    });
    const request = session.requestAnimationFrame.bind(session);
    session.requestAnimationFrame = (callback) =>
      request((time, frame) => {
        body.begin(time / 1000, frame);
        callback(time, frame);
      });
    patched(session, "enabledFeatures", { value: [...(session.enabledFeatures ?? []), FEATURE] });
    return session;
  };

  const patches = [
    patched(xr, "requestSession", { value: granted, writable: true }),
    patched(globalThis, "XRBody", { value: Joints, writable: true }),
    patched(globalThis, "XRBodySpace", { value: BodySpace, writable: true }),
    patched(prototype, "body", {
      get(this: XRFrame): XRBody | null {
        return (own?.get?.call(this) as XRBody | null | undefined) ?? bodies.get(this.session)?.body ?? null;
      },
    }),
    patched(prototype, "getPose", {
      value(this: XRFrame, space: XRSpace, base: XRSpace): XRPose | null {
        const body = [space, base].find((one) => one instanceof BodySpace)?.owner;
        return body ? body.locate(this, space, base) : (getPose.call(this, space, base) ?? null);
      },
      writable: true,
    }),
    patched(prototype, "fillPoses", {
      value(this: XRFrame, spaces: Iterable<XRSpace>, base: XRSpace, out: Float32Array): boolean {
        const all = [...spaces];
        if (fillPoses && ![...all, base].some((one) => one instanceof BodySpace))
          return fillPoses.call(this, all, base, out);
        if (out.length < 16 * all.length) throw new TypeError(`${out.length} numbers; give ${16 * all.length}`);
        const poses = all.map((space) => this.getPose(space, base));
        poses.forEach((pose, k) => out.set(pose?.transform.matrix ?? Array(16).fill(NaN), 16 * k));
        return poses.every((pose) => pose !== null);
      },
      writable: true,
    }),
  ];
  return {
    person: () => [...bodies.values()].at(-1)?.person() ?? known,
    update(person) {
      for (const body of bodies.values()) body.update(person);
      known = person;
    },
    uninstall() {
      for (const body of bodies.values()) known = body.close();
      bodies.clear();
      for (const undo of patches.splice(0)) undo();
    },
  };
}

/** Define a property. Returns a function that restores the previous one. */
function patched(target: object, name: string, property: PropertyDescriptor): () => void {
  const before = Object.getOwnPropertyDescriptor(target, name);
  Object.defineProperty(target, name, { ...property, configurable: true });
  return () => {
    if (before) Object.defineProperty(target, name, before);
    else Reflect.deleteProperty(target, name);
  };
}

class BodySpace extends EventTarget {
  constructor(
    readonly owner: TrackedBody,
    readonly jointName: string,
  ) {
    super();
  }
}

/** A `Map` that finds the joint misnamed in the specification by both names. */
class Joints extends Map<string, XRBodySpace> {
  override get(name: string): XRBodySpace | undefined {
    return super.get(name.replace(MISNAMED, "-middle-phalanx-metacarpal"));
  }
}

/** The body of one session. */
class TrackedBody {
  readonly body: XRBody;
  private readonly reader = new HeadsetReader();
  private state: State | null;
  private poses: ReadonlyMap<string, JointPose> | null = null;
  private size: number; // of the wearer, by the default body
  private next: { readonly time: number; readonly frame: XRFrame } | null = null; // an animation frame, not yet read
  private time = -Infinity; // s, of the frame that was read last
  private readonly clock: WearerClock;

  constructor(
    private readonly model: Model,
    person: Person,
    private readonly options: BodyTrackingOptions,
    private readonly session: XRSession,
    private readonly floor: XRReferenceSpace,
    private readonly getPose: XRFrame["getPose"],
  ) {
    const space = (name: string) => [name, new BodySpace(this, name) as unknown as XRBodySpace] as const;
    this.body = new Joints(JOINT_NAMES.map(space));
    this.state = model.start(person, options.settings);
    this.size = (person.height ?? DEFAULT_HEIGHT) / DEFAULT_HEIGHT;
    this.clock = new WearerClock(options.settings?.longestGap);
    floor.addEventListener("reset", () => this.clock.leap());
  }

  person(): Person | undefined {
    return this.state?.person();
  }

  update(person: Person): void {
    this.state?.update(person);
  }

  /** End the session and return the estimated wearer. */
  close(): Person {
    const person = this.state?.person() ?? {};
    this.state?.close();
    this.state = this.poses = null;
    return person;
  }

  /** An animation frame begins, at `time` s. */
  begin(time: number, frame: XRFrame): void {
    if (time > this.time) this.next = { time, frame };
  }

  /** The pose of `space` in the frame of `base`, one of which is a joint of this body; null if it is not tracked. */
  locate(frame: XRFrame, space: XRSpace, base: XRSpace): XRPose | null {
    this.read(frame);
    const [pose, from] = [this.inFloor(frame, space), this.inFloor(frame, base)];
    if (!pose || !from) return null;
    const back = conjugate(from.rotation);
    const [x, y, z] = rotate(back, subtract(pose.position, from.position));
    const [w, ...axis] = multiply(back, pose.rotation);
    const transform = new XRRigidTransform({ x, y, z }, { w, x: axis[0], y: axis[1], z: axis[2] });
    return { transform, emulatedPosition: !pose.isMeasured };
  }

  private inFloor(frame: XRFrame, space: XRSpace): JointPose | null {
    if (space instanceof BodySpace) return this.poses?.get(space.jointName) ?? null;
    const pose = this.getPose.call(frame, space, this.floor);
    if (!pose) return null;
    const { position: p, orientation: q } = pose.transform;
    return { position: [p.x, p.y, p.z], rotation: [q.w, q.x, q.y, q.z], isMeasured: !pose.emulatedPosition };
  }

  /** Complete the body of an animation frame, once; frames of events show the last one's. */
  private read(frame: XRFrame): void {
    if (this.next?.frame !== frame || !this.state) return;
    const { time } = this.next;
    [this.time, this.next, this.poses] = [time, null, null];
    const tracked = this.reader.read(frame, this.floor, this.session.inputSources, this.size);
    const points = [...tracked, ...(this.options.points?.(frame, this.floor) ?? [])];
    const head = points.find(({ name }) => name === "head");
    if (!head) return; // a body has all joints or none
    const body = this.state.step({ time: this.clock.time(time, head), points });
    this.poses = jointPoses(body, this.model.points);
    this.size = heightOf(body.restOffset, this.model.points) / DEFAULT_HEIGHT;
  }
}

/** m, floor to crown in the T-pose. */
function heightOf(restOffset: Float64Array, points: readonly string[]): number {
  const chain = ["pelvis", "spine1", "spine2", "spine3", "neck", "head", "head_top"];
  return chain.reduce((sum, name) => sum + restOffset[3 * points.indexOf(name) + 1]!, 0);
}
