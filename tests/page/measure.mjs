/**
 * What a frame of the page costs its main thread, from a Chromium trace:
 *   node tests/page/measure.mjs [--url URL] [--seconds 15] [--json]
 * Script (callbacks, messages, timers, garbage collection) and layout (styles, layout) between two animation frames. Without a URL of the
 * mock: 1333 triangles at 30 frames a second, 8 sessions listed, spectrogram, meter and sound running. Status 1 where more than 5 of 100
 * frames take longer than 8 ms of processor time.
 */
import { parseArgs } from "node:util";
import { launch, open } from "./browser.mjs";
import { Mock } from "./mock.mjs";

const LIMIT_MS = 8;
const SCRIPT = new Set(["EvaluateScript", "FunctionCall", "FireAnimationFrame", "TimerFire", "EventDispatch", "RunMicrotasks", "MinorGC", "MajorGC", "WebSocketReceive", "v8.run", "V8.GCScavenger", "IntersectionObserverController::computeIntersections"]);
const LAYOUT = new Set(["UpdateLayoutTree", "Layout", "ParseHTML", "HitTest"]);

/** [{script_ms, layout_ms, wall_ms}] of every frame of the main thread that runs animation frames. */
function frames(events) {
  const counts = new Map();
  const thread = ({ pid, tid }) => `${pid}/${tid}`;
  for (const event of events) if (event.name === "FireAnimationFrame") counts.set(thread(event), (counts.get(thread(event)) ?? 0) + 1);
  const main = [...counts].sort(([, a], [, b]) => b - a)[0]?.[0];
  const own = events.filter((event) => thread(event) === main && event.ph === "X" && (SCRIPT.has(event.name) || LAYOUT.has(event.name))).sort((a, b) => a.ts - b.ts || b.dur - a.dur);
  const out = [];
  let frame = null;
  let counted = -1;
  for (const event of own) {
    if (event.name === "FireAnimationFrame") out.push((frame = { script_ms: 0, layout_ms: 0, wall_ms: 0 }));
    if (event.ts < counted) continue; // within one that is counted
    counted = event.ts + event.dur;
    if (!frame) continue;
    frame[SCRIPT.has(event.name) ? "script_ms" : "layout_ms"] += (event.tdur ?? event.dur) / 1000;
    frame.wall_ms += event.dur / 1000;
  }
  return out.slice(0, -1);
}

function quantile(values, share) {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
}

const { values: options } = parseArgs({ options: { url: { type: "string" }, seconds: { type: "string", default: "15" }, json: { type: "boolean", default: false } } });
const mock = options.url ? null : await new Mock().listen();
const browser = await launch();
const { page } = await open(browser, options.url ?? mock.url);
await page.click("#listen:not([disabled])");
await page.waitForTimeout(3000);
await browser.startTracing(page, { categories: ["devtools.timeline", "v8", "disabled-by-default-v8.gc", "-*"] });
await page.waitForTimeout(1000 * Number(options.seconds));
const trace = JSON.parse(String(await browser.stopTracing()));
const measured = frames(trace.traceEvents ?? trace);
const triangles = await page.locator("#scene-facts").innerText();
const sessions = await page.locator("#session-list li").count();
await browser.close();
await mock?.close();

const of = (name) => ({ p50: quantile(measured.map(name), 0.5), p95: quantile(measured.map(name), 0.95), most: quantile(measured.map(name), 1) });
const result = {
  frames: measured.length,
  scene: triangles,
  sessions,
  script_and_layout_ms: of(({ script_ms, layout_ms }) => script_ms + layout_ms),
  script_ms: of(({ script_ms }) => script_ms),
  layout_ms: of(({ layout_ms }) => layout_ms),
  wall_ms: of(({ wall_ms }) => wall_ms),
};
if (options.json) console.log(JSON.stringify(result));
else {
  console.log(`${result.frames} frames of ${result.scene}; ${result.sessions} sessions listed`);
  for (const [name, { p50, p95, most }] of Object.entries(result).filter(([, value]) => value.p50 !== undefined)) {
    console.log(`${name.padEnd(22)} p50 ${p50.toFixed(2).padStart(6)}   p95 ${p95.toFixed(2).padStart(6)}   most ${most.toFixed(2).padStart(6)}`);
  }
}
process.exit(result.script_and_layout_ms.p95 <= LIMIT_MS ? 0 : 1);
