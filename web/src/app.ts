/** The page's application: connects sources, engine, settings and panels. */

import type { SensorSet } from "./body/clip";
import type { Observation } from "./body/observation";
import { stature, type Skeleton } from "./body/skeleton";
import type { Engine } from "./engine/engine";
import { FirstPicture, type FirstFiles } from "./first";
import { Live } from "./live";
import { Measuring } from "./wearer/measuring";
import { reasonOf, type Notice } from "./notice";
import { workOffline } from "./offline";
import { button, element } from "./page";
import { Playback } from "./takes/playback";
import type { Settings as SessionSettings } from "./server/protocol";
import { loadSettings, saveSettings, type Settings } from "./settings";
import { ClipSource } from "./sources/clip_source";
import { RecordingSource } from "./sources/recording_source";
import { Headset, missingForHeadset, type Immersion } from "./sources/headset";
import { socketAddress } from "./server/connection";
import type { Source } from "./sources/source";
import { TakeSource } from "./sources/take_source";
import { followedBy, Watching } from "./sources/watching";
import { partOf, type Take } from "./takes/takes";
import { BridgePanel } from "./ui/bridge_panel";
import { CameraPicture } from "./ui/camera_picture";
import { onFiles } from "./ui/drop";
import { onKeys } from "./ui/keys";
import { LookPanel } from "./ui/look_panel";
import { bindPanels } from "./ui/panels";
import { SensorPanel } from "./ui/sensor_panel";
import { showStatus } from "./ui/status";
import { nextTheme, themed } from "./ui/theme";
import { TakePanel } from "./ui/take_panel";
import { Timeline } from "./ui/timeline";
import { YouPanel } from "./ui/you_panel";
import { Bodies } from "./view/bodies";
import type { Look, View } from "./view/scene";
import { VrMenu, type MenuItem } from "./view/vr_menu";
import { addOwn } from "./view/wardrobe";
import { moved, type Worn } from "./wearer/trackers";
import { distancesOf, HEIGHTS, personFrom, personOf, type LengthName, type Person } from "./wearer/wearer";

const FILE_GUIDE =
  "A simulated headset sees this motion, and the rest is completed. Settings choose what it sees; Truth shows the motion itself.";
const NO_INPUT =
  "This server has no input of its own: what you see is the page's performance. Start the server with --replay, --vmc-in or --vmt.";
const FACTS_EVERY = 150; // ms
const LONGEST_STEP = 0.1; // s, longest advance of the timeline between two pictures

export class App {
  private settings: Settings = loadSettings(() => localStorage);
  private source: Source | null = null;
  private awaited: Watching | null = null; // a server whose first body has not arrived yet
  private readonly welcome = element("lead").textContent;
  private readonly first = new FirstPicture(() => this.afterFirst());
  private drawnAt = 0; // ms
  private factsAt = 0; // ms
  private enteredAt = 0; // ms since 1970: when the headset was put on
  private readonly playback = new Playback();
  private readonly measuring = new Measuring((text) => this.say(text));
  private readonly bodies: Bodies;
  private readonly live: Live;
  private readonly takes: TakePanel;
  private readonly timeline: Timeline;
  private readonly look: LookPanel;
  private readonly sensors: SensorPanel;
  private readonly you: YouPanel;
  private readonly menu = new VrMenu(this.menuItems());
  private readonly headset: Headset;
  private readonly bridge: BridgePanel;

