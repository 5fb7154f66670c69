import { byId, setAttribute, setText } from "../dom";
import { count, duration, milliseconds } from "../format";
import type { Figures, Hello } from "../wire/messages";

/** The daemon's own figures: load level, latency, processors, and what stands in its panel. */
export class Vitals {
  private readonly where = byId("where");
  private readonly level = byId("load-level");
  private readonly steps = byId("load-steps");
  private readonly p50 = byId("latency-p50");
  private readonly p99 = byId("latency-p99");
  private readonly cpu = byId("cpu-share");
  private readonly uptime = byId("uptime");
  private readonly viewers = byId("viewers");
  private readonly gaps = byId("pcm-gaps");
  private readonly voices = byId("voices");

  hello(hello: Hello): void {
    setText(this.where, `${hello.daemon} on ${hello.machine}`);
  }

  update(figures: Figures): void {
    setText(this.level, figures.load_level_name || String(figures.load_level));
    setAttribute(this.steps, "data-level", String(figures.load_level));
    setText(this.p50, milliseconds(figures.latency_ms.p50));
    setText(this.p99, milliseconds(figures.latency_ms.p99));
    setText(this.cpu, figures.cpu_share.toFixed(figures.cpu_share < 10 ? 2 : 1));
    setText(this.uptime, duration(figures.uptime_s));
    setText(this.viewers, count(figures.viewers));
    setText(this.gaps, count(figures.pcm_gaps));
    setText(this.voices, count(figures.sessions.reduce((sum, { voices }) => sum + voices, 0)));
  }
}
