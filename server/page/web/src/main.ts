import { byId, setAttribute, setHidden, setText } from "./dom";
import { count } from "./format";
import { SpectrogramAxes } from "./panels/axes";
import { GainsPanel } from "./panels/gains_panel";
import { Guidance } from "./panels/guidance";
import { KeyForm } from "./panels/key_form";
import { buildLegend } from "./panels/legend";
import { ListenControl, type SoundSource } from "./panels/listen_control";
import { ListenerNumbers } from "./panels/listener_numbers";
import { Losses } from "./panels/losses";
import { Notices } from "./panels/notices";
import { SessionList } from "./panels/session_list";
import { Vitals } from "./panels/vitals";
import { ListenerHandle } from "./scene/listener_handle";
import { SceneView } from "./scene/scene_view";
import { LevelMeter } from "./sound/level_meter";
import { Listening } from "./sound/listening";
import { Spectrogram } from "./sound/spectrogram";
import { onTheme, toggleTheme } from "./theme";
import { Watching } from "./watching";
import type { BinaryMessage } from "./wire/binary";
import { Connection } from "./wire/connection";
import type { Figures, Hello, Rights, Scene, ServerMessage, SessionFigures } from "./wire/messages";

const WIRE_VERSION = 1;
const OTHER_VERSION = "The daemon and this page are not of the same version: load the page again.";
const NO_RIGHTS: Rights = { listen: false, change: false };

/** Puts the page's parts together: messages go to who shows them, what the reader does goes to the daemon. */
class Page {
  private hello: Hello | null = null;
  private figures: Figures | null = null;
  private sceneInfo: Scene | null = null;
  private connected = false;
  private greeted = false;
  private soundVisible = true;
  private shownRights = NO_RIGHTS;
  private framesBefore = 0;
  private framesAt = performance.now();
  private frameRate = 0;

  private readonly connection = new Connection(liveUrl(), {
    open: () => this.onOpen(),
    lost: (retryInSeconds) => this.onLost(retryInSeconds),
    message: (message) => this.onMessage(message),
    binary: (message) => this.onBinary(message),
    unreadable: () => this.notices.show(OTHER_VERSION, "error"),
  });
  private readonly notices = new Notices(byId("notices"));
  private readonly view = new SceneView(byId<HTMLCanvasElement>("scene"));
  private readonly listener = new ListenerHandle(this.view, byId("stage"), (position) => {
    if (this.watching.session !== null) this.connection.send({ type: "listener", session: this.watching.session, position });
  });
  private readonly numbers = new ListenerNumbers((position) => this.listener.move(position));
  private readonly spectrogram = new Spectrogram(byId<HTMLCanvasElement>("spectrogram"));
  private readonly axes = new SpectrogramAxes(byId("frequency-axis"), byId("time-axis"));
  private readonly meter = new LevelMeter(byId("meter-bars"), byId("meter-peak"), byId("meter-rms"));
  private readonly listening = new Listening();
  private readonly listenControl = new ListenControl(this.listening, this.notices, () => this.askForSound());
  private readonly vitals = new Vitals();
  private readonly guidance = new Guidance();
  private readonly losses = new Losses(byId("losses"), byId("losses-total"));
  private readonly gains = new GainsPanel(byId("gains"), byId("gains-lock"), byId("change-reason"), (session, kind, db) =>
    this.connection.send({ type: "gain", session, kind, db }),
  );
  private readonly keyForm = new KeyForm((secret) => {
    if (!this.connection.send({ type: "key", secret })) this.notices.show("Not connected: the key is sent as soon as the daemon is back.", "warning");
  });
  private readonly watching = new Watching(
    (message) => this.connection.send(message),
    () => this.onWatched(),
  );
  private readonly sessions = new SessionList(
    byId("session-list"),
    byId<HTMLInputElement>("session-search"),
    byId("session-count"),
    byId("session-none"),
    (id) => {
      const session = this.figures?.sessions.find((one) => one.id === id);
      if (session) this.watching.choose(session);
    },
  );

