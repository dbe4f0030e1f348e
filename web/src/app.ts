/** The page: what the server sends, the person chooses and the headset tracks meet here. */

import { avatarBytes } from "./avatar_file";
import { Bodies } from "./bodies";
import { Connection, socketAddress } from "./connection";
import { onFile } from "./drop";
import { Headset } from "./headset";
import { History } from "./history";
import { Notice, reasonOf } from "./notice";
import { button, element, input } from "./page";
import { PersonPanel } from "./person_panel";
import { Playback } from "./playback";
import { Plots } from "./plots";
import type { Hello, ServerMessage, SignalPoint, Source, Welcome } from "./protocol";
import { ReplayPanel } from "./replay_panel";
import { saveMotion, type FileKind } from "./save";
import type { View } from "./scene";
import { SensorPanel } from "./sensor_panel";
import { loadSettings, ofPerson, saveSettings, type Settings } from "./settings";
import { onKeys } from "./shortcuts";
import { hasProportions, isSameTree, skeletonOf } from "./skeleton";
import { Status } from "./status";
import { Timeline } from "./timeline";
import { ViewPanel } from "./view_panel";
import { XR_POINTS } from "./xr_signal";

const PLOT_EVERY = 100; // ms

export class App {
  private settings: Settings = loadSettings(localStorage);
  private history: History | null = null;
  private welcome: Welcome | null = null;
  private source: Source | null = null; // that is watched while no headset is worn
  private isWorn = false;
  private sequence = 0;
  private shownAt = 0; // ms
  private plottedAt = 0; // ms
  private readonly playback = new Playback();
  private readonly bodies: Bodies;
  private readonly headset: Headset;
  private readonly person: PersonPanel;
  private readonly status = new Status();
  private readonly plots = new Plots();
  private readonly notice = new Notice(() => this.connection.open());
  private readonly timeline = new Timeline(this.playback, () => this.history);
  private readonly sensors = new SensorPanel((hidden) => this.connection.tell({ type: "settings", hidden }));
  private readonly replay = new ReplayPanel((change) => this.connection.tell({ type: "replay", ...change }));
  private readonly connection = new Connection(socketAddress(location), () => this.hello(), {
    welcome: (message) => this.begin(message),
    signal: (frame) => this.history?.addSignal(frame),
    truth: (frame) => this.history?.addTruth(frame),
    pose: (frame) => this.history?.addPose(frame, performance.now()),
    message: (message) => this.hear(message),
    lost: (reason, retryIn) => this.lose(reason, retryIn),
  });

  constructor(private readonly view: View) {
    this.bodies = new Bodies(view.stage);
    this.headset = new Headset(view, {
      entered: () => this.wear(true),
      tracked: (time, points) => this.track(time, points),
      left: () => this.wear(false),
    });
    new ViewPanel(
      this.settings,
      (change) => this.change(change),
      (theme) => view.paint(theme),
    );
    this.person = new PersonPanel(this.settings, {
      changed: (change) => {
        this.change(change);
        this.connection.tell({ type: "settings", ...change });
      },
      calibrate: () => this.connection.tell({ type: "calibrate" }),
      recentre: () => this.connection.tell({ type: "recentre" }),
    });
    this.bindButtons();
    this.connection.open();
    view.run((milliseconds, frame) => this.draw(milliseconds, frame));
  }

  private bindButtons(): void {
    const attempt = (what: () => Promise<void>) => () =>
      void what().catch((error: unknown) => this.notice.say(reasonOf(error)));
    const save = (kind: FileKind) => attempt(() => saveMotion(this.history, kind));
    button("save-bvh").onclick = save("bvh");
    button("save-glb").onclick = save("glb");
    button("enter-vr").onclick = attempt(() => this.headset.enter());
    button("avatar-remove").onclick = () => this.wearAvatar(null);
    onFile((file) => attempt(() => this.openAvatar(file))());
    const record = input("record");
    record.onchange = () => this.connection.tell({ type: "record", on: record.checked });
    void Headset.isThere().then((isThere) => (button("enter-vr").hidden = !isThere));
    onKeys({
      " ": () => this.playback.toggle(),
      ArrowLeft: () => this.timeline.step(-1),
      ArrowRight: () => this.timeline.step(1),
      l: () => this.playback.goLive(),
      r: () => this.view.reset(),
      c: () => this.connection.tell({ type: "recentre" }),
      m: () => input("mirror").click(),
    });
  }