  constructor(
    private readonly view: View,
    engine: Engine,
    private readonly files: FirstFiles,
    private readonly base: string,
    private readonly notice: Notice,
  ) {
    const { skeleton, about } = files;
    this.bodies = new Bodies(view.stage);
    this.live = new Live(
      engine,
      skeleton,
      (reason) => this.notice.fault(reason),
      (time, frame) => this.bridge.send(time, frame),
    );
    this.bridge = new BridgePanel(skeleton, (error) => this.fault(error));
    this.live.holdFeet = this.settings.holdFeet;
    this.takes = new TakePanel(this.live.history, skeleton, {
      skeleton: () => this.tree,
      show: (take) => this.attempt(() => this.showTake(take)),
      time: () => this.playback.time - this.live.history.first,
      fault: (error) => this.fault(error),
    });
    this.timeline = new Timeline(this.playback, this.live.history);
    this.look = new LookPanel(
      this.settings,
      (change) => this.change(change),
      (name) => this.bodies.wardrobe.wear(name),
    );
    this.sensors = new SensorPanel(this.settings.sensors, {
      set: (set) => this.simulate(set),
      hidden: (hidden) => {
        this.live.hidden = hidden;
        this.updateServer({ hidden: [...hidden] });
      },
      move: (tracker, joint) => this.wear(moved(this.trackers, this.worn, tracker, joint)),
      name: (tracker, name) => {
        const { [tracker]: _, ...others } = this.settings.trackerNames;
        this.change({ trackerNames: name === "" ? others : { ...others, [tracker]: name } });
      },
    });
    this.you = new YouPanel(this.settings, {
      height: (height) => this.attempt(async () => this.setHeight(height)),
      length: (name, metres) => this.attempt(async () => this.setLength(name, metres)),
      measure: () => this.attempt(async () => this.measure()),
      forget: () => {
        this.know({ measured: null, lengths: {} });
        this.updateServer({ lengths: [] });
      },
      recentre: () => this.recentre(),
      sit: (isSeated) => this.sit(isSeated),
      holdFeet: (holdFeet) => {
        this.change({ holdFeet });
        this.live.hold(holdFeet);
        this.updateServer({ hold_feet: holdFeet });
      },
    });
    this.headset = new Headset(view, this.live, this.menu, {
      tracked: (frame) => {
        this.attempt(async () => this.tracked(frame));
        this.live.track(frame, null);
      },
      left: (wasRequested) => this.afterHeadset(wasRequested),
    });
    this.bind();
    engine.opened.catch((error: unknown) => {
      this.fault(error);
      this.afterFirst();
    });
    this.attempt(async () => {
      await (about.server ? this.watchServer() : this.perform());
      await this.openNamed();
    });
    view.run((milliseconds, frame) => this.draw(milliseconds, frame));
  }

  private bind(): void {
    const repaint = themed(
      () => this.settings.theme,
      (look) => this.paint(look),
    );
    button("theme").onclick = () => {
      this.change({ theme: nextTheme(this.settings.theme) });
      repaint();
    };
    bindPanels(["takes", "settings"]);
    onFiles((files) => this.attempt(() => this.openAll(files)));
    this.offer("open-performance", () => {
      this.notice.clear();
      return this.perform();
    });
    button("open-server").hidden = !this.files.about.server;
    this.offer("open-server", () => this.watchServer());
    this.offer("open-headset", () => this.enterHeadset("immersive-vr"));
    this.offer("open-room", () => this.enterHeadset("immersive-ar"));
    void navigator.xr?.isSessionSupported("immersive-ar").then(
      (isThere) => (button("open-room").hidden = !isThere),
      () => undefined, // a browser that forbids to ask
    );
    button("open-webcam").hidden = !this.files.about.webcam;
    this.offer("open-webcam", () => this.watchWebcam());
    onKeys({
      " ": () => this.playback.toggle(),
      ArrowLeft: () => this.timeline.step(-1),
      ArrowRight: () => this.timeline.step(1),
      l: () => this.playback.goLive(),
      r: () => this.view.reset(),
      c: () => this.recentre(),
    });
  }

  /** A button that opens a source; presses while it is being opened do nothing. */
  private offer(id: string, open: () => Promise<void>): void {
    const control = button(id);
    control.onclick = () => {
      if (control.ariaBusy === "true") return;
      control.ariaBusy = "true";
      this.attempt(() => open().finally(() => (control.ariaBusy = "false")));
    };
  }

  /** The packaged performance, seen by a simulated headset. */
  private async perform(): Promise<void> {
    this.begin(new ClipSource(this.files.performance, this.live, this.settings.sensors, "The page's own performance"));
  }

  private async watchServer(): Promise<void> {
    const events = {
      came: () => {
        if (this.awaited === source) this.begin(source); // else the connection broke in between
      },
      empty: () => {
        if (isWatching) this.say(NO_INPUT);
        else element("lead").textContent = `${NO_INPUT} Or try it yourself:`;
      },
      connected: () => this.notice.clear(),
      notified: (text: string) => this.say(text),
      lost: (reason: string, again: boolean) => this.notice.fault(reason, again ? () => source.first.open() : null),
    };
    const isWatching = this.source !== null;
    if (!isWatching)
      await this.perform(); // until a wearer arrives
    else this.say("Connecting to the server’s input …");
    this.awaited?.stop();
    const source = new Watching(this.base, this.live.history, this.view.stage, events, followedBy(location.hash));
    this.awaited = source;
  }

