import {
  Box3,
  BufferAttribute,
  BufferGeometry,
  DynamicDrawUsage,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  NotEqualStencilFunc,
  ReplaceStencilOp,
  Uint8BufferAttribute,
} from "three";
import { NO_REGION, type MeshFrame, type Topology } from "../wire/binary";
import { REGION_COLOURS, type ScenePalette } from "./palette";
import { Segments } from "./segments";
import { sheetMaterial } from "./sheet_material";
import { borderEdges, turnToRegions, vertexNormals } from "./triangles";

export interface Layers {
  regions: boolean;
  rulings: boolean;
  ridges: boolean;
}

/** One sheet: its surface coloured by region, border, ridges, rulings and the shadow on the floor below. */
export class SheetMesh {
  readonly object = new Group();
  readonly bounds = new Box3();
  private readonly material = sheetMaterial();
  private readonly borderMaterial = new LineBasicMaterial({ transparent: true, opacity: 0.55 });
  private readonly shadowMaterial = new MeshBasicMaterial({
    color: 0x000000,
    transparent: true,
    opacity: 0.1,
    depthWrite: false,
    side: 2,
    stencilWrite: true,
    stencilRef: 1,
    stencilFunc: NotEqualStencilFunc,
    stencilZPass: ReplaceStencilOp,
  });
  private readonly surface = new Mesh(new BufferGeometry(), this.material);
  private readonly border = new LineSegments(new BufferGeometry(), this.borderMaterial);
  private readonly shadow = new Mesh(this.surface.geometry, this.shadowMaterial);
  private readonly ridges = new Segments(2, 0x000000);
  private readonly rulings = new Segments(1.1, 0x000000, 0.75);
  private regions = new Uint16Array(0);
  private lastFrame: MeshFrame | null = null;
  private coming: Topology | null = null;

  constructor(
    private palette: ScenePalette,
    private readonly layers: Layers,
  ) {
    for (const object of [this.shadow, this.surface, this.border, this.rulings.object, this.ridges.object]) {
      object.frustumCulled = false;
      this.object.add(object);
    }
    this.shadow.matrixAutoUpdate = false;
    this.shadow.renderOrder = -1;
    this.object.visible = false;
    this.recolour(palette);
  }

  get shownTime(): number | null {
    return this.lastFrame?.time_s ?? null;
  }

  /** Shown with the first frame of it; until then what was. */
  setTopology(topology: Topology): void {
    this.coming = topology;
  }

  /** A frame of another topology than the newest is left out: its own comes first. */
  update(frame: MeshFrame): void {
    if (this.coming) this.install(this.coming);
    this.coming = null;
    const geometry = this.surface.geometry;
    const position = geometry.getAttribute("position") as BufferAttribute | undefined;
    if (!position || position.array.length !== frame.positions.length) return;
    this.lastFrame = frame;
    (position.array as Float32Array).set(frame.positions);
    position.needsUpdate = true;
    const normal = geometry.getAttribute("normal") as BufferAttribute;
    vertexNormals(frame.positions, geometry.index!.array as Uint32Array, normal.array as Float32Array);
    normal.needsUpdate = true;
    this.measure(frame.positions);
    if (this.takeRegions(frame.regions)) this.tint();
    this.ridges.update(frame.ridges);
    this.rulings.update(frame.rulings);
    this.object.visible = true;
  }

  showLayers(): void {
    this.ridges.object.visible = this.layers.ridges;
    this.rulings.object.visible = this.layers.rulings;
    this.tint();
  }

  setFloor(height: number): void {
    this.shadow.matrix.makeScale(1, 1, 0).setPosition(0, 0, height);
  }

  recolour(palette: ScenePalette): void {
    this.palette = palette;
    this.ridges.colour = palette.ridge;
    this.rulings.colour = palette.ruling;
    this.borderMaterial.color.copy(palette.ruling);
    this.shadowMaterial.opacity = palette.shadow;
    this.tint();
  }

  dispose(): void {
    this.surface.geometry.dispose();
    this.border.geometry.dispose();
    this.material.dispose();
    this.borderMaterial.dispose();
    this.shadowMaterial.dispose();
    this.ridges.dispose();
    this.rulings.dispose();
  }

  private install(topology: Topology): void {
    const geometry = new BufferGeometry();
    const vertices = topology.vertices;
    const dynamic = (attribute: BufferAttribute) => attribute.setUsage(DynamicDrawUsage);
    geometry.setIndex(new BufferAttribute(topology.triangles.slice(), 1));
    geometry.setAttribute("position", dynamic(new BufferAttribute(new Float32Array(3 * vertices), 3)));
    geometry.setAttribute("normal", dynamic(new BufferAttribute(new Float32Array(3 * vertices), 3)));
    geometry.setAttribute("tint", dynamic(new Uint8BufferAttribute(new Uint8Array(3 * vertices), 3, true)));
    const border = new BufferGeometry();
    border.setIndex(new BufferAttribute(borderEdges(topology.triangles), 1));
    border.setAttribute("position", geometry.getAttribute("position"));
    this.surface.geometry.dispose();
    this.border.geometry.dispose();
    this.surface.geometry = geometry;
    this.shadow.geometry = geometry;
    this.border.geometry = border;
    this.regions = new Uint16Array(vertices).fill(NO_REGION);
    this.tint();
  }

  private measure(positions: Float32Array): void {
    const { min, max } = this.bounds.makeEmpty();
    for (let i = 0; i < positions.length; i += 3) {
      const x = positions[i]!;
      const y = positions[i + 1]!;
      const z = positions[i + 2]!;
      min.set(Math.min(min.x, x), Math.min(min.y, y), Math.min(min.z, z));
      max.set(Math.max(max.x, x), Math.max(max.y, y), Math.max(max.z, z));
    }
  }

  private takeRegions(regions: Uint16Array): boolean {
    let changed = false;
    for (let i = 0; i < regions.length && !changed; ++i) changed = regions[i] !== this.regions[i];
    if (!changed) return false;
    this.regions.set(regions);
    const index = this.surface.geometry.index!;
    if (turnToRegions(index.array as Uint32Array, this.regions)) index.needsUpdate = true;
    return true;
  }

  private tint(): void {
    const attribute = this.surface.geometry.getAttribute("tint") as BufferAttribute | undefined;
    if (!attribute) return;
    const tint = attribute.array as Uint8Array;
    for (let vertex = 0; vertex < this.regions.length; ++vertex) {
      const region = this.regions[vertex]!;
      const shown = this.layers.regions && region !== NO_REGION;
      const colour = shown ? REGION_COLOURS[region % REGION_COLOURS.length]! : this.palette.paper;
      tint[3 * vertex] = 255 * colour.r;
      tint[3 * vertex + 1] = 255 * colour.g;
      tint[3 * vertex + 2] = 255 * colour.b;
    }
    attribute.needsUpdate = true;
  }
}
