/** Colours of the spectrogram, level 0 to 255, as the pixels of an ImageData: from the page's ground to the strongest ink, ever farther from it in lightness. */

type Stop = [at: number, red: number, green: number, blue: number];

const DARK: Stop[] = [
  [0, 20, 23, 27],
  [0.2, 30, 40, 72],
  [0.42, 92, 52, 122],
  [0.62, 190, 72, 104],
  [0.8, 244, 138, 76],
  [1, 255, 240, 190],
];

const LIGHT: Stop[] = [
  [0, 250, 249, 246],
  [0.2, 222, 226, 236],
  [0.42, 152, 178, 212],
  [0.62, 88, 112, 178],
  [0.8, 92, 48, 122],
  [1, 44, 8, 40],
];

export function inkOf(dark: boolean): Uint32Array {
  const stops = dark ? DARK : LIGHT;
  const out = new Uint32Array(256);
  for (let level = 0; level < 256; ++level) {
    const at = level / 255;
    const next = Math.max(1, stops.findIndex((stop) => stop[0] >= at));
    const from = stops[next - 1]!;
    const to = stops[next]!;
    const part = (at - from[0]) / (to[0] - from[0]);
    const mix = (k: 1 | 2 | 3) => Math.round(from[k] + part * (to[k] - from[k]));
    out[level] = (0xff000000 | (mix(3) << 16) | (mix(2) << 8) | mix(1)) >>> 0;
  }
  return out;
}