  private async enterHeadset(mode: Immersion): Promise<void> {
    if (this.headset.isActive) return;
    const missing = await missingForHeadset();
    if (missing) throw new Error(missing);
    await this.headset.enter(mode);
    this.notice.clear(); // notices of an earlier session
    this.menu.say();
    this.begin(this.headset);
    this.enteredAt = Date.now();
    if (this.files.about.server) this.bridge.open(socketAddress({ href: this.base }));
  }

  private async watchWebcam(): Promise<void> {
    const { openWebcam } = await import("./sources/webcam/webcam"); // MediaPipe is fetched when it is wanted
    const before = this.source;
    const picture = new CameraPicture(
      () => this.settings.mirroredWebcam,
      () => this.change({ mirroredWebcam: !this.settings.mirroredWebcam }),
    );
    const source = await openWebcam(this.base, this.live, picture, (text) =>
      text === null ? this.notice.clear() : this.notice.fault(text),
    );
    if (this.source === before) this.begin(source);
    else source.stop?.(); // something else was chosen in the meantime
  }

  /** A take on the stage; null: the performance, for the take is gone. */
  private async showTake(take: Take | null): Promise<void> {
    if (!take) return this.perform();
    const now = (): Take => this.takes.takes.all.find(({ id }) => id === take.id) ?? take;
    this.begin(new TakeSource(now, this.playback));
    this.live.replay(take.frames);
    this.playback.seek(0);
  }

  private begin(source: Source): void {
    this.takes.leave();
    if (this.awaited !== source) this.awaited?.stop();
    this.awaited = null;
    if (this.source !== source) this.source?.stop?.(); // a headset that is put on again is the same source
    this.source = source;
    this.live.begin(this.personOf(source));
    this.measuring.forget();
    this.bodies.clear(); // until the first body arrives
    this.playback.goLive();
    element("lead").textContent = source.guide ?? this.welcome;
    this.sensors.offer(source.sensors, source instanceof ClipSource);
    button("open-performance").hidden = source instanceof ClipSource && source.clip === this.files.performance;
    this.view.reset();
  }

  /** The skeleton of the displayed body. */
  private get tree(): Skeleton {
    return (this.source instanceof Watching ? this.source.first.skeleton : null) ?? this.files.skeleton;
  }

  /** Change settings of the server's session, if one is watched. */
  private updateServer(change: Partial<SessionSettings>): void {
    if (this.source instanceof Watching) this.source.first.updateSettings(change);
  }

  private simulate(sensors: SensorSet): void {
    this.change({ sensors });
    if (!(this.source instanceof ClipSource)) return;
    this.source.set = sensors;
    this.sensors.offer(this.source.sensors, true);
  }

  /** The known measurements of the person that a source tracks; the user's own include the calibration. */
  private personOf({ isYou }: Source): Person {
    const { height, measured, lengths } = this.settings;
    return personFrom(height, isYou ? measured : null, isYou ? lengths : {});
  }

  private setHeight(height: number | null): void {
    personOf(height); // refuses a height that no person has
    this.know({ height });
    this.updateServer({ height });
  }

  private setLength(name: LengthName, metres: number | undefined): void {
    const { [name]: _, ...others } = this.settings.lengths;
    const lengths = metres === undefined ? others : { ...others, [name]: metres };
    const distances = distancesOf(lengths); // refuses a length that no person has
    const { measured } = this.settings;
    this.know({ lengths, ...(name === "reach" && measured ? { measured: { ...measured, reach: null } } : {}) });
    this.updateServer({ lengths: distances.map(({ value, ...ends }) => ({ ...ends, metres: value })) });
  }

  /** Points that are tracked now, and where the strapped trackers among them are worn. */
  private get trackers(): readonly string[] {
    return this.source?.trackers ?? this.source?.sensors ?? [];
  }

  private get worn(): Worn {
    return this.source instanceof Watching ? this.source.first.worn : this.live.worn;
  }

  private wear(worn: Worn): void {
    if (this.source instanceof Watching)
      this.updateServer({ worn: Object.entries(worn).map(([tracker, joint]) => ({ tracker, joint })) });
    else this.live.worn = worn;
  }

