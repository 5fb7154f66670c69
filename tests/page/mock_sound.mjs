/** Sounds of which every sample is known: a function of its number and channel. */

/** Its number, readable from its value; never 0, so that silence is nothing but silence. Exact in 32 bits. */
export function countedSample(n, channel) {
  const value = ((n % (1 << 20)) + 1) / (1 << 22);
  return channel === 0 ? value : -value;
}

function hash(k) {
  let x = Math.imul(k ^ 0x9e3779b9, 0x85ebca6b);
  x = Math.imul(x ^ (x >>> 13), 0xc2b2ae35);
  return ((x ^ (x >>> 16)) >>> 0) / 0x100000000;
}

const CELL = 1200;

/** Crackling over a soft rub, as paper sounds. */
export function paperSample(n, channel) {
  const rub = 0.004 * (1 + Math.sin(n / 23000)) * (hash(n) - hash(n - 1)) * (0.6 + 0.4 * Math.sin(n / 3100));
  let sum = rub;
  const cell = Math.floor(n / CELL);
  for (let k = cell - 6; k <= cell; ++k) {
    if (hash(31 * k) < 0.72 - 0.25 * Math.sin(k / 19)) continue;
    const age = n - k * CELL - Math.floor(CELL * hash(7 * k));
    if (age < 0) continue;
    const frequency = 600 * 14 ** hash(3 * k);
    const loud = 0.35 * hash(5 * k) ** 3;
    sum += loud * Math.exp(-age / (120 + 900 * hash(11 * k))) * Math.sin((2 * Math.PI * frequency * age) / 48000) * (0.7 + 0.6 * (hash(n) - 0.5));
  }
  return sum * (channel === 0 ? 1 : 0.8);
}

export function pcmMessage(first, frames, channels, sample) {
  const out = new ArrayBuffer(24 + 4 * frames * channels);
  const view = new DataView(out);
  view.setUint32(0, 3, true);
  view.setBigUint64(8, BigInt(first), true);
  view.setUint32(16, channels, true);
  view.setUint32(20, frames, true);
  const samples = new Float32Array(out, 24);
  for (let i = 0; i < frames; ++i) for (let c = 0; c < channels; ++c) samples[i * channels + c] = sample(first + i, c);
  return out;
}
