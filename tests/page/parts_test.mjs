/** What the page computes, without a browser: the jitter ring, the spectrum, the wire's binary, triangles. */
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { describe, test } from "node:test";
import { load } from "./modules.mjs";
import { frameMessage, topologyMessage, triangles, TRIANGLES, VERTICES } from "./mock_sheet.mjs";
import { countedSample, pcmMessage } from "./mock_sound.mjs";

const { JitterRing } = await load("sound/jitter_ring.ts");
const { Sharpness } = await load("scene/sharpness.ts");
const { Spectrum } = await load("sound/spectrum.ts");
const { decodeBinary } = await load("wire/binary.ts");
const { borderEdges, turnToRegions, vertexNormals } = await load("scene/triangles.ts");

const TARGET = 480;
const MOST = 4800;

function block(first, frames) {
  const out = new Float32Array(2 * frames);
  for (let i = 0; i < frames; ++i) for (let c = 0; c < 2; ++c) out[2 * i + c] = countedSample(first + i, c);
  return out;
}

/** Pulls so many frames in blocks of 128; the left channel. */
function pull(ring, frames) {
  const left = [];
  for (let i = 0; i < frames; i += 128) {
    const outputs = [new Float32Array(128).fill(9), new Float32Array(128).fill(9)];
    ring.pull(outputs);
    left.push(...outputs[0]);
    outputs[0].forEach((value, k) => assert.equal(outputs[1][k], value === 0 ? 0 : -value));
  }
  return left;
}

const counted = (first, frames) => Array.from({ length: frames }, (_, i) => countedSample(first + i, 0));

describe("the jitter ring", () => {
  test("gives what came, sample for sample, for any size of blocks", () => {
    const ring = new JitterRing(2, TARGET, MOST);
    const sizes = [960, 1, 7, 480, 333, 128, 1200];
    let first = 100;
    const heard = [];
    for (let round = 0; round < 60; ++round) {
      const frames = sizes[round % sizes.length];
      ring.push(first, block(first, frames));
      first += frames;
      while (ring.statistics().waiting >= TARGET + 128) heard.push(...pull(ring, 128));
    }
    assert.ok(heard.length > 10000);
    assert.deepEqual(heard, counted(100, heard.length));
    assert.deepEqual({ ...ring.statistics(), waiting: 0 }, { waiting: 0, played: heard.length, underruns: 0, missing: 0, skipped: 0 });
  });

  test("is silent until enough has come, and again where it ran dry", () => {
    const ring = new JitterRing(2, TARGET, MOST);
    ring.push(0, block(0, TARGET - 1));
    assert.deepEqual(pull(ring, 128), new Array(128).fill(0));
    ring.push(TARGET - 1, block(TARGET - 1, 1));
    assert.deepEqual(pull(ring, 512), [...counted(0, TARGET), ...new Array(512 - TARGET).fill(0)]);
    assert.equal(ring.statistics().underruns, 1);
    ring.push(TARGET, block(TARGET, 128));
    assert.deepEqual(pull(ring, 128), new Array(128).fill(0));
    assert.equal(ring.statistics().underruns, 1);
  });

  test("plays silence for what never came, so that all that follows keeps its time", () => {
    const ring = new JitterRing(2, TARGET, MOST);
    ring.push(0, block(0, TARGET));
    ring.push(TARGET + 100, block(TARGET + 100, TARGET));
    assert.deepEqual(pull(ring, 1024), [...counted(0, TARGET), ...new Array(100).fill(0), ...counted(TARGET + 100, 1024 - TARGET - 100)]);
    assert.equal(ring.statistics().missing, 100);
  });

  test("begins anew with another session's samples", () => {
    const ring = new JitterRing(2, TARGET, MOST);
    ring.push(900000, block(900000, 2000));
    ring.push(5, block(5, TARGET));
    assert.deepEqual(pull(ring, 128), counted(5, 128));
    assert.equal(ring.statistics().missing, 0);
  });

  test("leaves out what gathers beyond the most it may hold", () => {
    const ring = new JitterRing(2, TARGET, MOST);
    ring.push(0, block(0, MOST));
    ring.push(MOST, block(MOST, 10));
    assert.equal(ring.statistics().skipped, MOST + 10 - TARGET);
    assert.deepEqual(pull(ring, 128), counted(MOST + 10 - TARGET, 128));
  });
});

describe("the spectrum", () => {
  const spectrum = new Spectrum(2048);
  const sine = (bin, amplitude) => Float32Array.from({ length: 4096 }, (_, i) => amplitude * Math.sin((2 * Math.PI * bin * i) / 2048));

  test("of a sine is its level at its frequency, and nothing far from it", () => {
    for (const bin of [3, 64, 700, 1020]) {
      const level = spectrum.ofRing(sine(bin, 0.5), 1234);
      assert.ok(Math.abs(level[bin] - 20 * Math.log10(0.5)) < 0.01, `bin ${bin}: ${level[bin]} dB`);
      for (let k = 0; k <= 1024; ++k) if (Math.abs(k - bin) > 2) assert.ok(level[k] < -90, `bin ${k} beside ${bin}: ${level[k]} dB`);
    }
  });

  test("of noise holds its power", () => {
    let seed = 1;
    const noise = Float32Array.from({ length: 2048 }, () => {
      seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
      return seed / 2 ** 31 - 1;
    });
    const level = spectrum.ofRing(noise, 0);
    // A band's power is half its level's square over the window's noise bandwidth of 1.5 bins.
    const power = level.slice(1, 1024).reduce((sum, db) => sum + 10 ** (db / 10), 0) / 2 / 1.5;
    const mean = noise.reduce((sum, value) => sum + value * value, 0) / noise.length;
    assert.ok(Math.abs(10 * Math.log10(power / mean)) < 0.5);
  });
});

