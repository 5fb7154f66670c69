import { JitterRing } from "./jitter_ring";

/** To the worklet. */
export interface PcmBlock {
  first: number;
  samples: Float32Array;
}

const TARGET_S = 0.08;
const MOST_S = 0.4;
const TELL_EVERY_S = 0.25;

/** Plays what the page passes on, as it is: the context runs at the sound's own rate. */
class Playback extends AudioWorkletProcessor {
  private readonly ring: JitterRing;
  private untilTold = 0;

  constructor(options: AudioWorkletNodeOptions) {
    super(options);
    this.ring = new JitterRing(options.outputChannelCount?.[0] ?? 2, Math.round(TARGET_S * sampleRate), Math.round(MOST_S * sampleRate));
    this.port.onmessage = ({ data }: MessageEvent<PcmBlock>) => this.ring.push(data.first, data.samples);
  }

  process(_inputs: Float32Array[][], outputs: Float32Array[][]): boolean {
    const output = outputs[0]!;
    this.ring.pull(output);
    this.untilTold -= output[0]?.length ?? 0;
    if (this.untilTold <= 0) {
      this.untilTold = TELL_EVERY_S * sampleRate;
      this.port.postMessage(this.ring.statistics());
    }
    return true;
  }
}

registerProcessor("rustle-playback", Playback);
