import { create, setAttribute, setText } from "../dom";
import { dbfs } from "../format";
import type { Pcm } from "../wire/binary";

const LOWEST_DB = -72;
const FALL_DB_PER_S = 24;
const HOLD_S = 1.6;
const RMS_S = 0.3;
const TELL_EVERY_S = 0.25;

class Channel {
  readonly object = create("div", "meter-channel");
  readonly bar = create("div", "meter-peak");
  readonly body = create("div", "meter-rms");
  readonly mark = create("div", "meter-hold");
  peak_db = -200;
  hold_db = -200;
  heldUntil = 0;
  meanSquare = 0;

  constructor() {
    this.object.append(this.bar, this.body, this.mark);
  }
}

/** Peak, its hold, and the mean of 0.3 s of every channel, in dBFS. Moved by transforms: no layout. */
export class LevelMeter {
  private readonly channels: Channel[] = [];
  private advancedAt = 0;
  private toldAt = 0;
  private lastPcmAt = -1e9;
  private dirty = false;

  constructor(
    private readonly bars: HTMLElement,
    private readonly peakText: HTMLElement,
    private readonly rmsText: HTMLElement,
  ) {
    this.setChannels(2);
  }

  setChannels(count: number): void {
    if (count === this.channels.length) return;
    this.channels.splice(0, this.channels.length, ...Array.from({ length: count }, () => new Channel()));
    this.bars.replaceChildren(...this.channels.map(({ object }) => object));
  }

  add(pcm: Pcm, now: number, sampleRate: number): void {
    this.setChannels(pcm.channels);
    this.lastPcmAt = now;
    const keep = Math.exp(-pcm.frames / (RMS_S * sampleRate));
    this.channels.forEach((channel, c) => {
      let peak = 0;
      let sum = 0;
      for (let i = c; i < pcm.samples.length; i += pcm.channels) {
        const value = Math.abs(pcm.samples[i]!);
        if (value > peak) peak = value;
        sum += value * value;
      }
      this.take(channel, 20 * Math.log10(peak + 1e-10), now);
      channel.meanSquare = keep * channel.meanSquare + (1 - keep) * (sum / Math.max(1, pcm.frames));
    });
  }

  /** What the daemon measured, where its sound does not come here. */
  addFigures(peak_db: number | null, rms_db: number | null, now: number): void {
    if (now - this.lastPcmAt < 1) return;
    for (const channel of this.channels) {
      this.take(channel, peak_db ?? -200, now);
      channel.meanSquare = 10 ** ((rms_db ?? -200) / 10);
    }
  }

  clear(): void {
    for (const channel of this.channels) Object.assign(channel, { peak_db: -200, hold_db: -200, meanSquare: 0 });
    this.dirty = true;
  }

  /** [once a display frame] */
  draw(now: number): void {
    const passed = Math.min(now - this.advancedAt, 1);
    this.advancedAt = now;
    let loudest = -200;
    let mean = 0;
    for (const channel of this.channels) {
      loudest = Math.max(loudest, channel.hold_db);
      mean = Math.max(mean, channel.meanSquare);
      if (channel.peak_db <= LOWEST_DB && channel.hold_db <= LOWEST_DB && !this.dirty) continue;
      channel.peak_db -= FALL_DB_PER_S * passed;
      if (now > channel.heldUntil) channel.hold_db -= FALL_DB_PER_S * passed;
      channel.bar.style.transform = `scaleY(${height(channel.peak_db).toFixed(3)})`;
      channel.body.style.transform = `scaleY(${height(10 * Math.log10(channel.meanSquare + 1e-20)).toFixed(3)})`;
      channel.mark.style.transform = `translateY(${channel.hold_db > LOWEST_DB ? (-100 * height(channel.hold_db)).toFixed(1) : 100}%)`;
    }
    this.dirty = false;
    if (now - this.toldAt < TELL_EVERY_S) return;
    this.toldAt = now;
    if (now - this.lastPcmAt > 1) for (const channel of this.channels) channel.meanSquare *= 0.5;
    const mean_db = 10 * Math.log10(mean + 1e-20);
    setText(this.peakText, dbfs(loudest));
    setText(this.rmsText, dbfs(mean_db));
    setAttribute(this.bars, "aria-valuenow", Math.max(LOWEST_DB, Math.min(0, loudest)).toFixed(0));
    setAttribute(this.bars, "aria-valuetext", loudest < -120 ? "silent" : `peak ${dbfs(loudest)}, mean ${dbfs(mean_db)} dBFS`);
  }

  private take(channel: Channel, peak_db: number, now: number): void {
    channel.peak_db = Math.max(channel.peak_db, peak_db);
    if (peak_db >= channel.hold_db) {
      channel.hold_db = peak_db;
      channel.heldUntil = now + HOLD_S;
    }
  }
}

/** 0 at the scale's lower end, 1 at 0 dBFS. */
function height(level_db: number): number {
  return Math.min(Math.max(1 - level_db / LOWEST_DB, 0), 1);
}
