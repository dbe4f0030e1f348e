/** The page: sources, the engine and the person meet here. */

import { amassClip } from "./files/amass";
import type { Clip, SensorSet } from "./core/clip";
import { NOBODY, personOf } from "./core/person";
import { readNpz } from "./core/npz";
import { Engine } from "./engine/engine";
import { defaultBody, fetched, unpacked, type DefaultBody } from "./engine/files";
import { Live } from "./live";
import { Notice, reasonOf } from "./notice";
import { button, element, input } from "./page";
import { Playback } from "./playback";
import { saveMotion, type FileKind } from "./out/save";
import { loadSettings, saveSettings, type Settings } from "./settings";
import { ClipSource } from "./sources/clip_source";
import type { Source } from "./sources/source";
import { onFile } from "./ui/drop";
import { onKeys } from "./ui/keys";
import { LookPanel } from "./ui/look_panel";
import { SensorPanel } from "./ui/sensor_panel";
import { showStatus } from "./ui/status";
import { applyTheme, nextTheme, onSystemChange } from "./ui/theme";
import { Timeline } from "./ui/timeline";
import { Bodies } from "./view/bodies";
import type { View } from "./view/scene";

const FACTS_EVERY = 150; // ms
const OWN_AVATAR = "avatar.vrm.gz";

/** Begin: fetch what the page needs, and show the packaged performance. */
export async function begin(view: View, base: string): Promise<App> {
  const engine = new Engine(base);
  const body = await defaultBody(base);
  return new App(view, engine, body, base);
}

export class App {
  private settings: Settings = loadSettings(localStorage);
  private source: Source | null = null;
  private performance: Clip | null = null;
  private shownAt = 0; // ms
  private toldAt = 0; // ms
  private readonly playback = new Playback();
  private readonly notice = new Notice();
  private readonly bodies: Bodies;
  private readonly live: Live;
  private readonly timeline: Timeline;
  private readonly look: LookPanel;
  private readonly sensors: SensorPanel;

  constructor(
    private readonly view: View,
    engine: Engine,
    private readonly body: DefaultBody,
    private readonly base: string,
  ) {
    this.bodies = new Bodies(view.stage);
    this.live = new Live(engine, body.skeleton, (reason) => this.notice.fault(reason));
    this.live.settings = { floor: 0, holdFeet: this.settings.holdFeet };
    this.timeline = new Timeline(this.playback, () => this.live.history);
    this.look = new LookPanel(this.settings, {
      changed: (change) => this.change(change),
      ownAvatar: () => this.attempt(() => this.wearOwn()),
    });
    this.sensors = new SensorPanel(
      this.settings.sensors,
      (set) => this.simulate(set),
      (hidden) => (this.live.hidden = hidden),
    );
    this.bind();
    this.repaint();
    onSystemChange(() => this.repaint());
    engine.opened.catch((error: unknown) => this.notice.fault(reasonOf(error)));
    this.attempt(() => this.perform());
    this.attempt(() => this.wearOwn());
    view.run((milliseconds) => this.draw(milliseconds));
  }

  private bind(): void {
    for (const kind of ["bvh", "glb", "vrma"] as const) button(`save-${kind}`).onclick = () => this.attempt(() => this.save(kind));
    button("theme").onclick = () => {
      this.change({ theme: nextTheme(this.settings.theme) });
      this.repaint();
    };
    const settings = button("settings");
    settings.onclick = () => {
      const panel = element("panel");
      panel.hidden = !panel.hidden;
      settings.setAttribute("aria-expanded", String(!panel.hidden));
    };
    const height = input("height");
    height.value = this.settings.height === null ? "" : this.settings.height.toFixed(2);
    height.onchange = () => this.attempt(() => this.tellHeight(height.value));
    const hold = input("hold-feet");
    hold.checked = this.settings.holdFeet;
    hold.onchange = () => {
      this.change({ holdFeet: hold.checked });
      this.live.change({ ...this.live.settings, holdFeet: hold.checked });
    };
    onFile((file) => this.attempt(() => this.open(file)));
    button("door-performance").onclick = () => this.attempt(() => this.perform());
    onKeys({
      " ": () => this.playback.toggle(),
      ArrowLeft: () => this.timeline.step(-1),
      ArrowRight: () => this.timeline.step(1),
      l: () => this.playback.goLive(),
      r: () => this.view.reset(),
    });
  }

  /** The packaged performance, seen by a simulated headset. */
  private async perform(): Promise<void> {
    const { skeleton } = this.body;
    this.performance ??= amassClip(await readNpz(await fetched(this.base, "performance.npz")), "performance", skeleton);
    this.play(this.performance, "The page's own performance");
  }

  private play(clip: Clip, title: string): void {
    this.begin(new ClipSource(clip, this.live, this.settings.sensors, title));
  }

  private begin(source: Source): void {
    this.source?.stop();
    this.source = source;
    this.live.begin(this.settings.height === null ? NOBODY : personOf(this.settings.height));
    this.playback.goLive();
    this.sensors.offer(source.sensors, source instanceof ClipSource);
    this.view.reset();
  }

  private simulate(sensors: SensorSet): void {
    this.change({ sensors });
    if (!(this.source instanceof ClipSource)) return;
    this.source.set = sensors;
    this.sensors.offer(this.source.sensors, true);
  }

  private async tellHeight(text: string): Promise<void> {
    const height = text.trim() === "" ? null : Number(text);
    this.live.tellHeight(height);
    this.change({ height });
  }

  private async open(file: File): Promise<void> {
    const { Avatar } = await import("./view/avatar");
    const { avatarBytes } = await import("./view/avatar_file");
    this.bodies.wear(await Avatar.read(await avatarBytes(file), file.name));
    button("own-avatar").hidden = false;
  }

  private async wearOwn(): Promise<void> {
    const { Avatar } = await import("./view/avatar"); // three-vrm is fetched when it is wanted
    this.bodies.wear(await Avatar.read(await unpacked(this.base, OWN_AVATAR), OWN_AVATAR));
    button("own-avatar").hidden = true;
  }

  private async save(kind: FileKind): Promise<void> {
    await saveMotion(this.body.skeleton, this.live.history.longestRun(), kind);
  }

  private change(change: Partial<Settings>): void {
    this.settings = { ...this.settings, ...change };
    this.attempt(async () => saveSettings(localStorage, this.settings));
  }

  private repaint(): void {
    const { theme } = this.settings;
    applyTheme(theme, (look) => this.view.paint(look));
    button("theme").textContent = { auto: "Auto", light: "Light", dark: "Dark" }[theme];
    button("theme").setAttribute("aria-label", `Theme: ${theme}; change it`);
  }

  /** Whatever goes wrong is said in one line. */
  private attempt(what: () => Promise<void>): void {
    void what().catch((error: unknown) => this.notice.fault(reasonOf(error)));
  }

  private draw(milliseconds: number): void {
    const seconds = Math.min((milliseconds - this.shownAt) / 1000, 0.1);
    this.shownAt = milliseconds;
    this.source?.frame(milliseconds);
    const moment = this.playback.step(this.live.history, seconds);
    if (!moment || !this.source) return;
    this.bodies.show(moment, this.body.skeleton, this.settings, seconds);
    this.view.follow(moment.rootPosition[0], moment.rootPosition[2], seconds);
    if (milliseconds - this.toldAt < FACTS_EVERY) return;
    this.toldAt = milliseconds;
    this.timeline.show();
    this.look.show(this.settings, this.bodies.hasAvatar, moment.truth !== null);
    showStatus(this.live, moment, this.body.skeleton, this.source.title);
  }
}
