import { create, setAttribute, setHidden, setText } from "../dom";
import { decibels } from "../format";
import type { SessionFigures } from "../wire/messages";

const LOWEST_DB = -60;
const HIGHEST_DB = 24;
const SEND_EVERY_MS = 50;
/** The daemon's word is not taken for so long after a move: it may be older than the move. */
const OWN_FOR_MS = 700;
const NAMES: Record<string, string> = { master: "All", crumpling: "Crumpling", friction: "Friction", tearing: "Tearing" };

class Slider {
  readonly object = create("div", "gain");
  readonly input = create("input");
  private readonly value = create("output", "gain-value");
  private readonly reset = create("button", "quiet small gain-reset", "0");
  private movedAt = -1e9;
  private sentAt = -1e9;
  private timer = 0;

  constructor(
    readonly kind: string,
    private readonly send: (db: number | null) => void,
  ) {
    const id = `gain-${kind}`;
    const name = NAMES[kind] ?? kind;
    const label = create("label", "gain-name", name);
    label.htmlFor = id;
    Object.assign(this.input, { id, type: "range", min: String(LOWEST_DB), max: String(HIGHEST_DB), step: "0.5", value: "0" });
    this.reset.type = "button";
    this.reset.setAttribute("aria-label", `${name} back to 0 dB`);
    this.input.addEventListener("input", () => this.moved());
    this.reset.addEventListener("click", () => {
      this.input.value = "0";
      this.moved();
    });
    this.object.append(label, this.input, this.value, this.reset);
    this.tell(0);
  }

  setEnabled(enabled: boolean): void {
    if (this.input.disabled === !enabled) return;
    this.input.disabled = !enabled;
    this.reset.disabled = !enabled;
  }

  /** As the daemon has it. */
  show(db: number | null): void {
    if (performance.now() - this.movedAt < OWN_FOR_MS) return;
    const shown = String(Math.max(db ?? LOWEST_DB, LOWEST_DB));
    if (this.input.value !== shown) this.input.value = shown;
    this.tell(db);
  }

  private moved(): void {
    this.movedAt = performance.now();
    this.tell(this.chosen());
    window.clearTimeout(this.timer);
    const wait = SEND_EVERY_MS - (this.movedAt - this.sentAt);
    if (wait <= 0) this.sendNow();
    else this.timer = window.setTimeout(() => this.sendNow(), wait);
  }

  private sendNow(): void {
    this.sentAt = performance.now();
    this.send(this.chosen());
  }

  /** The slider's lower end is silence. */
  private chosen(): number | null {
    const db = Number(this.input.value);
    return db > LOWEST_DB ? db : null;
  }

  private tell(db: number | null): void {
    const text = decibels(db);
    setText(this.value, text);
    setAttribute(this.input, "aria-valuetext", text);
    this.reset.classList.toggle("idle", db === 0);
    const at = (100 * (Number(this.input.value) - LOWEST_DB)) / (HIGHEST_DB - LOWEST_DB);
    const filled = `${at.toFixed(1)}%`;
    if (this.input.style.getPropertyValue("--filled") !== filled) this.input.style.setProperty("--filled", filled);
  }
}

/** A slider for each kind of sound of the watched session, and one for all. */
export class GainsPanel {
  private readonly sliders = new Map<string, Slider>();
  private session: string | null = null;
  private enabled = false;

  constructor(
    private readonly into: HTMLElement,
    private readonly lock: HTMLElement,
    private readonly reason: HTMLElement,
    private readonly send: (session: string, kind: string, db: number | null) => void,
  ) {
    for (const kind of Object.keys(NAMES)) this.add(kind);
  }

  /** Without a reason they may be moved. */
  setReadOnly(reason: string | null): void {
    this.enabled = reason === null;
    setHidden(this.lock, this.enabled);
    setHidden(this.reason, this.enabled);
    setText(this.reason, reason ?? "");
    setAttribute(this.into, "aria-describedby", reason ? this.reason.id : null);
    this.applyEnabled();
  }

  update(session: SessionFigures | null): void {
    this.session = session?.id ?? null;
    const gains = session?.gains_db ?? {};
    for (const kind of Object.keys(gains)) if (!this.sliders.has(kind)) this.add(kind);
    for (const [kind, slider] of this.sliders) slider.show(gains[kind] === undefined ? 0 : gains[kind]);
    this.applyEnabled();
  }

  private applyEnabled(): void {
    for (const slider of this.sliders.values()) slider.setEnabled(this.enabled && this.session !== null);
  }

  private add(kind: string): Slider {
    const slider = new Slider(kind, (db) => {
      if (this.session !== null) this.send(this.session, kind, db);
    });
    this.sliders.set(kind, slider);
    this.into.append(slider.object);
    return slider;
  }
}
