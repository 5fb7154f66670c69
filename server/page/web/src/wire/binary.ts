/**
 * What goes over `/live` as binary, little-endian: u32 kind, u32 index, then what the kind says.
 * Arrays are views into the message, not copies; where a view would be misaligned the message is refused as malformed.
 */

export interface Topology {
  kind: "topology";
  sheet: number;
  vertices: number;
  /** [T,3] */
  triangles: Uint32Array;
}

export interface MeshFrame {
  kind: "frame";
  sheet: number;
  time_s: number;
  /** [V,3], metres */
  positions: Float32Array;
  /** [V]; NO_REGION where the vertex belongs to none */
  regions: Uint16Array;
  /** [R,6], both ends of each segment */
  ridges: Float32Array;
  rulings: Float32Array;
}

export interface Pcm {
  kind: "pcm";
  firstSample: number;
  channels: number;
  frames: number;
  /** Interleaved. */
  samples: Float32Array;
}

export interface ObstacleMesh {
  kind: "obstacle";
  index: number;
  positions: Float32Array;
  triangles: Uint32Array;
}

export type BinaryMessage = Topology | MeshFrame | Pcm | ObstacleMesh;

export const NO_REGION = 0xffff;

/** The message, or null where its kind is none that this page knows. Throws RangeError where it is shorter than it says. */
export function decodeBinary(buffer: ArrayBuffer): BinaryMessage | null {
  const view = new DataView(buffer);
  const index = view.getUint32(4, true);
  switch (view.getUint32(0, true)) {
    case 1: {
      const vertices = view.getUint32(8, true);
      return { kind: "topology", sheet: index, vertices, triangles: new Uint32Array(buffer, 16, 3 * view.getUint32(12, true)) };
    }
    case 2: {
      const vertices = view.getUint32(16, true);
      const ridges = view.getUint32(20, true);
      const rulings = view.getUint32(24, true);
      const regionsAt = 28 + 12 * vertices;
      const ridgesAt = regionsAt + 4 * Math.ceil(vertices / 2);
      return {
        kind: "frame",
        sheet: index,
        time_s: view.getFloat64(8, true),
        positions: new Float32Array(buffer, 28, 3 * vertices),
        regions: new Uint16Array(buffer, regionsAt, vertices),
        ridges: new Float32Array(buffer, ridgesAt, 6 * ridges),
        rulings: new Float32Array(buffer, ridgesAt + 24 * ridges, 6 * rulings),
      };
    }
    case 3: {
      const channels = view.getUint32(16, true);
      const frames = view.getUint32(20, true);
      const firstSample = Number(view.getBigUint64(8, true));
      return { kind: "pcm", firstSample, channels, frames, samples: new Float32Array(buffer, 24, frames * channels) };
    }
    case 4: {
      const vertices = view.getUint32(8, true);
      const triangles = view.getUint32(12, true);
      return {
        kind: "obstacle",
        index,
        positions: new Float32Array(buffer, 16, 3 * vertices),
        triangles: new Uint32Array(buffer, 16 + 12 * vertices, 3 * triangles),
      };
    }
    default:
      return null;
  }
}
