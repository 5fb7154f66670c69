import { Box3, Fog, PerspectiveCamera, Scene, Sphere, Vector3, WebGLRenderer, type Object3D } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { MeshFrame, ObstacleMesh, Topology } from "../wire/binary";
import type { Obstacle, SheetEvents } from "../wire/messages";
import { onTheme, isDark } from "../theme";
import { Floor } from "./floor";
import { Obstacles } from "./obstacles";
import { scenePalette } from "./palette";
import { Pops, PopKind } from "./pops";
import { Sharpness } from "./sharpness";
import { SheetMesh, type Layers } from "./sheet_mesh";

export type LayerName = keyof Layers | "crumples" | "contacts" | "tears";

const FIRST_VIEW = new Vector3(-0.55, -1, 0.62).normalize();
const FREE_WIDTH = 0.9;
const FREE_HEIGHT = 0.84;
const PHONE_PX = 600;
/** Of the way that is left, each display frame. */
const GLIDE = 0.14;
const LATELY_S = 8;
const NEARER_FROM = 1.3;
const TURN_PER_KEY = Math.PI / 36;
const POP_OF: Partial<Record<LayerName, PopKind>> = { crumples: PopKind.Crumple, contacts: PopKind.Contact, tears: PopKind.Tear };

/** The watched session in space. It draws only when something changed: a frame came, the camera moved, an event still fades. */
export class SceneView {
  readonly camera = new PerspectiveCamera(32, 1, 0.01, 100);
  private readonly renderer: WebGLRenderer | null;
  private readonly controls: OrbitControls;
  private readonly scene = new Scene();
  private readonly sheets = new Map<number, SheetMesh>();
  private readonly pending = new Map<number, MeshFrame>();
  private readonly layers: Layers = { regions: true, rulings: true, ridges: true };
  private readonly floor = new Floor(scenePalette(isDark()));
  private readonly pops = new Pops(scenePalette(isDark()));
  private readonly obstacles = new Obstacles(scenePalette(isDark()));
  private readonly fog = new Fog(0, 1, 10);
  private fitted = false;
  /** What the camera was placed to show, and whether the reader has turned it since. */
  private readonly fittedTo = new Box3();
  private taken = false;
  /** Where sheets were in the last seconds. */
  private readonly lately = new Box3();
  private latelySince = 0;
  /** Where the camera glides to. */
  private glide: { camera: Vector3; target: Vector3 } | null = null;
  private dirty = true;
  private readonly sharpness = new Sharpness();
  private calledAt = 0;
  private drew = false;
  framesShown = 0;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = makeRenderer(canvas);
    this.camera.up.set(0, 0, 1);
    this.camera.position.copy(FIRST_VIEW);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.15;
    this.controls.maxPolarAngle = Math.PI * 0.96;
    this.controls.addEventListener("change", () => (this.dirty = true));
    this.controls.addEventListener("start", () => this.take());
    canvas.addEventListener("webglcontextrestored", () => (this.dirty = true));
    this.scene.fog = this.fog;
    this.scene.add(this.floor.object, this.obstacles.object, this.pops.object);
    canvas.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.resize()).observe(canvas);
    onTheme((dark) => {
      const palette = scenePalette(dark);
      this.renderer?.setClearColor(palette.background);
      this.fog.color.copy(palette.background);
      this.floor.recolour(palette);
      this.pops.recolour(palette);
      this.obstacles.recolour(palette);
      for (const sheet of this.sheets.values()) sheet.recolour(palette);
      this.dirty = true;
    });
  }

  /** The length of a square of the floor's grid; 0 before there was a sheet. */
  get gridSquare_m(): number {
    return this.floor.square_m;
  }

  /** False where the browser has no WebGL 2. */
  get works(): boolean {
    return this.renderer !== null;
  }

  add(object: Object3D): void {
    this.scene.add(object);
  }

  invalidate(): void {
    this.dirty = true;
  }

  /** Before another session is shown. */
  clear(): void {
    for (const sheet of this.sheets.values()) {
      this.scene.remove(sheet.object);
      sheet.dispose();
    }
    this.sheets.clear();
    this.pending.clear();
    this.obstacles.clear();
    this.pops.clear();
    this.fitted = false;
    this.taken = false;
    this.glide = null;
    this.dirty = true;
  }

  setTopology(topology: Topology): void {
    let sheet = this.sheets.get(topology.sheet);
    if (!sheet) {
      sheet = new SheetMesh(scenePalette(isDark()), this.layers);
      sheet.setFloor(this.floor.object.position.z);
      this.sheets.set(topology.sheet, sheet);
      this.scene.add(sheet.object);
    }
    this.pending.delete(topology.sheet);
    sheet.setTopology(topology);
  }

  /** Shown with the next picture; of several that come between two, the newest. */
  setFrame(frame: MeshFrame): void {
    this.pending.set(frame.sheet, frame);
  }

  /** Sheets beyond these are gone. */
  keepSheets(indices: Set<number>): void {
    for (const [index, sheet] of this.sheets) {
      if (indices.has(index)) continue;
      this.scene.remove(sheet.object);
      sheet.dispose();
      this.sheets.delete(index);
      this.dirty = true;
    }
  }

  setObstacle(mesh: ObstacleMesh): void {
    this.obstacles.setMesh(mesh);
    this.dirty = true;
  }

  setObstacles(obstacles: Obstacle[]): void {
    this.obstacles.show(obstacles);
    this.dirty = true;
  }

  addEvents(events: SheetEvents): void {
    this.pops.add(events, performance.now() / 1000);
  }

  showLayer(name: LayerName, shown: boolean): void {
    const pop = POP_OF[name];
    if (pop !== undefined) this.pops.layers[pop] = shown;
    else this.layers[name as keyof Layers] = shown;
    for (const sheet of this.sheets.values()) sheet.showLayers();
    this.dirty = true;
  }

  /** Simulation time of the newest frame on the screen. */
  shownTime_s(): number | null {
    let newest: number | null = null;
    for (const { shownTime } of this.sheets.values()) if (shownTime !== null) newest = Math.max(newest ?? shownTime, shownTime);
    return newest;
  }

  /** Looks at all sheets from where the view began. */
  lookAgain(): void {
    this.taken = false;
    this.look(this.bounds(), FIRST_VIEW, true);
  }

  /**
   * Steps back where sheets have left what the camera was placed to show, and nearer where they have needed much less of it for a while;
   * not where the reader holds it. [now and then]
   */
  keepInSight(now_s: number): void {
    const now = this.bounds();
    if (!this.fitted || this.taken || now.isEmpty()) return;
    const known = this.fittedTo.clone();
    known.expandByVector(known.getSize(new Vector3()).multiplyScalar(0.08));
    if (!known.containsBox(now)) this.look(this.fittedTo.clone().union(now), this.direction(), true);
    this.lately.union(now);
    if (now_s - this.latelySince < LATELY_S) return;
    if (extent(this.fittedTo) > NEARER_FROM * extent(this.lately)) this.look(this.lately.clone(), this.direction(), true);
    this.lately.makeEmpty();
    this.latelySince = now_s;
  }

  /** Draws where something changed; true where it drew. [once a display frame] */
  draw(now_s: number): boolean {
    if (this.drew && this.sharpness.took(now_s - this.calledAt)) this.resize();
    this.calledAt = now_s;
    this.drew = false;
    for (const [index, frame] of this.pending) {
      this.sheets.get(index)?.update(frame);
      this.dirty = true;
      ++this.framesShown;
    }
    this.pending.clear();
    if (!this.fitted) this.look(this.bounds(), FIRST_VIEW, false);
    this.moveOn();
    this.controls.update();
    const popped = this.pops.object.visible;
    if (this.pops.advance(now_s) || popped) this.dirty = true;
    if (!this.dirty || !this.renderer || this.canvas.width === 0) return false;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
    this.drew = true;
    return true;
  }

  private look(box: Box3, from: Vector3, gliding: boolean): void {
    if (box.isEmpty()) return;
    const { center, radius: measured } = box.getBoundingSphere(new Sphere());
    const radius = Math.max(measured, 1e-3);
    const distance = this.distanceToSee(box, center, from, radius);
    this.fittedTo.copy(box);
    this.lately.makeEmpty();
    this.latelySince = performance.now() / 1000;
    this.glide = { target: center, camera: center.clone().addScaledVector(from, distance) };
    if (!gliding || window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.controls.target.copy(this.glide.target);
      this.camera.position.copy(this.glide.camera);
      this.glide = null;
    }
    this.controls.minDistance = 0.1 * radius;
    this.controls.maxDistance = 12 * distance;
    this.camera.near = distance / 200;
    this.camera.far = distance * 40;
    this.camera.updateProjectionMatrix();
    this.fog.near = distance;
    this.fog.far = distance * 2.6;
    // The floor is at 0 unless the sheets are far above it or below.
    const floor = box.min.z >= 0 && box.min.z < 2 * radius ? 0 : box.min.z;
    this.floor.place(center.x, center.y, floor, radius);
    for (const sheet of this.sheets.values()) sheet.setFloor(floor);
    this.fitted = true;
    this.dirty = true;
  }

  private direction(): Vector3 {
    return this.camera.position.clone().sub(this.controls.target).normalize();
  }

  private moveOn(): void {
    if (!this.glide) return;
    this.camera.position.lerp(this.glide.camera, GLIDE);
    this.controls.target.lerp(this.glide.target, GLIDE);
    this.dirty = true;
    if (this.camera.position.distanceTo(this.glide.camera) < 1e-3 * this.camera.position.distanceTo(this.controls.target)) this.glide = null;
  }

  /** The reader has the camera now. */
  private take(): void {
    this.taken = true;
    this.glide = null;
  }

  private bounds(): Box3 {
    const all = new Box3();
    for (const sheet of this.sheets.values()) if (sheet.object.visible) all.union(sheet.bounds);
    return all;
  }

  /** From where, in this direction, the box fills what the words at the picture's edges leave free. */
  private distanceToSee(box: Box3, centre: Vector3, from: Vector3, radius: number): number {
    const right = new Vector3().crossVectors(this.camera.up, from).normalize();
    const over = new Vector3().crossVectors(from, right);
    const high = FREE_HEIGHT * Math.tan((this.camera.fov * Math.PI) / 360);
    const wide = FREE_WIDTH * Math.tan((this.camera.fov * Math.PI) / 360) * this.camera.aspect;
    let distance = radius;
    for (let corner = 0; corner < 8; ++corner) {
      const at = new Vector3(
        corner & 1 ? box.max.x : box.min.x,
        corner & 2 ? box.max.y : box.min.y,
        corner & 4 ? box.max.z : box.min.z,
      ).sub(centre);
      const near = at.dot(from);
      distance = Math.max(distance, near + Math.abs(at.dot(right)) / wide, near + Math.abs(at.dot(over)) / high);
    }
    return distance;
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.canvas;
    if (clientWidth === 0 || clientHeight === 0) return;
    const ratio = Math.min(window.devicePixelRatio, 2) * this.sharpness.scale;
    this.renderer?.setPixelRatio(ratio);
    this.renderer?.setSize(clientWidth, clientHeight, false);
    this.pops.setPixelRatio(ratio);
    const turned = this.camera.aspect > 1 !== clientWidth > clientHeight;
    this.camera.aspect = clientWidth / clientHeight;
    // On a phone the words below take several lines: the sheet stands higher.
    if (clientWidth < PHONE_PX) this.camera.setViewOffset(clientWidth, clientHeight, 0, 0.07 * clientHeight, clientWidth, clientHeight);
    else this.camera.clearViewOffset();
    this.camera.updateProjectionMatrix();
    if (turned && this.fitted) this.look(this.fittedTo.clone(), this.direction(), false);
    this.dirty = true;
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const turn = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (turn) this.orbit(turn[0]! * TURN_PER_KEY, turn[1]! * TURN_PER_KEY);
    else if (event.key === "+" || event.key === "=") this.zoom(1 / 1.1);
    else if (event.key === "-") this.zoom(1.1);
    else if (event.key === "f" || event.key === "Home") this.lookAgain();
    else return;
    event.preventDefault();
  }

  private orbit(around: number, over: number): void {
    this.take();
    const arm = this.camera.position.clone().sub(this.controls.target);
    const length = arm.length();
    const azimuth = Math.atan2(arm.y, arm.x) + around;
    const polar = Math.min(Math.max(Math.acos(arm.z / length) + over, 0.02), this.controls.maxPolarAngle);
    arm.set(Math.sin(polar) * Math.cos(azimuth), Math.sin(polar) * Math.sin(azimuth), Math.cos(polar)).multiplyScalar(length);
    this.camera.position.copy(this.controls.target).add(arm);
    this.controls.update();
    this.dirty = true;
  }

  private zoom(factor: number): void {
    this.take();
    const arm = this.camera.position.clone().sub(this.controls.target).multiplyScalar(factor);
    this.camera.position.copy(this.controls.target).add(arm);
    this.controls.update();
    this.dirty = true;
  }
}

function extent(box: Box3): number {
  return box.getSize(new Vector3()).length();
}

function makeRenderer(canvas: HTMLCanvasElement): WebGLRenderer | null {
  if (!canvas.getContext("webgl2", { antialias: true, stencil: true, powerPreference: "low-power" })) return null;
  return new WebGLRenderer({ canvas, antialias: true, stencil: true, powerPreference: "low-power" });
}