  private hello(): Omit<Hello, "type" | "version"> {
    return {
      name: "page",
      points: this.isWorn ? [...XR_POINTS] : [],
      settings: ofPerson(this.settings),
      watch: this.isWorn ? null : this.source,
      resume: this.welcome && { session: this.welcome.session, token: this.welcome.token },
    };
  }

  private begin(message: Welcome): void {
    this.notice.clear();
    const [offered] = message.sources;
    if (!this.isWorn && this.source === null && offered !== undefined) {
      this.source = offered;
      this.connection.open();
      return;
    }
    // A welcome comes again where the settings changed.
    if (!this.history || !isSameTree(this.history.skeleton, message)) {
      this.history = new History(skeletonOf(message));
      this.bodies.build(this.history.skeleton);
    } else this.grow(message);
    this.welcome = message;
    this.sensors.offer(message.signal, message.settings.hidden);
    this.bodies.hide(message.settings.hidden.map((name) => message.signal.indexOf(name)));
    this.replay.offer(message.length);
    this.status.begin(this.isWorn || this.source !== null);
    this.measured(message.settings.height);
    input("record").disabled = !message.recording;
    element("record-hint").hidden = message.recording;
  }

  /** The body has other proportions from now on. */
  private grow({ rest_offset }: Pick<Welcome, "rest_offset">): void {
    const { history } = this;
    if (!history || hasProportions(history.skeleton, rest_offset)) return;
    history.skeleton = { ...history.skeleton, restOffset: Float32Array.from(rest_offset.flat()) };
    this.bodies.build(history.skeleton);
  }

  /** The height that the server found in one standing second. */
  private measured(height: number | null): void {
    if (height === null || height === this.settings.height) return;
    this.person.showHeight(height);
    this.change({ height });
  }

  private hear(message: Exclude<ServerMessage, Welcome>): void {
    if (message.type === "placed") {
      this.bodies.placeSignal(message);
      this.headset.place(message);
    } else if (message.type === "proportions") this.grow(message);
    else if (message.type === "said") this.notice.say(message.text);
    else if (message.type === "error") this.notice.say(message.reason, true);
  }

  private lose(reason: string, retryIn: number | null): void {
    this.notice.say(reason, retryIn === null);
    this.status.lost(retryIn !== null);
    if (retryIn === null) this.welcome = null; // what was refused is not resumed
  }

  private change(change: Partial<Settings>): void {
    this.settings = { ...this.settings, ...change };
    saveSettings(localStorage, this.settings);
  }

  private wear(isWorn: boolean): void {
    this.isWorn = isWorn;
    this.welcome = null;
    this.playback.goLive();
    this.connection.open();
  }

  private track(time: number, points: SignalPoint[]): void {
    const frame = { sequence: this.sequence++, time, points };
    if (this.connection.signal(frame)) this.history?.addSignal(frame, performance.now());
  }

  private async openAvatar(file: File): Promise<void> {
    const bytes = await avatarBytes(file);
    if (!this.history) throw new Error("There is no body to drive an avatar yet; connect first.");
    const { Avatar } = await import("./avatar"); // three-vrm is fetched when it is wanted
    this.wearAvatar(await Avatar.read(bytes, file.name, this.history.skeleton));
  }

  private wearAvatar(avatar: Parameters<Bodies["wear"]>[0]): void {
    this.bodies.wear(avatar);
    this.notice.clear();
    button("avatar-remove").hidden = avatar === null;
    element("drop-hint").hidden = avatar !== null;
  }

  private draw(milliseconds: number, frame: XRFrame | undefined): void {
    if (frame && this.isWorn) this.headset.read(milliseconds, frame);
    const seconds = Math.min((milliseconds - this.shownAt) / 1000, 0.1);
    this.shownAt = milliseconds;
    const { history } = this;
    const moment = history && this.playback.step(history, seconds);
    if (!history || !moment) return;
    this.bodies.show(moment, this.settings, this.isWorn, seconds);
    if (milliseconds - this.plottedAt < PLOT_EVERY) return;
    this.plottedAt = milliseconds;
    this.timeline.show(history);
    this.plots.show(history, this.playback.time);
    this.replay.show(moment);
    this.status.show(history, moment);
  }
}