  start(): void {
    buildLegend(byId("legend"), (layer, shown) => this.view.showLayer(layer, shown));
    byId("fit").addEventListener("click", () => this.view.lookAgain());
    const theme = byId("theme");
    theme.addEventListener("click", toggleTheme);
    onTheme((dark) => setAttribute(theme, "aria-label", dark ? "Light colours" : "Dark colours"));
    this.listener.onMove((position) => this.numbers.show(position));
    document.addEventListener("visibilitychange", () => {
      this.watching.setPageVisible(!document.hidden);
      this.askForSound();
    });
    new IntersectionObserver(([entry]) => {
      this.soundVisible = entry?.isIntersecting ?? true;
      this.askForSound();
    }).observe(byId("spectrogram-frame"));
    setHidden(byId("scene-none"), this.view.works);
    this.applyRights();
    this.sessions.update([]);
    this.losses.update(null);
    this.connection.connect();
    const draw = (time: number) => {
      this.draw(time / 1000);
      requestAnimationFrame(draw);
    };
    requestAnimationFrame(draw);
  }

  private draw(now_s: number): void {
    if (this.view.draw(now_s)) this.listener.follow();
    this.spectrogram.draw();
    this.meter.draw(now_s);
  }

  private onOpen(): void {
    this.connected = true;
    this.greeted = false;
    setHidden(byId("banner"), true);
    document.body.classList.remove("lost");
    this.applyRights();
    this.watching.connected();
    this.keyForm.again();
  }

  private onLost(retryInSeconds: number): void {
    const banner = byId("banner");
    const what = this.connected || this.figures ? "The connection to the daemon was lost" : "The daemon does not answer";
    this.connected = false;
    setText(banner, `${what}: reconnecting in ${retryInSeconds < 1 ? "a moment" : `${retryInSeconds} s`}. Is rustled running?`);
    setHidden(banner, false);
    document.body.classList.add("lost");
    this.applyRights();
  }

  private onMessage(message: ServerMessage): void {
    switch (message.type) {
      case "hello":
        this.welcome(message.rights);
        this.hello = message;
        this.vitals.hello(message);
        if (message.version !== WIRE_VERSION) this.notices.show(OTHER_VERSION, "error");
        this.applyRights();
        break;
      case "figures":
        this.figures = message;
        this.watching.update(message.sessions);
        this.showFigures(message);
        break;
      case "scene":
        if (message.session !== this.watching.session) break;
        this.sceneInfo = message;
        this.view.keepSheets(new Set(message.sheets.map(({ index }) => index)));
        this.view.setObstacles(message.obstacles);
        this.listener.show(message.listener);
        this.applyRights();
        break;
      case "events":
        if (message.session === this.watching.session) this.view.addEvents(message);
        break;
      case "notice":
        this.notices.show(message.text, message.level);
    }
  }

  /** The second hello of a connection says that the key was let in. */
  private welcome(rights: Rights): void {
    const known = this.greeted;
    this.greeted = true;
    if (!known) return;
    this.notices.clear();
    const may = rights.change ? "listen to sessions and change them" : rights.listen ? "listen to sessions" : "listen to its own sessions and change them";
    this.notices.show(`The key was let in: it may ${may}.`, "info");
  }

  private onBinary(message: BinaryMessage): void {
    switch (message.kind) {
      case "topology":
        return this.view.setTopology(message);
      case "frame":
        return this.view.setFrame(message);
      case "obstacle":
        return this.view.setObstacle(message);
      case "pcm":
        this.listening.play(message);
        this.spectrogram.add(message);
        this.meter.add(message, performance.now() / 1000, this.source().sampleRate);
    }
  }

  private onWatched(): void {
    this.sceneInfo = null;
    this.view.clear();
    this.listener.show(null);
    this.spectrogram.clear();
    this.meter.clear();
    this.sessions.setWatched(this.watching.session);
    if (this.figures) this.showFigures(this.figures);
    this.applyRights();
  }

  /** Of the watched session; what the key may at all where there is none. */
  private rights(): Rights {
    return this.watched()?.rights ?? this.hello?.rights ?? NO_RIGHTS;
  }

  private source(): SoundSource {
    const of = this.watched() ?? this.hello;
    return { sampleRate: of?.sample_rate ?? 48000, channels: of?.channels ?? 2 };
  }

