import {
  BackSide,
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  CapsuleGeometry,
  DoubleSide,
  EdgesGeometry,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  PlaneGeometry,
  type Quaternion,
  SphereGeometry,
  type Vector3,
} from "three";
import type { ObstacleMesh } from "../wire/binary";
import type { Obstacle } from "../wire/messages";
import type { ScenePalette } from "./palette";

/** A plane has no end; so much of it is drawn. */
const PLANE_SHOWN_M = 1.2;

/** What the sheets touch and what reflects: far sides translucent, edges as lines, so that nothing hides a sheet. */
export class Obstacles {
  readonly object = new Group();
  private readonly fill = new MeshBasicMaterial({ transparent: true, opacity: 0.3, depthWrite: false, side: BackSide });
  /** A plane is as large as the floor and under everything: fainter, and behind the floor's grid. */
  private readonly plane = new MeshBasicMaterial({
    transparent: true,
    opacity: 0.1,
    depthWrite: false,
    side: DoubleSide,
    polygonOffset: true,
    polygonOffsetFactor: 2,
    polygonOffsetUnits: 4,
  });
  private readonly line = new LineBasicMaterial({ transparent: true, opacity: 0.6 });
  private readonly meshes = new Map<number, ObstacleMesh>();
  private shown: Obstacle[] = [];
  /** What the shapes were made of: poses change often, shapes seldom. */
  private shapes = "";

  constructor(palette: ScenePalette) {
    this.recolour(palette);
  }

  recolour(palette: ScenePalette): void {
    this.fill.color.copy(palette.obstacle);
    this.plane.color.copy(palette.obstacle);
    this.line.color.copy(palette.obstacle);
  }

  clear(): void {
    this.meshes.clear();
    this.show([]);
  }

  setMesh(mesh: ObstacleMesh): void {
    this.meshes.set(mesh.index, mesh);
    this.shapes = "";
    this.show(this.shown);
  }

  show(obstacles: Obstacle[]): void {
    this.shown = obstacles;
    const shapes = JSON.stringify(obstacles.map(({ position: _, orientation: __, ...shape }) => shape));
    if (shapes !== this.shapes) {
      this.shapes = shapes;
      this.build();
    }
    obstacles.forEach((obstacle, i) => place(this.object.children[i]!, obstacle));
  }

  private build(): void {
    for (const child of this.object.children) {
      child.traverse((part) => {
        if (part instanceof Mesh || part instanceof LineSegments) part.geometry.dispose();
      });
    }
    this.object.clear();
    for (const [index, obstacle] of this.shown.entries()) {
      const body = new Group();
      const geometry = this.geometryOf(obstacle, index);
      if (geometry) body.add(new Mesh(geometry, obstacle.kind === "plane" ? this.plane : this.fill), new LineSegments(new EdgesGeometry(geometry, 20), this.line));
      this.object.add(body);
    }
  }

  private geometryOf(obstacle: Obstacle, index: number): BufferGeometry | null {
    switch (obstacle.kind) {
      case "plane":
        return new PlaneGeometry(PLANE_SHOWN_M, PLANE_SHOWN_M);
      case "box": {
        const [x, y, z] = obstacle.half_extents ?? [0, 0, 0];
        return new BoxGeometry(2 * x, 2 * y, 2 * z);
      }
      case "sphere":
        return new SphereGeometry(obstacle.radius ?? 0, 32, 20);
      case "capsule":
        // three.js lays capsules along y, the wire along z.
        return new CapsuleGeometry(obstacle.radius ?? 0, 2 * (obstacle.half_length ?? 0), 10, 24).rotateX(Math.PI / 2);
      default: {
        const mesh = this.meshes.get(index);
        if (!mesh) return null;
        const geometry = new BufferGeometry();
        geometry.setIndex(new BufferAttribute(mesh.triangles, 1));
        geometry.setAttribute("position", new BufferAttribute(mesh.positions, 3));
        return geometry;
      }
    }
  }
}

function place(object: { position: Vector3; quaternion: Quaternion }, obstacle: Obstacle): void {
  const [w, x, y, z] = obstacle.orientation;
  object.position.set(...obstacle.position);
  object.quaternion.set(x, y, z, w);
}
