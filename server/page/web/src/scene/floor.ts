import { BufferGeometry, Float32BufferAttribute, Group, LineBasicMaterial, LineSegments } from "three";
import type { ScenePalette } from "./palette";

const CELLS = 40;

/** A grid below the sheets whose squares are 1, 2 or 5 times a power of ten, every fifth line stronger. */
export class Floor {
  readonly object = new Group();
  private readonly fine = new LineSegments(new BufferGeometry(), new LineBasicMaterial());
  private readonly strong = new LineSegments(new BufferGeometry(), new LineBasicMaterial());
  /** A square's side. */
  square_m = 0;

  constructor(palette: ScenePalette) {
    this.fine.frustumCulled = this.strong.frustumCulled = false;
    this.object.add(this.fine, this.strong);
    this.strong.position.z = 1e-4;
    this.recolour(palette);
  }

  recolour(palette: ScenePalette): void {
    this.fine.material.color.copy(palette.grid);
    this.strong.material.color.copy(palette.gridStrong);
  }

  /** Around this point, in squares that suit something of this size. */
  place(x: number, y: number, height: number, radius: number): void {
    const wanted = radius / 4;
    const decade = 10 ** Math.floor(Math.log10(wanted));
    const square = decade * (wanted / decade >= 5 ? 5 : wanted / decade >= 2 ? 2 : 1);
    const snap = 5 * square;
    this.object.position.set(Math.round(x / snap) * snap, Math.round(y / snap) * snap, height);
    if (square === this.square_m) return;
    this.square_m = square;
    const fine: number[] = [];
    const strong: number[] = [];
    const end = (CELLS / 2) * square;
    for (let i = 0; i <= CELLS; ++i) {
      const at = i * square - end;
      (i % 5 === 0 ? strong : fine).push(at, -end, 0, at, end, 0, -end, at, 0, end, at, 0);
    }
    this.fine.geometry.setAttribute("position", new Float32BufferAttribute(fine, 3));
    this.strong.geometry.setAttribute("position", new Float32BufferAttribute(strong, 3));
  }
}