  /** Change the known measurements of the user. */
  private know(known: Partial<Pick<Settings, "height" | "measured" | "lengths">>): void {
    this.change(known);
    this.notice.clear(); // of a value that was refused before
    if (this.source) this.live.setPerson(this.personOf(this.source));
    this.you.show(this.settings);
  }

  private measure(): void {
    if (this.source instanceof Watching)
      this.say(
        this.source.first.ask({ type: "calibrate", arms_out: true })
          ? "Stand upright, arms out to the sides, and hold still: the server measures."
          : "You watch another wearer. Only their own page can measure them.",
      );
    else if (this.headset.isSeated)
      throw new Error("You are marked as sitting: switch that off, stand up, and measure.");
    else {
      this.measuring.start();
      this.say(
        this.headset.isActive
          ? "Stand upright, arms out to the sides. You are measured as soon as your head is tracked."
          : "No headset is on, and nothing else measures you. Choose Headset and put it on: you are measured as soon as your head is tracked, upright, arms out to the sides.",
      );
    }
  }

  private recentre(): void {
    if (this.source instanceof Watching) this.source.first.ask({ type: "recentre" });
    else this.headset.recentre();
  }

  private sit(isSeated: boolean): void {
    this.updateServer({ posture: isSeated ? "seated" : "standing" });
    this.headset.sit(isSeated);
    this.you.showSeated(isSeated);
  }

  /** One frame of the headset. */
  private tracked(frame: Observation): void {
    const measured = this.measuring.take(frame);
    if (!measured) return;
    const { reach: _, ...lengths } = this.settings.lengths;
    this.know({ height: null, measured, lengths: measured.reach === null ? this.settings.lengths : lengths });
    this.say("You are measured.");
  }

  private menuItems(): MenuItem[] {
    const taller = (by: number): void => this.attempt(async () => this.setHeight(this.tallerBy(by)));
    const known = (height: number | null): string => (height === null ? "measured" : `${height.toFixed(2)} m`);
    const isRecording = (): boolean => this.takes.takes.isRecording;
    return [
      { text: () => "Measure me", press: () => this.attempt(async () => this.measure()) },
      { text: () => `Taller · ${known(this.settings.height)}`, press: () => taller(0.01) },
      { text: () => "Shorter", press: () => taller(-0.01) },
      { text: () => "Recentre", press: () => this.headset.recentre() },
      {
        text: () => "I am sitting",
        isOn: () => this.headset.isSeated,
        press: () => this.sit(!this.headset.isSeated),
      },
      {
        text: () => "Mirror",
        isOn: () => this.headset.isMirrorVisible,
        press: () => this.headset.showMirror(!this.headset.isMirrorVisible),
      },
      { text: () => `Look · ${this.lookName ?? "figure"}`, press: () => this.showNext() },
      {
        text: () => (isRecording() ? "Stop recording" : "Record a take"),
        isOn: isRecording,
        press: () => this.takes.takes.toggle(),
      },
      { text: () => "Leave VR", press: () => this.headset.stop() },
    ];
  }

  /** The height of the displayed body, or else the set height, plus `metres` more. */
  private tallerBy(metres: number): number {
    const height = Math.round(100 * ((this.settings.height ?? stature(this.live.tree)) + metres)) / 100;
    return Math.min(Math.max(height, HEIGHTS.least), HEIGHTS.most);
  }

  /** Avatar and motion that the page's address names: `?motion=URL&avatar=URL`. */
  private async openNamed(): Promise<void> {
    const named = new URLSearchParams(location.search);
    for (const address of ["avatar", "motion"].flatMap((kind) => named.get(kind) ?? [])) {
      const { fileAt } = await import("./files/open");
      await this.open(await fileAt(address, this.base));
    }
  }

  /** Open files one after another: a motion may be dropped together with the avatar that moves by it. */
  private async openAll(files: readonly File[]): Promise<void> {
    for (const file of files) await this.open(file);
  }

