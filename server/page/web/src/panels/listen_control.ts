import { byId, setAttribute, setHidden, setText } from "../dom";
import { count } from "../format";
import type { Listening } from "../sound/listening";
import type { Notices } from "./notices";

export interface SoundSource {
  sampleRate: number;
  channels: number;
}

/** The Listen button, the volume beside it, and how the sound gets here. */
export class ListenControl {
  private readonly button = byId<HTMLButtonElement>("listen");
  private readonly label = byId("listen-label");
  private readonly facts = byId("listening-facts");
  private readonly volume = byId<HTMLInputElement>("volume");
  private readonly volumeField = byId("volume-field");
  private source: SoundSource | null = null;
  private mayListen = false;

  constructor(
    private readonly listening: Listening,
    private readonly notices: Notices,
    private readonly changed: () => void,
  ) {
    this.button.addEventListener("click", () => void this.toggle());
    this.volume.addEventListener("input", () => this.setVolume());
  }

  /** What is to be heard: another rate or number of channels needs another way to the loudspeaker. */
  setSource(source: SoundSource, mayListen: boolean): void {
    const before = this.source;
    this.source = source;
    this.mayListen = mayListen;
    this.button.disabled = !mayListen;
    this.button.title = mayListen ? "" : "This needs a key that may listen: give it under Daemon.";
    if (this.listening.on && !mayListen) this.listening.stop();
    else if (this.listening.on && (source.sampleRate !== before?.sampleRate || source.channels !== before.channels)) {
      this.listening.stop();
      void this.start(source);
    }
    this.show();
  }

  /** Four times a second. */
  update(): void {
    const { on, ring, latency_ms } = this.listening.state();
    if (!on) {
      setText(this.facts, this.source && !this.mayListen ? "Needs a key that may listen" : "Muted: press Listen to hear it");
      return;
    }
    if (!ring || !this.source) {
      setText(this.facts, "Waiting for sound");
      return;
    }
    const parts = [ring.played === 0 ? "Waiting for sound" : `Heard ${latency_ms?.toFixed(0) ?? "–"} ms after it came`];
    const rate = this.source.sampleRate;
    parts.push(ring.underruns === 1 ? "1 gap" : `${count(ring.underruns)} gaps`);
    if (ring.missing > 0) parts.push(`${((1000 * ring.missing) / rate).toFixed(0)} ms never came`);
    if (ring.skipped > 0) parts.push(`${((1000 * ring.skipped) / rate).toFixed(0)} ms skipped to catch up`);
    setText(this.facts, parts.join(" · "));
  }

  private async toggle(): Promise<void> {
    if (this.listening.on) this.listening.stop();
    else if (this.source) await this.start(this.source);
    this.show();
    this.changed();
  }

  private async start({ sampleRate, channels }: SoundSource): Promise<void> {
    this.setVolume();
    const started = this.listening.start(sampleRate, channels);
    this.show();
    this.changed();
    try {
      await started;
    } catch (error) {
      this.notices.show(`No sound here: ${error instanceof Error ? error.message : String(error)}`, "error");
    }
  }

  private setVolume(): void {
    // Ears hear decibels: the slider's lower half is not all but silence.
    this.listening.setVolume(Number(this.volume.value) ** 2);
    this.volume.style.setProperty("--filled", `${100 * Number(this.volume.value)}%`);
    setAttribute(this.volume, "aria-valuetext", `${Math.round(100 * Number(this.volume.value))} %`);
  }

  private show(): void {
    const on = this.listening.on;
    setAttribute(this.button, "aria-pressed", String(on));
    setText(this.label, on ? "Listening" : "Listen");
    setHidden(this.volumeField, !on);
    this.update();
  }
}
