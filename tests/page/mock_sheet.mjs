/** A sheet of 1333 triangles that bends, folds and rests on a table: what the page draws in its tests. */

const NX = 23;
const NY = 29;
const WIDTH = 0.21;
const HEIGHT = 0.297;
export const VERTICES = (NX + 1) * (NY + 1);
export const TRIANGLES = 2 * NX * NY - 1; // a corner is missing

export function triangles() {
  const out = new Uint32Array(3 * TRIANGLES);
  let at = 0;
  for (let j = 0; j < NY; ++j) {
    for (let i = 0; i < NX; ++i) {
      const a = j * (NX + 1) + i;
      const quad = [a, a + 1, a + NX + 2, a, a + NX + 2, a + NX + 1];
      for (const vertex of quad) if (at < out.length) out[at++] = vertex;
    }
  }
  return out;
}

/** Height above the table: a bow whose curvature changes sign along the sheet, and a fold that wanders across. */
function point(u, v, t, out, at) {
  const bow = 0.034 * Math.sin(1.1 * t);
  const x = u - WIDTH / 2;
  const y = v - HEIGHT / 2;
  const along = Math.sin((2 * Math.PI * (v + 0.02 * Math.sin(t))) / HEIGHT);
  const fold = Math.abs(x + 0.35 * y - foldAt(t));
  out[at] = x * (1 - 0.06 * Math.cos(1.1 * t) ** 2);
  out[at + 1] = y * 0.97;
  out[at + 2] = 0.062 + bow * along + 0.3 * Math.max(0, 0.07 - fold) * (0.6 + 0.4 * Math.sin(0.7 * t)) + 0.02 * Math.cos(9 * x + t);
}

function foldAt(t) {
  return 0.03 * Math.sin(0.45 * t);
}

function regionOf(u, v, t) {
  const side = u - WIDTH / 2 + 0.35 * (v - HEIGHT / 2) > foldAt(t) ? 1 : 0;
  const third = v / HEIGHT + 0.05 * Math.sin(t + 3 * u);
  if (third > 0.46 && third < 0.54) return 0xffff;
  return side + (third > 0.5 ? 2 : 0);
}

export function topologyMessage(sheet) {
  const out = new ArrayBuffer(16 + 12 * TRIANGLES);
  new Uint32Array(out, 0, 4).set([1, sheet, VERTICES, TRIANGLES]);
  new Uint32Array(out, 16).set(triangles());
  return out;
}

export function frameMessage(sheet, t) {
  const ridges = NY;
  const rulings = 2 * 40;
  const regionsAt = 28 + 12 * VERTICES;
  const ridgesAt = regionsAt + 4 * Math.ceil(VERTICES / 2);
  const out = new ArrayBuffer(ridgesAt + 24 * (ridges + rulings));
  const view = new DataView(out);
  [2, sheet].forEach((value, i) => view.setUint32(4 * i, value, true));
  view.setFloat64(8, t, true);
  [VERTICES, ridges, rulings].forEach((value, i) => view.setUint32(16 + 4 * i, value, true));
  const positions = new Float32Array(out, 28, 3 * VERTICES);
  const regions = new Uint16Array(out, regionsAt, VERTICES);
  for (let j = 0; j <= NY; ++j) {
    for (let i = 0; i <= NX; ++i) {
      const vertex = j * (NX + 1) + i;
      const u = (WIDTH * i) / NX;
      const v = (HEIGHT * j) / NY;
      point(u, v, t, positions, 3 * vertex);
      regions[vertex] = regionOf(u, v, t);
    }
  }
  const segments = new Float32Array(out, ridgesAt);
  const foldU = (v) => WIDTH / 2 + foldAt(t) - 0.35 * (v - HEIGHT / 2);
  let at = 0;
  const end = (u, v) => {
    point(u, v, t, segments, at);
    at += 3;
  };
  for (let j = 0; j < ridges; ++j) {
    end(foldU((HEIGHT * j) / ridges), (HEIGHT * j) / ridges);
    end(foldU((HEIGHT * (j + 1)) / ridges), (HEIGHT * (j + 1)) / ridges);
  }
  for (let i = 0; i < rulings; ++i) {
    const v = HEIGHT * (((i * 0.618034) % 1) * 0.96 + 0.02);
    const u = WIDTH * (((i * 0.7548777) % 1) * 0.82 + 0.04);
    end(u, v);
    end(u + 0.12 * WIDTH, v);
  }
  return out;
}

/** Where a vertex that t and k choose is. */
export function somewhere(t, k) {
  const place = [0, 0, 0];
  const u = WIDTH * ((Math.abs(Math.sin(12.9898 * k + 7.1 * t)) * 43.5) % 1);
  const v = HEIGHT * ((Math.abs(Math.sin(78.233 * k + 3.7 * t)) * 43.5) % 1);
  point(u, v, t, place, 0);
  return place;
}