  private async open(file: File): Promise<void> {
    const { openFile } = await import("./files/open");
    const opened = await openFile(file, this.files.skeleton);
    this.notice.clear();
    if (opened.kind === "motion")
      this.begin(new ClipSource(opened.clip, this.live, this.settings.sensors, file.name, FILE_GUIDE));
    else if (opened.kind === "recording") this.begin(new RecordingSource(opened.frames, this.live, file.name));
    else {
      this.bodies.wardrobe.add(file.name, opened.avatar);
      this.change({ figure: "avatar" });
    }
  }

  /** The displayed avatar; null: the figure. */
  private get lookName(): string | null {
    return this.settings.figure === "avatar" ? this.bodies.wardrobe.currentName : null;
  }

  /** One avatar after the other, then the figure. */
  private showNext(): void {
    const { wardrobe } = this.bodies;
    const looks = [...wardrobe.names, null];
    const next = looks[(looks.indexOf(this.lookName) + 1) % looks.length];
    if (next !== null) wardrobe.wear(next);
    this.change({ figure: next === null ? "figure" : "avatar" });
  }

  /** Begin what the first picture of a completed body does not wait for; at once if there is no network. */
  private afterFirst(): void {
    this.attempt(() => addOwn(this.bodies.wardrobe, this.base));
    workOffline(this.files.about, this.base);
  }

  private afterHeadset(wasRequested: boolean): void {
    const { takes } = this.takes;
    takes.end();
    this.measuring.stop();
    const take = takes.all.find(({ id }) => id >= this.enteredAt);
    const kept = take ? ` Your take of ${partOf(take)[1].toFixed(1)} s is kept: it is under Takes.` : "";
    if (take) this.playback.seek(take.frames[0].time);
    this.playback.playing = true;
    if (wasRequested) this.say(`You are back.${kept}`);
    else this.notice.fault(`The headset is off.${kept}`);
  }

  private say(text: string): void {
    this.notice.say(text);
    this.menu.say(text);
  }

  private fault(error: unknown): void {
    this.notice.fault(reasonOf(error));
    this.menu.say(reasonOf(error));
  }

  private change(change: Partial<Settings>): void {
    this.settings = { ...this.settings, ...change };
    this.attempt(async () => saveSettings(() => localStorage, this.settings));
  }

  private paint(look: Look): void {
    const { theme } = this.settings;
    this.view.paint(look);
    button("theme").textContent = { auto: "◐ Auto", light: "◐ Light", dark: "◐ Dark" }[theme];
    button("theme").setAttribute("aria-label", `Theme: ${theme}; change it`);
  }

  /** Report an error in one line. */
  private attempt(what: () => Promise<void>): void {
    void what().catch((error: unknown) => this.fault(error));
  }

  private draw(milliseconds: number, frame: XRFrame | undefined): void {
    const passed = (milliseconds - this.drawnAt) / 1000;
    const seconds = Math.min(passed, LONGEST_STEP);
    this.drawnAt = milliseconds;
    const mirror = this.source?.isWebcam ? "mirroredWebcam" : "mirrored";
    const side = this.settings[mirror] ? -1 : 1;
    this.view.stage.scale.x = side;
    this.source?.frame?.(milliseconds, frame);
    const moment = this.playback.step(this.live.history, seconds);
    if (!this.source) return;
    if (this.source.isAbsent && this.playback.live) this.bodies.clear();
    else if (moment) {
      this.first.draw(moment);
      // Ghosts show the devices of others, and only on the page: you know what you wear.
      // The first picture does not wait for them.
      const ghosts = this.settings.ghosts && !this.source.isYou && !this.view.isClear && this.first.isMoving;
      const display = { ...this.settings, ghosts };
      this.bodies.show(moment, this.tree, display, seconds);
      if (!this.headset.isActive) this.view.follow(side * moment.rootPosition[0], moment.rootPosition[2], passed);
    }
    if (milliseconds - this.factsAt < FACTS_EVERY) return;
    this.factsAt = milliseconds;
    this.sensors.offer(this.source.sensors, this.source instanceof ClipSource);
    this.sensors.list(this.trackers, this.worn, this.settings.trackerNames);
    this.you.showBody(this.source instanceof Watching ? this.tree : this.live.tree);
    this.timeline.show();
    this.takes.draw();
    this.look.show(this.settings, mirror, this.bodies.wardrobe, (moment?.truth ?? null) !== null);
    const title =
      this.live.isReady || this.source instanceof Watching ? this.source.title : "Loading the neural network";
    showStatus(this.live, moment, this.tree, title);
  }
}