describe("the scene's sharpness", () => {
  const after = (...times) => {
    const sharpness = new Sharpness();
    for (const [seconds, pictures] of times) for (let i = 0; i < pictures; ++i) sharpness.took(seconds);
    return sharpness.scale;
  };

  test("stays whole while motion is smooth, or where the page was out of sight", () => {
    assert.equal(after([1 / 60, 500], [1 / 30, 500]), 1);
    assert.equal(after([5, 100]), 1);
  });

  test("goes down once where pictures take long, for good", () => {
    assert.equal(after([0.1, 23]), 1);
    assert.equal(after([0.1, 24]), 0.75);
    assert.equal(after([0.1, 1000]), 0.75);
    assert.equal(after([0.1, 24], [0.02, 1000]), 0.75);
  });
});

test("the ten lines that the page shows are those of the guide, which a test runs", async () => {
  const page = await readFile(new URL("../../server/page/web/index.html", import.meta.url), "utf8");
  const guide = await readFile(new URL("../../client_sdk/guides/page.md", import.meta.url), "utf8");
  const shown = /<pre id="attach-snippet"[^>]*>([^<]*)<\/pre>/.exec(page)[1];
  assert.equal(shown.replaceAll("&lt;", "<"), /```python flag\.py\n([^]*?)\n```/.exec(guide)[1]);
});

describe("the wire's binary", () => {
  test("a topology, a frame and PCM come out as they went in", () => {
    const topology = decodeBinary(topologyMessage(3));
    assert.equal(topology.sheet, 3);
    assert.equal(topology.vertices, VERTICES);
    assert.deepEqual(topology.triangles, triangles());
    const frame = decodeBinary(frameMessage(3, 1.5));
    assert.deepEqual([frame.sheet, frame.time_s, frame.positions.length, frame.regions.length], [3, 1.5, 3 * VERTICES, VERTICES]);
    assert.ok(frame.ridges.every((value) => Math.abs(value) < 0.3) && frame.rulings.every((value) => Math.abs(value) < 0.3));
    const pcm = decodeBinary(pcmMessage(2 ** 33, 5, 2, countedSample));
    assert.equal(pcm.firstSample, 2 ** 33);
    assert.deepEqual(pcm.samples, block(2 ** 33, 5));
  });

  test("every shorter message is refused, an unknown kind left out", () => {
    for (const whole of [topologyMessage(0), frameMessage(0, 0), pcmMessage(0, 4, 2, countedSample)]) {
      for (const length of [0, 4, 11, 19, 27, whole.byteLength - 1]) assert.throws(() => decodeBinary(whole.slice(0, length)), RangeError);
    }
    assert.equal(decodeBinary(new Uint32Array([77, 0, 0]).buffer), null);
  });
});

describe("triangles", () => {
  test("the border of a sheet is its edges of one triangle", () => {
    assert.deepEqual([...borderEdges(new Uint32Array([0, 1, 2, 0, 2, 3]))], [0, 1, 1, 2, 2, 3, 3, 0]);
    assert.deepEqual([...borderEdges(new Uint32Array([0, 1, 2, 0, 2, 3, 0, 2, 4]))], [0, 1, 1, 2, 2, 3, 3, 0, 2, 4, 4, 0], "three at an edge");
    assert.equal(borderEdges(new Uint32Array(0)).length, 0);
    const edges = borderEdges(triangles());
    // Euler: a disc has V - E + F = 1, and 3 F = 2 E - border.
    assert.equal(edges.length / 2, 2 * (VERTICES + TRIANGLES - 1) - 3 * TRIANGLES);
  });

  test("normals of a flat sheet point up, as long as the area they stand for", () => {
    const normals = new Float32Array(12);
    vertexNormals(new Float32Array([0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0]), new Uint32Array([0, 1, 2, 0, 2, 3]), normals);
    assert.deepEqual([...normals], [0, 0, 2, 0, 0, 1, 0, 0, 2, 0, 0, 1]);
  });

  test("a triangle's last corner is of the region that most of its corners are of, its winding kept", () => {
    const corners = new Uint32Array([0, 1, 2, 0, 1, 3]);
    assert.equal(turnToRegions(corners, new Uint16Array([5, 5, 6, 5])), true);
    assert.deepEqual([...corners], [1, 2, 0, 0, 1, 3]);
    assert.equal(turnToRegions(corners, new Uint16Array([5, 5, 6, 5])), false);
  });
});
