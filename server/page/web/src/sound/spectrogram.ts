import { isDark, onTheme } from "../theme";
import type { Pcm } from "../wire/binary";
import { inkOf } from "./ink";
import { Spectrum } from "./spectrum";

const SIZE = 2048;
const HOP = 1024;
export const LOWEST_HZ = 50;
export const HIGHEST_HZ = 20000;
export const FLOOR_DB = -110;
export const TOP_DB = -24;
const ROWS = 192;
const MOST_COLUMNS = 2048;

/** Level by time and frequency, newest at the right; frequency goes up by octaves. */
export class Spectrogram {
  private readonly context: CanvasRenderingContext2D;
  private readonly spectrum = new Spectrum(SIZE);
  private readonly mono = new Float32Array(2 * SIZE);
  private written = 0;
  private expected = -1;
  private sampleRate = 48000;
  /** Levels of all columns as 0 ... 255, column after column: what is drawn anew when the theme or the width changes. */
  private readonly levels = new Uint8Array(ROWS * MOST_COLUMNS);
  private columns = 0;
  private drawn = 0;
  private width = 0;
  private readonly column: ImageData;
  private readonly pixels: Uint32Array;
  private readonly firstBin = new Uint16Array(ROWS);
  private readonly lastBin = new Uint16Array(ROWS);
  private readonly between = new Float32Array(ROWS);
  private ink: Uint32Array;
  /** Columns in a ring, a pixel each; the canvas on the page shows it turned so that the newest is right. */
  private readonly ring: HTMLCanvasElement;
  private readonly ringContext: CanvasRenderingContext2D;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.context = canvas.getContext("2d", { alpha: false })!;
    this.ring = document.createElement("canvas");
    this.ring.height = ROWS;
    this.ringContext = this.ring.getContext("2d", { alpha: false, willReadFrequently: true })!;
    this.column = new ImageData(1, ROWS);
    this.pixels = new Uint32Array(this.column.data.buffer);
    this.ink = inkOf(isDark());
    this.setSampleRate(48000);
    new ResizeObserver(() => this.resize()).observe(canvas);
    onTheme((dark) => {
      this.ink = inkOf(dark);
      this.drawAll();
    });
  }

  setSampleRate(rate: number): void {
    this.sampleRate = rate;
    for (let row = 0; row < ROWS; ++row) {
      const low = this.binAt(row / ROWS);
      const high = this.binAt((row + 1) / ROWS);
      this.firstBin[row] = Math.ceil(low);
      this.lastBin[row] = Math.floor(high);
      this.between[row] = (low + high) / 2;
    }
  }

  /** How much time the canvas shows. */
  get span_s(): number {
    return (this.width * HOP) / this.sampleRate;
  }

  add(pcm: Pcm): void {
    const { channels, frames, samples, firstSample } = pcm;
    if (firstSample !== this.expected) this.mono.fill(0); // another session, or a gap: nothing to go on from
    this.expected = firstSample + frames;
    for (let i = 0; i < frames; ++i) {
      let sum = 0;
      for (let c = 0; c < channels; ++c) sum += samples[i * channels + c]!;
      this.mono[this.written % this.mono.length] = sum / channels;
      ++this.written;
      if (this.written % HOP === 0) this.analyse();
    }
  }

  clear(): void {
    this.levels.fill(0);
    this.expected = -1;
    this.drawAll();
  }

  /** Draws the columns that came since. [once a display frame] */
  draw(): void {
    if (this.drawn === this.columns || this.width === 0) return;
    this.drawn = Math.max(this.drawn, this.columns - this.width);
    for (; this.drawn < this.columns; ++this.drawn) this.drawColumn(this.drawn);
    this.show();
  }

  private binAt(height: number): number {
    const frequency = LOWEST_HZ * (HIGHEST_HZ / LOWEST_HZ) ** height;
    return Math.min((frequency * SIZE) / this.sampleRate, SIZE / 2);
  }

  private analyse(): void {
    const level = this.spectrum.ofRing(this.mono, this.written % this.mono.length);
    const at = (this.columns % MOST_COLUMNS) * ROWS;
    for (let row = 0; row < ROWS; ++row) {
      const first = this.firstBin[row]!;
      const last = this.lastBin[row]!;
      let shown: number;
      if (first > last) {
        // Rows closer than bins: between two of them.
        const bin = Math.floor(this.between[row]!);
        const part = this.between[row]! - bin;
        shown = level[bin]! * (1 - part) + (level[bin + 1] ?? level[bin]!) * part;
      } else {
        shown = level[first]!;
        for (let bin = first + 1; bin <= last; ++bin) shown = Math.max(shown, level[bin]!);
      }
      this.levels[at + row] = Math.min(Math.max((255 * (shown - FLOOR_DB)) / (TOP_DB - FLOOR_DB), 0), 255);
    }
    ++this.columns;
  }

  private drawColumn(column: number): void {
    const at = (((column % MOST_COLUMNS) + MOST_COLUMNS) % MOST_COLUMNS) * ROWS;
    for (let row = 0; row < ROWS; ++row) this.pixels[ROWS - 1 - row] = this.ink[this.levels[at + row]!]!;
    this.ringContext.putImageData(this.column, ((column % this.width) + this.width) % this.width, 0);
  }

  private drawAll(): void {
    if (this.width === 0) return;
    for (let column = this.columns - this.width; column < this.columns; ++column) this.drawColumn(column);
    this.drawn = this.columns;
    this.show();
  }

  private show(): void {
    const seam = this.columns % this.width;
    const older = this.width - seam;
    const height = this.canvas.height;
    this.context.drawImage(this.ring, seam, 0, older, ROWS, 0, 0, older, height);
    if (seam > 0) this.context.drawImage(this.ring, 0, 0, seam, ROWS, older, 0, seam, height);
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.canvas;
    if (clientWidth === 0 || clientHeight === 0) return;
    this.width = Math.min(clientWidth, MOST_COLUMNS);
    this.ring.width = this.width;
    this.canvas.width = this.width;
    this.canvas.height = Math.round(clientHeight * Math.min(window.devicePixelRatio, 2));
    this.drawAll();
  }
}
