/** A server in the page's own browser: says what a scenario wants, also what a right one never would. */

import { readFileSync } from "node:fs";

const BODY = JSON.parse(
  readFileSync(new URL("../../../src/bodysense/body/default_body.json", import.meta.url), "utf8"),
);
const ROWS = [...BODY.joints, ...BODY.end_sites];
const NAMES = ROWS.map(({ name }) => name);
const JOINTS = BODY.joints.length;

const RATE = 12; // Hz: every frame goes through the protocol of the browser's debugger, which is slow

export const WELCOME = {
  type: "welcome",
  version: 1,
  session: "s1",
  token: "t1",
  name: "page",
  joints: NAMES.slice(0, JOINTS),
  points: NAMES,
  parents: ROWS.map(({ parent }) => NAMES.indexOf(parent)),
  rest_offset: ROWS.map(({ offset }) => offset),
  height: 1.7,
  signal: ["headset", "left_controller", "right_controller"],
  settings: {
    height: null,
    posture: "standing",
    mirror: false,
    regions: ["torso", "head", "arms", "fingers", "legs"],
    smoothing: 0,
    hidden: [],
    floor: 0,
    hold_feet: true,
    lengths: [],
    worn: [],
  },
  sources: ["replay"],
  recording: false,
  length: 4,
  resumed: false,
};

/** Answer the page's WebSocket, and keep what it says; `behave(socket, message)` may take over and return true. */
export async function fakeServer(page, behave = () => false) {
  const heard = [];
  const about = { server: true, webcam: false, version: "fake", files: [] };
  await page.route("**/page.json", (route) => route.fulfill({ json: about }));
  await page.routeWebSocket(/\/ws/, (socket) => {
    let timer;
    let settings = WELCOME.settings;
    socket.onMessage((message) => {
      const received = typeof message === "string" ? JSON.parse(message) : { type: "signal", bytes: message.length };
      heard.push(received);
      if (behave(socket, received)) return;
      if (received.type === "settings") {
        const { type, ...change } = received;
        settings = { ...settings, ...change };
      }
      if (received.type === "hello" || received.type === "settings")
        socket.send(JSON.stringify({ ...WELCOME, settings }));
      if (received.type === "hello" && received.watch === "replay")
        timer = setInterval(replay(socket), 1000 / RATE).unref(); // a browser that is gone holds nothing up
    });
    socket.onClose(() => clearInterval(timer));
  });
  return heard;
}

function replay(socket) {
  let sequence = 0;
  return () => {
    const time = (sequence / RATE) % WELCOME.length;
    socket.send(truthBytes(sequence, time));
    socket.send(poseBytes(sequence, time));
    sequence += 1;
  };
}

/** Arms that swing; the left one is uncertain and hidden. */
export function poseBytes(sequence, time) {
  const head = truthBytes(sequence, time, 0.1);
  const tail = Buffer.alloc(5 * NAMES.length + 8);
  NAMES.forEach((name, point) => {
    tail.writeFloatLE(name.startsWith("left") ? 0.12 : 0.01, 4 * point);
    tail.writeUInt8(name.startsWith("left") ? 230 : 10, 4 * NAMES.length + point);
  });
  tail.writeUInt32LE(900, 5 * NAMES.length + 4);
  head.writeUInt8(2, 0);
  return Buffer.concat([head, tail]);
}

export function truthBytes(sequence, time, off = 0) {
  const bytes = Buffer.alloc(16 + 12 + 16 * JOINTS);
  bytes.writeUInt8(3, 0);
  bytes.writeUInt16LE(JOINTS, 2);
  bytes.writeUInt32LE(sequence, 4);
  bytes.writeDoubleLE(time, 8);
  bytes.writeFloatLE(0.95, 20);
  for (let joint = 0; joint < JOINTS; joint++) {
    const swing = NAMES[joint] === "left_shoulder" ? -1.1 : NAMES[joint] === "right_shoulder" ? 1.1 : 0;
    const angle = swing * (1 + 0.2 * Math.sin((Math.PI * time) / 2) + off);
    bytes.writeFloatLE(Math.cos(angle / 2), 28 + 16 * joint);
    bytes.writeFloatLE(Math.sin(angle / 2), 28 + 16 * joint + 12);
  }
  return bytes;
}
