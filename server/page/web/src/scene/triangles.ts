import { NO_REGION } from "../wire/binary";

/**
 * Edges of one triangle only: the sheet's border, two vertices each, in the order of the triangles. Sheets that are meshed anew come with
 * every frame, so edges are counted in a table of plain numbers.
 */
export function borderEdges(triangles: Uint32Array): Uint32Array {
  const size = 1 << Math.ceil(Math.log2(2 * triangles.length + 2));
  const edgeAt = new Int32Array(size).fill(-1); // the corner where an edge begins
  const shared = new Uint8Array(triangles.length);
  const endOf = (corner: number) => triangles[corner % 3 === 2 ? corner - 2 : corner + 1]!;
  let border = triangles.length;
  for (let corner = 0; corner < triangles.length; ++corner) {
    const a = triangles[corner]!;
    const b = endOf(corner);
    let slot = (Math.imul(Math.min(a, b), 0x9e3779b1) ^ Math.imul(Math.max(a, b), 0x85ebca6b)) & (size - 1);
    for (; edgeAt[slot]! >= 0; slot = (slot + 1) & (size - 1)) {
      const other = edgeAt[slot]!;
      const c = triangles[other]!;
      const d = endOf(other);
      if ((c !== a || d !== b) && (c !== b || d !== a)) continue;
      if (!shared[other]) --border;
      shared[other] = shared[corner] = 1;
      --border;
      break;
    }
    if (!shared[corner]) edgeAt[slot] = corner;
  }
  const out = new Uint32Array(2 * border);
  let at = 0;
  for (let corner = 0; corner < triangles.length; ++corner) {
    if (shared[corner]) continue;
    out[at++] = triangles[corner]!;
    out[at++] = endOf(corner);
  }
  return out;
}

/** Vertex normals weighted by area, not yet of unit length: the shader makes them so. */
export function vertexNormals(positions: Float32Array, triangles: Uint32Array, out: Float32Array): void {
  out.fill(0);
  for (let t = 0; t < triangles.length; t += 3) {
    const a = 3 * triangles[t]!;
    const b = 3 * triangles[t + 1]!;
    const c = 3 * triangles[t + 2]!;
    const ux = positions[b]! - positions[a]!;
    const uy = positions[b + 1]! - positions[a + 1]!;
    const uz = positions[b + 2]! - positions[a + 2]!;
    const vx = positions[c]! - positions[a]!;
    const vy = positions[c + 1]! - positions[a + 1]!;
    const vz = positions[c + 2]! - positions[a + 2]!;
    const nx = uy * vz - uz * vy;
    const ny = uz * vx - ux * vz;
    const nz = ux * vy - uy * vx;
    out[a]! += nx;
    out[a + 1]! += ny;
    out[a + 2]! += nz;
    out[b]! += nx;
    out[b + 1]! += ny;
    out[b + 2]! += nz;
    out[c]! += nx;
    out[c + 1]! += ny;
    out[c + 2]! += nz;
  }
}

/**
 * Turns each triangle, keeping its winding, so that its last corner is of the region that most of its corners are of: the GPU takes a
 * flat colour from the last one. False where nothing had to be turned.
 */
export function turnToRegions(triangles: Uint32Array, regions: Uint16Array): boolean {
  let turned = false;
  for (let t = 0; t < triangles.length; t += 3) {
    const a = triangles[t]!;
    const b = triangles[t + 1]!;
    const c = triangles[t + 2]!;
    const last = regions[c] ?? NO_REGION;
    if (regions[a] !== regions[b] || last === regions[a]) continue;
    triangles[t] = b;
    triangles[t + 1] = c;
    triangles[t + 2] = a;
    turned = true;
  }
  return turned;
}
