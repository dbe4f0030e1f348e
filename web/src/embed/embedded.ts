/** The page inside another one (`?embed`): a body that plays a motion, steered by messages, without controls. */

import type { EmbedCommand, EmbedEvent } from "@bodysense/core/embed";
import type { Skeleton } from "../body/skeleton";
import type { Embedder } from "./embedder";
import type { Engine } from "../engine/engine";
import type { FirstFiles } from "../first";
import { History, type Moment } from "../takes/history";
import { Live } from "../live";
import { reasonOf, type Notice } from "../notice";
import { DEFAULT_SETTINGS } from "../settings";
import { ClipSource } from "../sources/clip_source";
import { RecordingSource } from "../sources/recording_source";
import { themed } from "../ui/theme";
import { Bodies } from "../view/bodies";
import type { View } from "../view/scene";
import { addOwn } from "../view/wardrobe";
import { NOBODY } from "../wearer/wearer";

const EARLY = 1e-3; // s: rounding of times
const LATE = 0.5; // s after the end: a frame of the next round

const DISPLAY = { ...DEFAULT_SETTINGS, ghosts: false }; // the motion alone, without devices

type Played = ClipSource | RecordingSource;

export class EmbeddedPage {
  private readonly skeleton: Skeleton;
  private readonly bodies: Bodies;
  private readonly live: Live;
  private readonly turns = { motion: 0, avatar: 0 }; // how often each was loaded: the newest counts
  private source: Played | null = null;
  private drawn: Moment | null = null;
  private drawnAt = 0; // ms
  private endsAt: number | null = null; // clock of observations: the motion's end, until it is drawn

  constructor(
    private readonly view: View,
    engine: Engine,
    { skeleton, performance }: FirstFiles,
    private readonly base: string,
    private readonly notice: Notice,
    private readonly embedder: Embedder,
  ) {
    this.skeleton = skeleton;
    this.bodies = new Bodies(view.stage);
    this.live = new Live(engine, skeleton, (reason) => this.fault(reason), undefined, new History(2));
    themed(
      () => "auto",
      (look) => view.paint(look),
    );
    view.letScroll();
    const named = new URLSearchParams(location.search);
    const [motion, avatar] = [named.get("motion"), named.get("avatar")];
    this.attempt(async () => {
      await engine.opened;
      embedder.listen(
        (command) => this.obey(command),
        (error) => this.fault(reasonOf(error)),
      );
      embedder.send({ bodysense: "ready" });
      if (avatar === null) this.attempt(() => addOwn(this.bodies.wardrobe, base));
      else this.load("avatar", avatar);
      if (motion !== null) this.load("motion", motion);
      else if (this.turns.motion === 0)
        this.begin(new ClipSource(performance, this.live, "hands", performance.name, undefined, this.ended));
    });
    view.run((milliseconds) => this.draw(milliseconds));
  }

  private obey(command: EmbedCommand): void {
    const rounds = this.source?.rounds;
    switch (command.bodysense) {
      case "hello":
        return this.embedder.send({ bodysense: "ready" });
      case "play":
        rounds?.play(command.repeat ?? true);
        return this.sendTime();
      case "pause":
        rounds?.pause();
        return this.sendTime();
      case "seek":
        return rounds?.seek(command.time);
      case "background":
        document.documentElement.dataset["background"] = command.transparent ? "transparent" : "";
        return this.view.clear(command.transparent);
      case "load":
        if (command.avatar !== undefined) this.load("avatar", command.avatar);
        if (command.motion !== undefined) this.load("motion", command.motion);
    }
  }

  private load(part: "motion" | "avatar", given: string | File): void {
    const turn = ++this.turns[part];
    const isNewest = (): boolean => turn === this.turns[part];
    this.attempt(async () => {
      const { fileAt, openFile } = await import("../files/open");
      const file = typeof given === "string" ? await fileAt(given, this.base) : given;
      const opened = await openFile(file, this.skeleton);
      if (!isNewest()) return;
      if (opened.kind === "avatar") {
        this.bodies.wardrobe.add(file.name, opened.avatar);
        this.embedder.send({ bodysense: "loaded", kind: "avatar", name: file.name });
      } else if (opened.kind === "motion")
        this.begin(new ClipSource(opened.clip, this.live, "hands", file.name, undefined, this.ended));
      else this.begin(new RecordingSource(opened.frames, this.live, file.name, this.ended));
    }, isNewest);
  }

  private begin(source: Played): void {
    this.source = source;
    this.endsAt = null;
    this.notice.clear();
    this.live.begin(NOBODY);
    this.bodies.clear(); // until the first body arrives
    const kind = source instanceof ClipSource ? "motion" : "recording";
    this.embedder.send({ bodysense: "loaded", kind, name: source.title, seconds: source.rounds.length });
  }

  private readonly ended = (clock: number): void => {
    this.endsAt = clock;
  };

  private draw(milliseconds: number): void {
    const seconds = Math.min((milliseconds - this.drawnAt) / 1000, 0.1);
    this.drawnAt = milliseconds;
    this.source?.frame(milliseconds);
    const moment = this.live.history.moments.at(-1);
    if (!moment || !this.source) return;
    this.bodies.show(moment, this.skeleton, DISPLAY, seconds);
    this.view.follow(moment.rootPosition[0], moment.rootPosition[2], seconds);
    if (moment !== this.drawn) this.report(moment, this.source);
    this.drawn = moment;
  }

  private report({ sourceTime }: Moment, { rounds }: Played): void {
    const time = rounds.timeAt(sourceTime);
    const after = this.endsAt === null ? -1 : sourceTime - this.endsAt + EARLY; // s
    const events: EmbedEvent[] = time === null ? [] : [{ bodysense: "time", time, playing: rounds.isPlaying }];
    if (after >= 0) {
      this.endsAt = null;
      const isLast = after < LATE; // else it is the first of the next round
      events.splice(isLast ? 1 : 0, 0, { bodysense: "ended" });
    }
    for (const event of events) this.embedder.send(event);
  }

  /** Send the time, and whether the motion plays. */
  private sendTime(): void {
    if (!this.source) return;
    const { time, isPlaying } = this.source.rounds;
    this.embedder.send({ bodysense: "time", time, playing: isPlaying });
  }

  private fault(reason: string): void {
    this.notice.fault(reason);
    this.embedder.send({ bodysense: "error", reason });
  }

  /** Do something that may fail; a failure that no longer matters is not reported. */
  private attempt(what: () => Promise<void>, matters: () => boolean = () => true): void {
    void what().catch((error: unknown) => matters() && this.fault(reasonOf(error)));
  }
}
