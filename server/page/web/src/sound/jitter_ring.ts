/** What happened to the sound on its way, since the ring was made. In frames (samples of each channel) where it says so. */
export interface RingStatistics {
  /** Waiting to be played. */
  waiting: number;
  played: number;
  /** Times that it ran dry. */
  underruns: number;
  /** Never came: the sender left them out because this page read too slowly. Played as silence. */
  missing: number;
  /** Left out to catch up after too much had gathered. */
  skipped: number;
}

/** A hole longer than this is a new beginning, not silence to sit through. In frames. */
const LONGEST_HOLE = 48000;

/**
 * A ring between blocks that come unevenly and an output that is called for evenly: it waits until `target` frames are there, then gives
 * exactly what came; where it ran dry it waits for half as much more than before. Where more than `most` gathers, it leaves out what is beyond `target`.
 * Allocates nothing after it was made.
 */
export class JitterRing {
  private readonly samples: Float32Array[];
  private readonly capacity: number;
  private read = 0;
  private waiting = 0;
  private next = -1;
  private running = false;
  private readonly counted: RingStatistics = { waiting: 0, played: 0, underruns: 0, missing: 0, skipped: 0 };

  constructor(
    private readonly channels: number,
    private target: number,
    private readonly most: number,
  ) {
    this.capacity = most + LONGEST_HOLE;
    this.samples = Array.from({ length: channels }, () => new Float32Array(this.capacity));
  }

  /** Interleaved; `first` is the sender's number of the first frame. */
  push(first: number, interleaved: Float32Array): void {
    const frames = Math.floor(interleaved.length / this.channels);
    if (this.next >= 0 && first !== this.next) {
      const hole = first - this.next;
      if (hole < 0 || hole > LONGEST_HOLE) this.restart();
      else {
        this.counted.missing += hole;
        this.write(hole, null);
      }
    }
    this.next = first + frames;
    this.write(frames, interleaved);
    if (this.waiting > this.most) {
      this.counted.skipped += this.waiting - this.target;
      this.read = (this.read + this.waiting - this.target) % this.capacity;
      this.waiting = this.target;
    }
  }

  /** Fills the outputs, one array a channel; outputs beyond the ring's channels get its last one. */
  pull(outputs: Float32Array[]): void {
    const frames = outputs[0]?.length ?? 0;
    if (!this.running && this.waiting >= this.target) this.running = true;
    const given = this.running ? Math.min(frames, this.waiting) : 0;
    outputs.forEach((output, channel) => {
      const from = this.samples[Math.min(channel, this.channels - 1)]!;
      for (let i = 0; i < given; ++i) output[i] = from[(this.read + i) % this.capacity]!;
      output.fill(0, given);
    });
    this.read = (this.read + given) % this.capacity;
    this.waiting -= given;
    this.counted.played += given;
    if (this.running && given < frames) {
      this.running = false;
      this.target = Math.min(Math.round(1.5 * this.target), Math.floor(this.most / 2));
      ++this.counted.underruns;
    }
  }

  /** The same object every time. */
  statistics(): Readonly<RingStatistics> {
    this.counted.waiting = this.waiting;
    return this.counted;
  }

  private restart(): void {
    this.waiting = 0;
    this.running = false;
  }

  private write(frames: number, interleaved: Float32Array | null): void {
    // What a caller pushes at once is less than the capacity; of more the newest stay.
    const from = Math.max(0, frames - this.capacity);
    for (let channel = 0; channel < this.channels; ++channel) {
      const into = this.samples[channel]!;
      for (let i = from; i < frames; ++i) {
        into[(this.read + this.waiting + i) % this.capacity] = interleaved ? interleaved[i * this.channels + channel]! : 0;
      }
    }
    const kept = Math.min(this.waiting + frames, this.capacity);
    this.read = (this.read + this.waiting + frames - kept) % this.capacity;
    this.waiting = kept;
  }
}
