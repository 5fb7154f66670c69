/** What reaches the loudspeaker, compared with the PCM that was sent, bit for bit. */
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { launch, open } from "./browser.mjs";
import { Mock } from "./mock.mjs";
import { countedSample } from "./mock_sound.mjs";

const RECORDER = `
registerProcessor("recorder", class extends AudioWorkletProcessor {
  process([input]) {
    if (input.length) this.port.postMessage(input.map((channel) => channel.slice()));
    return true;
  }
});`;

/** In the page: whatever is connected to the loudspeaker is recorded as well. */
function recordOutputs() {
  window.recorded = [];
  const connect = AudioNode.prototype.connect;
  AudioNode.prototype.connect = function (to, ...more) {
    if (to instanceof AudioDestinationNode) {
      void this.context.audioWorklet.addModule("/recorder.js").then(() => {
        const recorder = new AudioWorkletNode(this.context, "recorder", { numberOfOutputs: 0, channelCount: 2, channelCountMode: "explicit" });
        recorder.port.onmessage = ({ data }) => window.recorded.push(data);
        connect.call(this, recorder);
      });
    }
    return connect.call(this, to, ...more);
  };
}

let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

async function listen(seconds, meanwhile = async () => {}) {
  const mock = await new Mock({ sample: countedSample, files: { "/recorder.js": RECORDER } }).listen();
  const { page, complaints } = await open(browser, "about:blank");
  try {
    await page.addInitScript(recordOutputs);
    await page.goto(mock.url);
    await page.click("#listen:not([disabled])");
    await page.waitForFunction(() => window.recorded.length > 0);
    await meanwhile(page, mock);
    await page.waitForFunction((frames) => 128 * window.recorded.length > frames, 48000 * seconds);
    const facts = await page.locator("#listening-facts").innerText();
    const heard = await page.evaluate(() => window.recorded.map(([left, right]) => [[...left], [...right ?? left]]));
    assert.deepEqual(complaints, []);
    return { facts, left: heard.flatMap(([left]) => left), right: heard.flatMap(([, right]) => right) };
  } finally {
    await page.context().close();
    await mock.close();
  }
}

/** Pieces between silences and leaps, each [first sample's number, frames]; every value in them is what was sent. */
function pieces({ left, right }) {
  const out = [];
  let current = null;
  left.forEach((value, i) => {
    if (value === 0 && right[i] === 0) {
      current = null;
      return;
    }
    const n = Math.round(value * (1 << 22)) - 1;
    assert.equal(value, countedSample(n, 0), `frame ${i}, left`);
    assert.equal(right[i], countedSample(n, 1), `frame ${i}, right, of sample ${n}`);
    if (current && n === current[0] + current[1]) ++current[1];
    else out.push((current = [n, 1]));
  });
  return out;
}

test("the loudspeaker gets exactly the samples that were sent, in their order", async () => {
  const heard = await listen(4);
  const all = pieces(heard);
  for (let i = 1; i < all.length; ++i) assert.ok(all[i][0] >= all[i - 1][0] + all[i - 1][1], "a sample came twice");
  const frames = all.reduce((sum, [, length]) => sum + length, 0);
  assert.ok(frames > 48000, `${frames} frames compared in ${all.length} pieces`);
  assert.ok(Math.max(...all.map(([, length]) => length)) > 12000, `the longest piece of ${JSON.stringify(all)}`);
  assert.match(heard.facts, /^Heard \d+ ms after it came · \d+ gaps?/);
});

test("samples that were left out on the way are silence of their length, and told", async () => {
  let facts = "";
  const heard = await listen(3, async (page, mock) => {
    await page.waitForFunction(() => 128 * window.recorded.length > 48000);
    mock.leaveOut(2400);
    await page.waitForFunction(() => document.querySelector("#listening-facts").textContent.includes("50 ms never came"));
    facts = await page.locator("#listening-facts").innerText();
  });
  assert.match(facts, /50 ms never came/);
  assert.ok(pieces(heard).length >= 2);
});

test("muted, nothing makes a way to the loudspeaker; stopped, it ends", async () => {
  const mock = await new Mock().listen();
  const { page, complaints } = await open(browser, "about:blank");
  try {
    await page.addInitScript(() => {
      window.contexts = [];
      const Context = window.AudioContext;
      window.AudioContext = class extends Context {
        constructor(...options) {
          super(...options);
          window.contexts.push(this);
        }
      };
    });
    await page.goto(mock.url);
    await page.waitForFunction(() => document.querySelector("#meter-bars").ariaValueNow > -60);
    assert.equal(await page.evaluate(() => window.contexts.length), 0);
    await page.click("#listen");
    await page.waitForFunction(() => window.contexts[0]?.state === "running");
    assert.equal(await page.evaluate(() => window.contexts[0].sampleRate), 48000);
    await page.click("#listen");
    await page.waitForFunction(() => window.contexts[0].state === "closed");
    assert.match(await page.locator("#listening-facts").innerText(), /^Muted/);
    assert.deepEqual(complaints, []);
  } finally {
    await page.context().close();
    await mock.close();
  }
});
