import type { Pcm } from "../wire/binary";
import type { RingStatistics } from "./jitter_ring";
import type { PcmBlock } from "./playback.worklet";
import workletUrl from "./playback.worklet.ts?worker&url";

export interface ListeningState {
  on: boolean;
  /** What the ring told last; null before it told anything. */
  ring: Readonly<RingStatistics> | null;
  /** From the block's arrival to the loudspeaker, as far as the browser tells. */
  latency_ms: number | null;
}

/** Sends PCM to the loudspeaker through an AudioWorklet, from the moment that the reader wants to hear. */
export class Listening {
  private context: AudioContext | null = null;
  private node: AudioWorkletNode | null = null;
  private volume: GainNode | null = null;
  private gain = 1;
  private wanted = false;
  private ring: RingStatistics | null = null;

  get on(): boolean {
    return this.wanted;
  }

  /** Must come of a click or a key: browsers let nothing sound before. Rejects with a remedy where it cannot sound. */
  async start(sampleRate: number, channels: number): Promise<void> {
    this.wanted = true;
    if (!window.AudioContext || !("audioWorklet" in AudioContext.prototype)) {
      this.wanted = false;
      throw new Error("This browser gives sound to secure pages only: open the page as http://localhost or http://127.0.0.1, or through a tunnel that ends there.");
    }
    const context = new AudioContext({ sampleRate, latencyHint: "interactive" });
    this.context = context;
    try {
      await context.audioWorklet.addModule(workletUrl);
      if (this.context !== context) return; // stopped meanwhile
      const node = new AudioWorkletNode(context, "rustle-playback", { numberOfInputs: 0, outputChannelCount: [channels] });
      this.volume = new GainNode(context, { gain: this.gain });
      node.connect(this.volume).connect(context.destination);
      node.port.onmessage = ({ data }: MessageEvent<RingStatistics>) => (this.ring = data);
      this.node = node;
      await context.resume();
    } catch (error) {
      this.stop();
      throw error;
    }
  }

  stop(): void {
    this.wanted = false;
    this.node = null;
    this.ring = null;
    void this.context?.close();
    this.context = null;
  }

  /** 0 to 1. */
  setVolume(gain: number): void {
    this.gain = gain;
    this.volume?.gain.setTargetAtTime(gain, this.context?.currentTime ?? 0, 0.02);
  }

  /** Another session's samples are counted from elsewhere: the ring finds that by itself. The samples are copied. */
  play(pcm: Pcm): void {
    if (!this.node) return;
    const block: PcmBlock = { first: pcm.firstSample, samples: pcm.samples.slice() };
    this.node.port.postMessage(block, [block.samples.buffer]);
  }

  state(): ListeningState {
    const context = this.context;
    const waiting_s = this.ring && context ? this.ring.waiting / context.sampleRate : null;
    const latency_ms = waiting_s === null || !context ? null : 1000 * (waiting_s + context.baseLatency + (context.outputLatency || 0));
    return { on: this.wanted, ring: this.ring, latency_ms };
  }
}