  private watched(): SessionFigures | null {
    return this.figures?.sessions.find(({ id }) => id === this.watching.session) ?? null;
  }

  private showFigures(figures: Figures): void {
    const session = this.watched();
    const rights = this.rights();
    if (rights.change !== this.shownRights.change || rights.listen !== this.shownRights.listen) this.applyRights();
    this.vitals.update(figures);
    this.sessions.update(figures.sessions);
    this.losses.update(session);
    this.gains.update(session);
    this.guidance.show(figures.sessions.length === 0);
    this.meter.addFigures(session?.peak_db ?? null, session?.rms_db ?? null, performance.now() / 1000);
    this.listenControl.update();
    this.axes.update(this.spectrogram);
    this.showScene(session);
    this.view.keepInSight(performance.now() / 1000);
  }

  private showScene(session: SessionFigures | null): void {
    const now = performance.now();
    if (now - this.framesAt > 900) {
      this.frameRate = (1000 * (this.view.framesShown - this.framesBefore)) / (now - this.framesAt);
      this.framesBefore = this.view.framesShown;
      this.framesAt = now;
    }
    setText(byId("watched-name"), session ? session.name || session.id : "No session");
    const title = session ? `${session.name || session.id} · Rustle` : "Rustle";
    if (document.title !== title) document.title = title;
    setText(byId("scene-facts"), session ? this.sceneFacts(session) : "");
    const square = this.view.gridSquare_m;
    setText(byId("grid-size"), square > 0 && session ? `1 square = ${square < 1 ? `${+(100 * square).toPrecision(1)} cm` : `${square} m`}` : "");
  }

  private sceneFacts(session: SessionFigures): string {
    const sheets = this.sceneInfo?.sheets ?? [];
    const time_s = this.view.shownTime_s();
    if (time_s === null) return "Waiting for the first frame";
    const materials = [...new Set(sheets.map(({ material }) => material).filter(Boolean))].join(", ");
    const triangles = sheets.reduce((sum, sheet) => sum + sheet.triangles, 0);
    const parts = [materials, `${count(triangles)} triangles`, session.voices === 1 ? "1 voice" : `${count(session.voices)} voices`, `${time_s.toFixed(1)} s`, `${this.frameRate.toFixed(0)} frames/s`];
    if (session.clock === "live" && session.playout_delay_ms > 0) parts.push(`sounds ${session.playout_delay_ms.toFixed(0)} ms later`);
    return parts.filter(Boolean).join(" · ");
  }

  private askForSound(): void {
    const mayListen = this.rights().listen;
    this.watching.setSoundWanted(mayListen && (this.listening.on || (this.soundVisible && !document.hidden)));
  }

  private applyRights(): void {
    const rights = this.rights();
    this.shownRights = rights;
    const mayChange = this.connected && rights.change;
    const reason = mayChange ? null : this.readOnlyReason();
    this.gains.setReadOnly(reason);
    const listenerKnown = Boolean(this.sceneInfo?.listener);
    this.listener.setMovable(mayChange, reason ?? "");
    let hint = "Drag it in the scene, or focus it and press arrow keys and Page Up or Down. Shift: 10 cm.";
    if (!mayChange) hint = reason ?? "";
    if (!listenerKnown) hint = this.watching.session ? "This session has not said where it is heard from." : "Shown with a session.";
    this.numbers.setState(mayChange && listenerKnown, hint);
    const none = byId("spectrogram-none");
    if (this.hello) {
      const source = this.source();
      this.listenControl.setSource(source, rights.listen);
      this.spectrogram.setSampleRate(source.sampleRate);
    }
    setHidden(none, !this.hello || rights.listen);
    setText(none, "The spectrogram needs a key that may listen.");
    this.askForSound();
  }

  private readOnlyReason(): string {
    if (!this.hello || !this.connected) return "Read-only until the daemon answers.";
    return this.hello.needs_key
      ? "Read-only. Give a key that may change sessions under Daemon."
      : "Read-only: this daemon lets pages look, not change.";
  }
}

function liveUrl(): string {
  const url = new URL("live", document.baseURI);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  return url.href;
}

new Page().start();
