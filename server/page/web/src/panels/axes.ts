import { create, setText } from "../dom";
import { HIGHEST_HZ, LOWEST_HZ, type Spectrogram } from "../sound/spectrogram";

const LABELLED: [number, string][] = [
  [100, "100 Hz"],
  [200, ""],
  [500, "500"],
  [1000, "1 k"],
  [2000, "2 k"],
  [5000, "5 k"],
  [10000, "10 k"],
];

/** Names of frequencies and times over the spectrogram's canvas. */
export class SpectrogramAxes {
  private readonly oldest = create("span");
  private readonly middle = create("span");

  constructor(frequencies: HTMLElement, times: HTMLElement) {
    for (const [hertz, label] of LABELLED) {
      const tick = create("span", label ? "" : "minor", label);
      tick.style.bottom = `${((100 * Math.log(hertz / LOWEST_HZ)) / Math.log(HIGHEST_HZ / LOWEST_HZ)).toFixed(2)}%`;
      frequencies.append(tick);
    }
    times.append(this.oldest, this.middle, create("span", "", "now"));
  }

  update(spectrogram: Spectrogram): void {
    const span_s = spectrogram.span_s;
    setText(this.oldest, `−${span_s.toFixed(0)} s`);
    setText(this.middle, `−${(span_s / 2).toFixed(0)} s`);
  }
}
