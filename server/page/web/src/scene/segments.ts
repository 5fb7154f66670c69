import { InstancedInterleavedBuffer, InterleavedBufferAttribute, type Color, type ColorRepresentation } from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";

/** Lines some pixels wide whose ends change with every frame; the buffer grows by doubling and is used again. */
export class Segments {
  readonly object: LineSegments2;
  private readonly material: LineMaterial;
  private buffer = new InstancedInterleavedBuffer(new Float32Array(0), 6, 1);

  constructor(widthPixels: number, colour: ColorRepresentation, opacity = 1) {
    this.material = new LineMaterial({ linewidth: widthPixels, color: colour, opacity, transparent: opacity < 1 });
    this.object = new LineSegments2(new LineSegmentsGeometry(), this.material);
    this.object.frustumCulled = false;
    this.reserve(64);
  }

  set colour(colour: Color) {
    this.material.color.copy(colour);
  }

  /** [n,6], both ends of each. */
  update(ends: Float32Array): void {
    const segments = ends.length / 6;
    if (ends.length > this.buffer.array.length) this.reserve(Math.max(segments, this.buffer.count * 2));
    (this.buffer.array as Float32Array).set(ends);
    this.buffer.clearUpdateRanges();
    this.buffer.addUpdateRange(0, ends.length);
    this.buffer.needsUpdate = true;
    this.object.geometry.instanceCount = segments;
  }

  dispose(): void {
    this.object.geometry.dispose();
    this.material.dispose();
  }

  private reserve(segments: number): void {
    this.object.geometry.dispose();
    const geometry = new LineSegmentsGeometry();
    this.buffer = new InstancedInterleavedBuffer(new Float32Array(6 * segments), 6, 1);
    geometry.setAttribute("instanceStart", new InterleavedBufferAttribute(this.buffer, 3, 0));
    geometry.setAttribute("instanceEnd", new InterleavedBufferAttribute(this.buffer, 3, 3));
    geometry.instanceCount = 0;
    this.object.geometry = geometry;
  }
}
