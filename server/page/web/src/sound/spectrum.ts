/**
 * Level of a real signal by frequency: a Hann window, then a radix-2 FFT.
 *   out[k] in dB, 0 for a sine of amplitude 1 at bin k;   bins 0 ... size/2
 * Allocates nothing after it was made.
 */
export class Spectrum {
  private readonly window: Float32Array;
  private readonly real: Float32Array;
  private readonly imaginary: Float32Array;
  private readonly cosine: Float32Array;
  private readonly sine: Float32Array;
  private readonly reversed: Uint32Array;
  readonly level_db: Float32Array;

  /** \pre size is a power of two */
  constructor(readonly size: number) {
    this.window = Float32Array.from({ length: size }, (_, i) => 0.5 - 0.5 * Math.cos((2 * Math.PI * i) / size));
    this.real = new Float32Array(size);
    this.imaginary = new Float32Array(size);
    this.cosine = Float32Array.from({ length: size / 2 }, (_, i) => Math.cos((2 * Math.PI * i) / size));
    this.sine = Float32Array.from({ length: size / 2 }, (_, i) => -Math.sin((2 * Math.PI * i) / size));
    this.reversed = new Uint32Array(size);
    for (let i = 1; i < size; ++i) this.reversed[i] = (this.reversed[i >> 1]! >> 1) | (i & 1 ? size >> 1 : 0);
    this.level_db = new Float32Array(size / 2 + 1);
  }

  /** Of the `size` samples that end before `end` in a ring. */
  ofRing(ring: Float32Array, end: number): Float32Array {
    const { size, real, imaginary, reversed, window } = this;
    const begin = end - size + ring.length;
    for (let i = 0; i < size; ++i) {
      real[reversed[i]!] = ring[(begin + i) % ring.length]! * window[i]!;
    }
    imaginary.fill(0);
    this.transform();
    // The window halves the amplitude, and half of a real sine's is at negative frequencies.
    const scale = (4 / size) ** 2;
    for (let k = 0; k <= size / 2; ++k) {
      const power = (real[k]! * real[k]! + imaginary[k]! * imaginary[k]!) * scale;
      this.level_db[k] = 10 * Math.log10(power + 1e-20);
    }
    return this.level_db;
  }

  private transform(): void {
    const { size, real, imaginary, cosine, sine } = this;
    for (let half = 1; half < size; half *= 2) {
      const stride = size / (2 * half);
      for (let start = 0; start < size; start += 2 * half) {
        for (let i = 0; i < half; ++i) {
          const c = cosine[i * stride]!;
          const s = sine[i * stride]!;
          const low = start + i;
          const high = low + half;
          const re = real[high]! * c - imaginary[high]! * s;
          const im = real[high]! * s + imaginary[high]! * c;
          real[high] = real[low]! - re;
          imaginary[high] = imaginary[low]! - im;
          real[low]! += re;
          imaginary[low]! += im;
        }
      }
    }
  }
}
